# SPDX-License-Identifier: Apache-2.0
"""Values of splines, compiled: scipy's take ten times as long for one place."""

from __future__ import annotations

import numpy as np

from soliton_linkage.compiling import COUNT, NUMBER, READ, READ_TABLE, ROW, compiled
from soliton_linkage.linkage.chain import Array


@compiled(READ, READ_TABLE, COUNT, NUMBER, ROW)
def spline(knots: Array, coefficients: Array, degree: int, at: float, values: Array) -> None:
    """Set values of B-splines with knots in common, shape (M,); coefficients of shape (K, M).

    By the recursion of Cox and de Boor.
    """
    low, high = degree, coefficients.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= at:
            low = middle
        else:
            high = middle
    basis = np.zeros(degree + 1)
    basis[0] = 1.0
    for order in range(1, degree + 1):
        saved = 0.0
        for n in range(order):
            right, left = knots[low + n + 1], knots[low + 1 + n - order]
            share = basis[n] / (right - left)
            basis[n] = saved + (right - at) * share
            saved = (at - left) * share
        basis[order] = saved
    for column in range(values.size):
        value = 0.0
        for n in range(degree + 1):
            value += basis[n] * coefficients[low - degree + n, column]
        values[column] = value
