# SPDX-License-Identifier: Apache-2.0
"""Medians, which a few strange values do not move."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.linkage.chain import Array

DEVIATION_PER_MEDIAN = 1.4826
"""Standard deviation of normal noise over the median of its absolute values [1]: 1 / 0.67449."""


def median(values: Array) -> float:
    """Median of numbers of which none is NaN, whose order is lost: numpy's takes far longer."""
    half = len(values) // 2
    if len(values) % 2:
        values.partition(half)
        return float(values[half])
    values.partition((half - 1, half))
    return (float(values[half - 1]) + float(values[half])) / 2


_CLIP = 2.5
"""Deviations at which sizes are clipped [1]: one normal error in eighty is larger."""
_LEFT_BY_CLIP = 0.9776
"""Mean square of normal errors that are clipped there, over their variance [1]."""


def clipped_deviation(sizes: Array) -> float:
    """Root mean square of errors by their sizes, of which large ones count as 2.5 deviations.

    Of normal errors it is nearly as sure as without, more than twice as sure as the median. The
    order of the sizes is lost; 0 of none.
    """
    if not len(sizes):
        return 0.0
    clipped = np.minimum(sizes, _CLIP * robust_deviation(sizes))
    return math.sqrt(float(clipped @ clipped) / (_LEFT_BY_CLIP * len(sizes)))


def robust_deviation(sizes: Array) -> float:
    """Root mean square of errors by the median of their sizes, whose order is lost; 0 of none."""
    return DEVIATION_PER_MEDIAN * median(sizes) if len(sizes) else 0.0
