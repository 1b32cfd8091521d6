# SPDX-License-Identifier: Apache-2.0
"""Where points of space are in a picture: the camera, its calibration, and the chain's plane."""
