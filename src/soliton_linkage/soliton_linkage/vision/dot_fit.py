# SPDX-License-Identifier: Apache-2.0
"""Least-squares fit of dots to pixels, with the covariance of their places.

A dot of radius R at p is fitted, by least squares, to the pixels of its label:

    I(x) = (1 + g (x - p)) (w - c T(x - p)),
    T(y) = mean_k erfc((|S (y - s_k)| - R) / (b sqrt 2)) / 2,

white w, contrast c, gradient of the light g, blur b, and places s_k on its way during the
exposure; R and b are fitted too. The matrix S, of determinant 1, turns the ellipse of the image
into a circle. If the noise of all pixels is equal, the fit reaches the Cramer-Rao bound, and the
covariance of the place follows from the normal matrix. Pixels at the edge of the label do not
count, because the surroundings differ from side to side and would bias the place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from soliton_linkage.compiling import (
    b1,
    compile_loop,
    compiled,
    const_u1_2d,
    f8_1d,
    f8_2d,
)
from soliton_linkage.linkage.chain import Array

_BLUR = 0.6
"""First blur of an edge [pixels]: that of usual lenses and pixels."""
_BLURS = (0.35, 1.5)
"""Least and largest blur [pixels]: that of a pixel alone, and that of bad lenses."""
_RADII = (0.7, 1.4)
"""Least and largest radius of a dot over the expected one [1]."""
_PARAMETERS = 8
"""Number of parameters [1]: w, c, g (2), p (2), R and b."""
_CLEAR = 1.4
"""Margin of a label where pixels do not count [pixels], more than twice the blur."""
_BEYOND = 4.0
"""Distance from the edge of a dot beyond which pixels do not count [pixels]."""
_ITERATIONS = 6
"""Gauss-Newton iterations at most [1]: the first places are within a pixel."""
_SETTLED = 3e-4
"""Last step [pixels]: a third of it, a hundredth of the noise, remains as an error."""
_LONGEST_STEP = 0.7
"""Longest step of an iteration [pixels], within which the model is linear."""
_PLACES = 5
"""Places on the way of a dot during the exposure that are averaged [1]."""
_WIDEST = 4.0
"""Half width of an edge in deviations of the blur [1]: to 3e-5 of the contrast."""
_STEPS = 64
"""Steps of the tables of edges per deviation [1]: interpolation is exact to 1e-5."""
_AT = np.arange(2 * int(_WIDEST) * _STEPS + 1) / _STEPS - _WIDEST
"""Distances from an edge in the tables, in deviations of the blur [1]."""
_COVERS: Array = erfc(_AT / math.sqrt(2)) / 2
"""Shares of a dot at these distances from its blurred edge [1]."""
_EDGES: Array = np.exp(-(_AT**2) / 2) / math.sqrt(2 * math.pi)
"""Negative slopes of these shares [1]."""
_LEAST_SMEAR = 0.3
"""Way below which a dot counts as at rest [pixels]."""


@compiled(const_u1_2d, f8_1d, f8_1d)
def begin_loop(grey: NDArray[np.uint8], dot: Array, state: Array) -> None:
    """Set the first state of a fit by the lightest and darkest pixels within the reach."""
    start, reach = dot, dot[3]
    height, width = grey.shape
    low, high = 255.0, 0.0
    for row in range(max(int(start[1] - reach), 0), min(int(start[1] + reach) + 2, height)):
        for column in range(max(int(start[0] - reach), 0), min(int(start[0] + reach) + 2, width)):
            value = float(grey[row, column])
            if (column - start[0]) ** 2 + (row - start[1]) ** 2 <= reach * reach:
                low, high = min(low, value), max(high, value)
    state[0], state[1] = high, max(high - low, 1.0)
    state[2] = state[3] = 0.0
    state[4], state[5] = start[0], start[1]
    state[6], state[7] = dot[2], _BLUR


def _share_of_dot(
    x: float, y: float, places: int, dot: Array, radius: float, blur: float
) -> tuple[float, float, float, float, float]:
    """Return the share T of a dot in a pixel at x, y of it, and its derivatives by p, R and b."""
    sxx, sxy, syx, syy, right_way, down_way = dot[4:]
    cover = by_x = by_y = by_radius = by_blur = 0.0
    for k in range(places):
        share = (k - (places - 1) / 2) / places
        right_of, below = x - share * right_way, y - share * down_way
        across = sxx * right_of + sxy * below
        up = syx * right_of + syy * below
        distance = max(math.sqrt(across * across + up * up), 1e-9)
        beyond = (distance - radius) / blur
        if beyond < -_WIDEST:
            cover += 1.0
        elif beyond < _WIDEST:
            step = int((beyond + _WIDEST) * _STEPS)
            part = (beyond + _WIDEST) * _STEPS - step
            cover += _COVERS[step] + part * (_COVERS[step + 1] - _COVERS[step])
            edge = _EDGES[step] + part * (_EDGES[step + 1] - _EDGES[step])
            edge /= blur * places
            by_radius += edge
            by_blur += edge * beyond
            by_x += edge * (across * sxx + up * syx) / distance
            by_y += edge * (across * sxy + up * syy) / distance
    return cover / places, by_x, by_y, by_radius, by_blur


def _add_pixel(
    weight: float,
    left: float,
    derivatives: Array,
    normal: Array,
    right: Array,
    squared: Array,
    last: bool,
) -> None:
    """Add the residual of a weighted pixel to the normal equations."""
    for i in range(_PARAMETERS):
        weighted = weight * derivatives[i]
        right[i] += weighted * left
        for j in range(_PARAMETERS):
            normal[i, j] += weighted * derivatives[j]
        if last:
            for j in range(_PARAMETERS):
                squared[i, j] += weight * weighted * derivatives[j]


share_of_dot = compile_loop(_share_of_dot, inlined=True)
add_pixel = compile_loop(_add_pixel, inlined=True)


@compiled(const_u1_2d, f8_1d, f8_1d, f8_2d, f8_1d, f8_2d, b1)
def normal_loop(
    grey: NDArray[np.uint8],
    state: Array,
    dot: Array,
    normal: Array,
    right: Array,
    squared: Array,
    last: bool,
) -> tuple[float, float]:
    """Fill the normal equations; return the sums of squared residuals and of weights.

    The last time the matrix with squared weights is filled too.
    """
    height, width = grey.shape
    white, contrast, by_column, by_row, x0, y0, radius, blur = state
    reach = dot[3]
    sxx, sxy, syx, syy, right_way, down_way = dot[4:]
    places = _PLACES if math.hypot(right_way, down_way) > _LEAST_SMEAR else 1
    derivatives = np.empty(_PARAMETERS)
    whole = sxx * sxx + sxy * sxy + syx * syx + syy * syy
    # The longest half axis of the ellipse of area pi: sigma^2 + 1 / sigma^2 is the whole.
    box = reach * math.sqrt((whole + math.sqrt(max(whole * whole - 4.0, 0.0))) / 2)
    normal[:] = 0.0
    right[:] = 0.0
    if last:
        squared[:] = 0.0
    squares = count = 0.0
    for row in range(max(int(y0 - box), 0), min(int(y0 + box) + 2, height)):
        for column in range(max(int(x0 - box), 0), min(int(x0 + box) + 2, width)):
            x, y = column - x0, row - y0
            away = math.sqrt((sxx * x + sxy * y) ** 2 + (syx * x + syy * y) ** 2)
            weight = min(max(reach - away + 0.5, 0.0), 1.0)
            if weight == 0.0:
                continue
            cover, by_x, by_y, by_radius, by_blur = share_of_dot(x, y, places, dot, radius, blur)
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
            add_pixel(weight, left, derivatives, normal, right, squared, last)
    for i in range(_PARAMETERS):
        normal[i, i] *= 1.0 + 1e-9
    return squares, count


@compiled(f8_2d, f8_1d)
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


@compiled(const_u1_2d, f8_2d, f8_2d)
def fit_loop(grey: NDArray[np.uint8], dots: Array, found: Array) -> None:
    """Fit dots: rows of first place (2), radius, reach, S (xx, xy, yx, yy) and way (2).

    Fill rows of place (2), white, contrast, covariance (xx, xy, yy) and misfit.
    """
    state, right = np.empty(_PARAMETERS), np.empty(_PARAMETERS)
    normal = np.empty((_PARAMETERS, _PARAMETERS))
    squared, scratch = np.empty_like(normal), np.empty_like(normal)
    columns = np.empty((2, _PARAMETERS))
    for n in range(len(dots)):
        dot = dots[n]
        begin_loop(grey, dot, state)
        for _ in range(_ITERATIONS):
            normal_loop(grey, state, dot, normal, right, squared, False)
            solve_loop(normal, right)
            length = math.hypot(right[4], right[5])
            share = min(1.0, _LONGEST_STEP / max(length, 1e-12))
            for i in range(4):
                state[i] += right[i]
            state[1] = max(state[1], 1.0)
            state[4] += share * right[4]
            state[5] += share * right[5]
            state[6] += share * right[6]
            state[6] = min(max(state[6], _RADII[0] * dot[2]), _RADII[1] * dot[2])
            state[7] = min(max(state[7] + share * right[7], _BLURS[0]), _BLURS[1])
            if length < _SETTLED or not math.isfinite(length):
                break
        squares, count = normal_loop(grey, state, dot, normal, right, squared, True)
        variance = squares / max(count - _PARAMETERS, 1.0)
        found[n, 0], found[n, 1] = state[4], state[5]
        found[n, 2], found[n, 3] = state[0], state[1]
        # Of weighted pixels whose noise is the same: N^-1 (A W^2 A) N^-1 with N = A W A.
        for axis in range(2):
            scratch[:] = normal
            columns[axis] = 0.0
            columns[axis, 4 + axis] = 1.0
            solve_loop(scratch, columns[axis])
        for k in range(3):
            one, other = columns[k // 2], columns[(k + 1) // 2]
            total = 0.0
            for i in range(_PARAMETERS):
                for j in range(_PARAMETERS):
                    total += one[i] * squared[i, j] * other[j]
            found[n, 4 + k] = variance * total
        found[n, 7] = math.sqrt(variance)


@dataclass(frozen=True)
class FittedDots:
    """K dots that were fitted to a picture."""

    places: Array
    """Centres [pixels], shape (K, 2)."""
    covariances: Array
    """Covariances of the centres [pixels^2], shape (K, 2, 2)."""
    contrasts: Array
    """Differences of label and dot [grey levels], shape (K,)."""
    whites: Array
    """Brightnesses of the labels [grey levels], shape (K,)."""
    misfits: Array
    """Root mean square residuals [grey levels], shape (K,)."""


def fit_dots(
    grey: NDArray[np.uint8], starts: Array, outlines: Array, share: float, ways: Array
) -> FittedDots:
    """Fit dots near places, each with its way during the exposure [pixels], (K, 2) each.

    Outlines, (K, 2, 2), map the outline of each dot about its centre to the unit circle
    [1/pixel]. The radii of the dots are that share of those of their labels [1].
    """
    radii = 1 / np.sqrt(np.abs(np.linalg.det(outlines)))
    shapes = (radii[:, None, None] * outlines).reshape(-1, 4)
    reaches = np.minimum(np.maximum(radii / share - _CLEAR, radii + 0.5), radii + _BEYOND)
    found = np.empty((len(starts), 8))
    dots = np.column_stack([starts, radii, reaches, shapes, ways])
    fit_loop(np.ascontiguousarray(grey), dots, found)
    covariances = found[:, [4, 5, 5, 6]].reshape(-1, 2, 2)
    return FittedDots(found[:, :2], covariances, found[:, 3], found[:, 2], found[:, 7])
