# SPDX-License-Identifier: Apache-2.0
"""Measurement of rotor angles in pictures; optional OpenCV and PyAV are imported on first use."""
