# SPDX-License-Identifier: Apache-2.0
"""Coefficients of the symplectic Runge-Kutta-Nystrom method of `nystrom_steps`.

SRKN_14^a, order 6, of S. Blanes and P. C. Moan, J. Comput. Appl. Math. 142 (2002) 313; it makes
use of a kinetic energy that is quadratic.
"""

from __future__ import annotations

import numpy as np

ORDER = 6
"""The error of a step of length h goes as h^7."""
STABLE_STEP = 3.14
"""Longest step in units of 1 / omega at which vibrations of frequency omega stay bounded.

Those of pi grow, though by less than a thousandth a step, and those of 6.15 and more.
"""

_HALF_OF_DRIFTS = (
    0.0378593198406116,
    0.102635633102435,
    -0.0258678882665587,
    0.314241403071447,
    -0.130144459517415,
    0.106417700369543,
    -0.00879424312851058,
)
"""a_1 to a_7 of the paper."""
_HALF_OF_KICKS = (
    0.09171915262446165,
    0.183983170005006,
    -0.05653436583288827,
    0.004914688774712854,
    0.143761127168358,
    0.328567693746804,
)
"""b_1 to b_6 of the paper."""
_LAST_KICK = 0.5 - sum(_HALF_OF_KICKS)
"""b_7, of which the kicks of half a step add up to a half."""

DRIFTS = np.array([*_HALF_OF_DRIFTS, 1 - 2 * sum(_HALF_OF_DRIFTS), *_HALF_OF_DRIFTS[::-1]])
"""a_1 to a_15."""
KICKS = np.array([*_HALF_OF_KICKS, _LAST_KICK, _LAST_KICK, *_HALF_OF_KICKS[::-1]])
"""b_1 to b_14."""
