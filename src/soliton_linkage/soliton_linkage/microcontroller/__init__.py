# SPDX-License-Identifier: Apache-2.0
"""Rotor angles from a microcontroller: frames on the serial line, clock, and encoders."""
