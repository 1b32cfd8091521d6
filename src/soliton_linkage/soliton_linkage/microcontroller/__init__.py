# SPDX-License-Identifier: Apache-2.0
"""Angles from a microcontroller: frames of its serial line, its clock, and its encoders."""
