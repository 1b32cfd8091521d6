# SPDX-License-Identifier: Apache-2.0
"""Angles from pictures: the camera, the plane of a chain, its markers, dots and rotors.

Pictures go in, angles and their standard deviations come out. OpenCV is imported when it is used.
"""
