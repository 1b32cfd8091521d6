# SPDX-License-Identifier: Apache-2.0
"""Description of a chain: its parameters and deviations, gravity, encoders, and recordings."""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
