# SPDX-License-Identifier: Apache-2.0
"""Collisions of kinks and anti-kinks on rings of springs."""
