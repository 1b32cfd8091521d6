# SPDX-License-Identifier: Apache-2.0
"""Angles from a microcontroller: what is said on its serial line, and when by its clock.

Bytes and times go in, angles and instants come out. docs/serial.md describes the line.
"""
