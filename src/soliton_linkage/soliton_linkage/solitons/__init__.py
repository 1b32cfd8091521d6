# SPDX-License-Identifier: Apache-2.0
"""Domain walls, *walls* for short: as they are at rest, in theory, and found in angles.

`static_wall` builds them bar by bar, `continuum` has their theories, `passage` tells which
deviations stop them. A moving wall is a *soliton* where it is found: `tanh_fit` in a frame, with
its charge, `track` along a recording. Tails of walls are in `linear.bands`.
"""

from soliton_linkage.exports import public_names

__getattr__, __dir__, __all__ = public_names(__name__, __file__)
