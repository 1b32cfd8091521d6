# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of the estimation, rotor by rotor and filter by filter.

Frames are actual angles [rad], shape (N,), NaN where unknown. What a loop finds is set in arrays
that it is given. Settings come as the record of `EstimationSettings.record`.
"""
