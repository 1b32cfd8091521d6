# SPDX-License-Identifier: Apache-2.0
"""Angles from pictures: markers, the camera and the plane of a chain, and a renderer of films.

Pictures go in, angles and their standard deviations come out. OpenCV is imported when it is used.
"""
