# SPDX-License-Identifier: Apache-2.0
"""Estimation of walls and their motion from frames of noisy angles."""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
