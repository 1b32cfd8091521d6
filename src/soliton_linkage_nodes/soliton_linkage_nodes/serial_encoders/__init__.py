# SPDX-License-Identifier: Apache-2.0
"""Angles from a microcontroller in place of the simulator, and torques to its valves."""
