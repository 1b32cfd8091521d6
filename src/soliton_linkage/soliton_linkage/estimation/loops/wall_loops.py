# SPDX-License-Identifier: Apache-2.0
"""Loops over the bonds of a frame: which domains it has."""

from __future__ import annotations

import numpy as np

from soliton_linkage.compiling import FLAGS, NUMBER, READ, compiled
from soliton_linkage.estimation.loops.frame_loops import Flags
from soliton_linkage.linkage.chain import Array


@compiled(READ, NUMBER, FLAGS)
def domains(polarised: Array, cost: float, right: Flags) -> None:
    """Set which bonds are of domains that lean right, shape (B,), by their polarisations (B,).

    Of all ways to divide the chain it is that with the largest sum of the polarisations, no more
    than 1 each, of domains that lean right less that of those that lean left, less a cost for
    each wall.
    """
    count = polarised.size
    # Best sums that end in a left-leaning and in a right-leaning bond, and where each came from.
    left, rightmost = 0.0, 0.0
    from_right = np.empty(count, dtype=np.bool_)
    from_left = np.empty(count, dtype=np.bool_)
    for n in range(count):
        score = min(max(polarised[n], -1.0), 1.0)
        from_right[n] = n > 0 and rightmost - cost > left
        from_left[n] = n > 0 and left - cost > rightmost
        before_left = rightmost - cost if from_right[n] else left
        before_right = left - cost if from_left[n] else rightmost
        left, rightmost = before_left - score, before_right + score
    leans = rightmost >= left
    for n in range(count - 1, -1, -1):
        right[n] = leans
        leans = (not from_left[n]) if leans else from_right[n]
