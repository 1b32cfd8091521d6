# SPDX-License-Identifier: Apache-2.0
"""Domain walls, called *walls*: their angles at rest, continuum theories, and their detection.

`static_wall` computes walls at rest, and `anti_kink` the anti-kinks. `continuum` contains the
continuum theories. `passage` finds bonds that stop walls. `tanh_fit` detects solitons, which are
moving walls, in a frame, and `track` follows one through a recording.
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
