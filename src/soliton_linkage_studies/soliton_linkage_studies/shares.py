# SPDX-License-Identifier: Apache-2.0
"""How well a share of draws tells a probability."""

from __future__ import annotations

import numpy as np

from soliton_linkage.linkage.chain import Array


def score_interval(share: Array, count: int, deviations: float = 1.0) -> tuple[Array, Array]:
    """Ends of the score interval of Wilson for shares of a count of draws, of any shape.

    They are the probabilities p of which a share s is so many standard deviations off,
    |s - p| = deviations sqrt(p (1 - p) / count), which leaves room where all draws agree.
    """
    pull = deviations**2 / count
    middle = share + pull / 2
    half = np.sqrt(pull * (share * (1 - share) + pull / 4))
    low, high = (middle - half) / (1 + pull), (middle + half) / (1 + pull)
    return np.clip(low, 0.0, share), np.clip(high, share, 1.0)
