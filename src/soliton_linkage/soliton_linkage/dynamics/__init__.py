# SPDX-License-Identifier: Apache-2.0
"""Simulations of chains of springs and of rigid bars, and their energy balance."""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
