# SPDX-License-Identifier: Apache-2.0
"""Actuators at the edges and joints of a chain: a `ChainDriver` converts commands into torques."""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
