# SPDX-License-Identifier: Apache-2.0
"""How far a chain may be from the one that was found, where it is not linear in all unknowns.

Lengths, stiffnesses and masses stand in for each other along bent valleys: to first order their
covariance is that across, and samples of what the readings leave open spread further.
"""

from __future__ import annotations

import numpy as np

from soliton_linkage.identification.motion.free_motion import Parts
from soliton_linkage.linkage.chain import Array


def widened(covariance: Array, samples: Array, at: Parts) -> Array:
    """Covariance of a chain, (P, P), as wide as samples of its changes, (S, P).

    By one factor for lengths and offsets, one for stiffnesses and one for masses, as samples are
    few, and none below 1: to first order they are the least that there is.
    """
    variances, factors = np.diag(covariance), np.ones(len(covariance))
    for part in (at.lengths, at.stiffnesses, at.masses):
        over = samples[:, part] ** 2 / variances[part]
        factors[part] = max(1.0, float(np.sqrt(np.mean(over))))
    return np.asarray(factors[:, None] * covariance * factors)
