# SPDX-License-Identifier: Apache-2.0
"""Medians, which a few strange values do not move."""

from __future__ import annotations

from soliton_linkage.linkage.chain import Array

DEVIATION_PER_MEDIAN = 1.4826
"""Standard deviation of normal noise over the median of its absolute values [1]: 1 / 0.67449."""
FREEDOMS_OF_MEDIAN = 0.368
"""Normal errors whose root mean square is as sure as the deviation by the median of one [1]."""


def median(values: Array) -> float:
    """Median of numbers of which none is NaN, whose order is lost: numpy's takes far longer."""
    half = len(values) // 2
    if len(values) % 2:
        values.partition(half)
        return float(values[half])
    values.partition((half - 1, half))
    return (float(values[half - 1]) + float(values[half])) / 2


def robust_deviation(sizes: Array) -> float:
    """Root mean square of errors by the median of their sizes, whose order is lost; 0 of none."""
    return DEVIATION_PER_MEDIAN * median(sizes) if len(sizes) else 0.0
