# SPDX-License-Identifier: Apache-2.0
"""What rounding does to readings.

Errors of readings that are rounded by a step q are uniform, of the variance q^2 / 12, and new in
each frame where angles cross steps, as noise is (B. Widrow, I. Kollar, Quantization Noise,
Cambridge, 2008). Where a rotor rests they are one error, however often it is read.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.linkage.chain import Array

_LEAST_STEP = 1e-9
"""Of readings that are rounded [rad]: less is that of numbers."""


def rounding_noise(readings: Array) -> float:
    """Standard deviation of rounding to the least step of readings [rad], (T, N), 0 of none."""
    steps = np.abs(np.diff(readings, axis=0))
    least = float(steps[steps > _LEAST_STEP].min(initial=np.inf))
    return least / math.sqrt(12) if math.isfinite(least) else 0.0


def repeats(readings: Array) -> Array:
    """How many readings in a row are the same as each [1], (T, N); missing ones count for none.

    All of them together say as much as one does: their variance is so many times that of one.
    """
    made = np.ones_like(readings)
    for own, values in zip(made.T, readings.T, strict=True):
        seen = np.flatnonzero(np.isfinite(values))
        changed = np.abs(np.diff(values[seen], prepend=np.inf)) > _LEAST_STEP
        counts = np.diff(np.flatnonzero(changed), append=len(seen))
        own[seen] = np.repeat(counts, counts)
    return made
