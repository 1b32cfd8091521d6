# SPDX-License-Identifier: Apache-2.0
"""Validation of driven chains on one page, with all actuators, tilts and moves."""
