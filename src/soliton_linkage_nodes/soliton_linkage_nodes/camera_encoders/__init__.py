# SPDX-License-Identifier: Apache-2.0
"""Node that replaces encoders: it measures the angles of the rotors in camera pictures."""
