# SPDX-License-Identifier: Apache-2.0
"""Domain walls, or *walls*: shapes at rest, continuum theories, and detection in angles.

`static_wall` computes walls at rest, `continuum` contains the theories, and `passage` finds bonds
that stop walls. A moving wall is a *soliton*. `tanh_fit` detects solitons in a frame, and `track`
follows a soliton through a recording. The tails of walls are in `linear.bands`.
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
