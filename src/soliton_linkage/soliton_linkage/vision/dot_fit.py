# SPDX-License-Identifier: Apache-2.0
"""Where dots are, to a small part of a pixel, and how well that is known.

A dot of radius R at p is fitted, by least squares, to the pixels of its label:

    I(x) = (1 + g (x - p)) (w - c T(x - p)),
    T(y) = mean_k erfc((|y - s_k| - R) / (b sqrt 2)) / 2,

white w, contrast c, gradient of the light g, blur b, and places s_k on its way while the picture
was exposed; R and b are fitted too. Where noise is the same in all pixels this is as exact as the
pixels allow, and the inverse of its normal matrix is the covariance of the place. Pixels at the
edge of the label do not count: what is beyond it is not the same on all sides, and would draw the
dot there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import NUMBER, READ_PICTURE, ROW, TABLE, compiled
from soliton_linkage.linkage.chain import Array

_BLUR = 0.6
"""Standard deviation of the edge of a dot to begin with, as lenses and pixels make it [pixels]."""
_BLURS = (0.35, 1.5)
"""Least and most that it may be found to be [pixels]: a pixel's own, and that of bad lenses."""
_RADII = (0.7, 1.4)
"""Least and largest radius of a dot over that which is expected [1]."""
_PARAMETERS = 8
"""w, c, g in columns and rows, p in columns and rows, R and b."""
_CLEAR = 1.4
"""Of the edge of a label within which pixels do not count [pixels], more than twice the blur."""
_BEYOND = 4.0
"""Of the edge of a dot beyond which they tell nothing of it [pixels]."""
_ITERATIONS = 6
"""Of Gauss and Newton at most: the first places are within a pixel."""
_SETTLED = 1e-4
"""Step after which no more is taken [pixels]: a hundredth of what the best camera's noise does."""
_LONGEST_STEP = 0.7
"""Of an iteration [pixels]: the model is linear no farther."""
_PLACES = 5
"""On the way of a dot while it is exposed, of which the mean is taken."""
_LEAST_SMEAR = 0.3
"""Way below which a dot is as good as at rest [pixels]."""


@compiled(READ_PICTURE, ROW, NUMBER, ROW)
def begin_loop(grey: NDArray[np.uint8], start: Array, reach: float, state: Array) -> None:
    """White, contrast, gradient and place to begin with."""
    height, width = grey.shape
    low, high = 255.0, 0.0
    for row in range(max(int(start[1] - reach), 0), min(int(start[1] + reach) + 2, height)):
        for column in range(max(int(start[0] - reach), 0), min(int(start[0] + reach) + 2, width)):
            value = float(grey[row, column])
            if math.hypot(column - start[0], row - start[1]) <= reach:
                low, high = min(low, value), max(high, value)
    state[0], state[1] = high, max(high - low, 1.0)
    state[2] = state[3] = 0.0
    state[4], state[5] = start[0], start[1]


@compiled(READ_PICTURE, ROW, NUMBER, ROW, TABLE, ROW)
def normal_loop(
    grey: NDArray[np.uint8],
    state: Array,
    reach: float,
    way: Array,
    normal: Array,
    right: Array,
) -> tuple[float, float]:
    """Fill the normal equations; return the sum of squares that is left, and of the weights."""
    height, width = grey.shape
    white, contrast, by_column, by_row, x0, y0, radius, blur = state
    places = _PLACES if math.hypot(way[0], way[1]) > _LEAST_SMEAR else 1
    derivatives = np.empty(_PARAMETERS)
    normal[:] = 0.0
    right[:] = 0.0
    squares = count = 0.0
    for row in range(max(int(y0 - reach), 0), min(int(y0 + reach) + 2, height)):
        for column in range(max(int(x0 - reach), 0), min(int(x0 + reach) + 2, width)):
            x, y = column - x0, row - y0
            weight = min(max(reach - math.hypot(x, y) + 0.5, 0.0), 1.0)
            if weight == 0.0:
                continue
            cover = by_x = by_y = by_radius = by_blur = 0.0
            for k in range(places):
                share = (k - (places - 1) / 2) / places
                across, up = x - share * way[0], y - share * way[1]
                distance = max(math.hypot(across, up), 1e-9)
                beyond = (distance - radius) / blur
                if beyond < -4.0:
                    cover += 1.0
                elif beyond < 4.0:
                    cover += 0.5 * math.erfc(beyond * 0.7071067811865476)
                    edge = math.exp(-0.5 * beyond * beyond) * 0.3989422804014327
                    edge /= blur * places
                    by_radius += edge
                    by_blur += edge * beyond
                    by_x += edge * across / distance
                    by_y += edge * up / distance
            cover /= places
            lit = 1.0 + by_column * x + by_row * y
            bare = white - contrast * cover
            derivatives[0], derivatives[1] = lit, -cover * lit
            derivatives[2], derivatives[3] = bare * x, bare * y
            derivatives[4] = -contrast * by_x * lit - bare * by_column
            derivatives[5] = -contrast * by_y * lit - bare * by_row
            derivatives[6] = -contrast * by_radius * lit
            derivatives[7] = -contrast * by_blur * lit
            left = float(grey[row, column]) - bare * lit
            squares += weight * left * left
            count += weight
            for i in range(_PARAMETERS):
                weighted = weight * derivatives[i]
                right[i] += weighted * left
                for j in range(i + 1):
                    normal[i, j] += weighted * derivatives[j]
    for i in range(_PARAMETERS):
        normal[i, i] *= 1.0 + 1e-9
        for j in range(i):
            normal[j, i] = normal[i, j]
    return squares, count


@compiled(TABLE, ROW)
def solve_loop(matrix: Array, right: Array) -> None:
    """Solve a symmetric positive system in place by elimination; `right` becomes the solution."""
    size = len(right)
    for i in range(size):
        pivot = max(matrix[i, i], 1e-12)
        for j in range(i + 1, size):
            factor = matrix[j, i] / pivot
            for k in range(i, size):
                matrix[j, k] -= factor * matrix[i, k]
            right[j] -= factor * right[i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= max(matrix[i, i], 1e-12)


@compiled(READ_PICTURE, TABLE, NUMBER, NUMBER, TABLE, TABLE)
def fit_loop(
    grey: NDArray[np.uint8], starts: Array, radius: float, reach: float, ways: Array, found: Array
) -> None:
    """Fill rows of place, white, contrast, covariance (xx, xy, yy) and misfit."""
    state, right = np.empty(_PARAMETERS), np.empty(_PARAMETERS)
    normal = np.empty((_PARAMETERS, _PARAMETERS))
    for dot in range(len(starts)):
        begin_loop(grey, starts[dot], reach, state)
        state[6], state[7] = radius, _BLUR
        for _ in range(_ITERATIONS):
            normal_loop(grey, state, reach, ways[dot], normal, right)
            solve_loop(normal, right)
            length = math.hypot(right[4], right[5])
            share = min(1.0, _LONGEST_STEP / max(length, 1e-12))
            for n in range(4):
                state[n] += right[n]
            state[1] = max(state[1], 1.0)
            state[4] += share * right[4]
            state[5] += share * right[5]
            state[6] += share * right[6]
            state[6] = min(max(state[6], _RADII[0] * radius), _RADII[1] * radius)
            state[7] = min(max(state[7] + share * right[7], _BLURS[0]), _BLURS[1])
            if length < _SETTLED or not math.isfinite(length):
                break
        squares, count = normal_loop(grey, state, reach, ways[dot], normal, right)
        variance = squares / max(count - _PARAMETERS, 1.0)
        found[dot, 0], found[dot, 1] = state[4], state[5]
        found[dot, 2], found[dot, 3] = state[0], state[1]
        for n in range(2):
            second = normal.copy()
            right[:] = 0.0
            right[4 + n] = variance
            solve_loop(second, right)
            found[dot, 4 + n], found[dot, 5 + n] = right[4], right[5]
        found[dot, 7] = math.sqrt(variance)


@dataclass(frozen=True)
class FittedDots:
    """Dots of K places in a picture."""

    places: Array
    """Of their centres [pixels], shape (K, 2)."""
    covariances: Array
    """Of their places [pixels^2], shape (K, 2, 2)."""
    contrasts: Array
    """Of white and dot [grey levels], shape (K,)."""
    whites: Array
    """Of their labels [grey levels], shape (K,)."""
    misfits: Array
    """Root mean square of what the model leaves [grey levels], shape (K,)."""


def fit_dots(
    grey: NDArray[np.uint8], starts: Array, radius: float, label_radius: float, ways: Array
) -> FittedDots:
    """Fit dots near places, each with its way while it was exposed [pixels], (K, 2) each.

    All have the same radius, and so have their labels [pixels].
    """
    reach = min(max(label_radius - _CLEAR, radius + 0.5), radius + _BEYOND)
    found = np.empty((len(starts), 8))
    placed, ended = (np.array(each, dtype=np.float64, order='C') for each in (starts, ways))
    fit_loop(np.ascontiguousarray(grey), placed, radius, reach, ended, found)
    covariances = found[:, [4, 5, 5, 6]].reshape(-1, 2, 2)
    return FittedDots(found[:, :2], covariances, found[:, 3], found[:, 2], found[:, 7])
