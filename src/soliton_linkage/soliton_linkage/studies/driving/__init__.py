# SPDX-License-Identifier: Apache-2.0
"""What drives a chain, on one page: actuator, energy balance, bars, tilt, moves."""
