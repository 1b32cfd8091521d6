# SPDX-License-Identifier: Apache-2.0
"""Angles from pictures: camera model, markers, dot fits, rotor identities and their errors.

OpenCV and PyAV are optional, so modules import them on first use.
"""
