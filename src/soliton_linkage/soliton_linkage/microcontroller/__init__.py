# SPDX-License-Identifier: Apache-2.0
"""Angles from a microcontroller: the frames of its serial line, its clock and its encoders."""
