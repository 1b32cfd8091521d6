# SPDX-License-Identifier: Apache-2.0
"""Measurement of rotor angles in pictures: camera model, markers, dot fits, and errors.

OpenCV and PyAV are optional. The modules therefore import OpenCV and PyAV on first use.
"""
