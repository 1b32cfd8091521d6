# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of the estimation, rotor by rotor and filter by filter."""
