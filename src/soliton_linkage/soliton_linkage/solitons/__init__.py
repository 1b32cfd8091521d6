# SPDX-License-Identifier: Apache-2.0
"""Domain walls, or *walls*: shapes at rest, continuum theories, and detection in angles.

`static_wall` assembles walls bar by bar, `continuum` has their theories, `passage` finds bonds
that stop them. A moving wall is a *soliton*: `tanh_fit` finds it in a frame, with its charge, and
`track` follows it along a recording. The tails of walls are in `linear.bands`.
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
