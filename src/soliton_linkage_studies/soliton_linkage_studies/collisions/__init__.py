# SPDX-License-Identifier: Apache-2.0
"""Collisions of kinks and anti-kinks on periodic chains of springs (rings)."""
