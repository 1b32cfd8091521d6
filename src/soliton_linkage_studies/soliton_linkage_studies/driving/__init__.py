# SPDX-License-Identifier: Apache-2.0
"""Validation of chains that are driven by actuators, by a tilt or by the steering, on one page."""
