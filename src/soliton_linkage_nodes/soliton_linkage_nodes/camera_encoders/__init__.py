# SPDX-License-Identifier: Apache-2.0
"""Node that measures the angles of the rotors in camera pictures. It replaces encoders."""
