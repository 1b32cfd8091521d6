# SPDX-License-Identifier: Apache-2.0
"""Node that reads encoders and drives valves through a microcontroller on a serial port."""
