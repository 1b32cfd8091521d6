# SPDX-License-Identifier: Apache-2.0
"""Estimation of the positions and velocities of walls from frames of noisy angles."""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
