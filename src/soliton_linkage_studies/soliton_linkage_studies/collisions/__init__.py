# SPDX-License-Identifier: Apache-2.0
"""Kinks and anti-kinks that meet, on rings of springs."""
