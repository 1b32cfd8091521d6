# SPDX-License-Identifier: Apache-2.0
"""Least-squares fit of dots to pixels, with the covariances of the centres.

A dot is dark and lies in the middle of a white disc, the label. A model of a dot, with centre p
and radius R, is fitted to the grey levels I of the pixels x:

    I(x) = (1 + g (x - p)) (w - c T(x - p)),
    T(y) = mean_k erfc((|S (y - s_k)| - R) / (b sqrt 2)) / 2,

with the grey level w of the label, the contrast c, the gradient g of the light, and the blur b. T
is the fraction of a pixel that the dot covers. The offsets s_k are points on the path of the dot
during the exposure. The matrix S, of determinant 1, maps the ellipse of the dot to a circle.
Pixels at the edge of the label are excluded, because they would bias the centre.

The edge of a real dot differs from the model, because blur and grey scale have other shapes. This
difference depends on the distance from the edge. It contributes to the residuals, but hardly
shifts the centre. The noise of the pixels also depends on this distance, because a camera
amplifies the noise of dark pixels more than the noise of bright ones (gamma curve). For the
covariance, the variance of a pixel is therefore the scatter of residuals at equal distances.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from soliton_linkage.compiling import b1, compiled, const_u1_2d, f8_1d, f8_2d, f8_3d, inlined
from soliton_linkage.linkage.chain import Array

_BLUR = 0.6
"""Initial value of the blur of an edge [pixels], typical of lenses and pixels."""
_BLURS = (0.35, 1.5)
"""Smallest and largest fitted blur [pixels], for a perfect lens and for a bad lens."""
_RADII = (0.7, 1.4)
"""Smallest and largest fitted radius of a dot, relative to the expected radius [1]."""
_PARAMETERS = 8
"""Number of fitted parameters: w, c, g (2), p (2), R and b."""
_ANGULAR = 4
"""Number of fitted parameters that change pixels differently in a ring: g (2) and p (2)."""
_LABEL_MARGIN = 1.4
"""Width of the excluded margin of a label [pixels]; it is more than twice `_BLUR`."""
_MAX_DISTANCE = 4.0
"""Only pixels up to this distance outside the edge of the dot are fitted [pixels]."""
_MAX_ITERATIONS = 6
"""Largest number of iterations [1]; it suffices for initial errors of less than a pixel."""
_TOLERANCE = 3e-4
"""The fit ends when a step of the centre is below this [pixels]. The remaining error is then less
than 1 % of the error due to pixel noise."""
_MAX_STEP = 0.7
"""Longest step of the centre [pixels]; over longer steps, the model is not linear."""
_OFFSETS = 5
"""Number of offsets s_k along the path of a moving dot."""
_HALF_WIDTH = 4.0
"""Largest distance from an edge in the tables [multiples of the blur]; farther away, a pixel
counts as covered or free, with an error of 3e-5."""
_STEPS = 64
"""Number of table points per distance of one blur; interpolation errors are below 1e-5."""
_DISTANCES = np.arange(2 * int(_HALF_WIDTH) * _STEPS + 1) / _STEPS - _HALF_WIDTH
"""Distances from an edge at the points of the tables, in units of the blur [1]."""
_COVERS: Array = erfc(_DISTANCES / math.sqrt(2)) / 2
"""Fraction of a pixel that a blurred dot covers at each of `_DISTANCES` [1]."""
_EDGES: Array = np.exp(-(_DISTANCES**2) / 2) / math.sqrt(2 * math.pi)
"""Negative derivative of the covered fraction by the distance [1]."""
_RINGS, _RING_WIDTH = 12, 0.5
"""Number of rings around the centre in which residuals are compared [1], and width of a ring
[pixels]. The rings cover distances of 3 pixels on both sides of the edge of the dot."""
_MIN_SMEAR = 0.3
"""A dot counts as resting if its motion during the exposure is smaller than this [pixels]."""


@compiled(const_u1_2d, f8_1d, f8_1d)
def begin_loop(grey: NDArray[np.uint8], dot: Array, state: Array) -> None:
    """Set the initial parameters `state` from the lightest and darkest pixels near the dot."""
    x0, y0, radius, reach = dot[:4]
    height, width = grey.shape
    low, high = 255.0, 0.0
    for row in range(max(int(y0 - reach), 0), min(int(y0 + reach) + 2, height)):
        for column in range(max(int(x0 - reach), 0), min(int(x0 + reach) + 2, width)):
            value = float(grey[row, column])
            if (column - x0) ** 2 + (row - y0) ** 2 <= reach * reach:
                low, high = min(low, value), max(high, value)
    state[:] = (high, max(high - low, 1.0), 0.0, 0.0, x0, y0, radius, _BLUR)


@inlined
def cover_of_dot(
    x: float, y: float, offsets: int, dot: Array, radius: float, blur: float
) -> tuple[float, float, float, float, float]:
    """Return the covered fraction T of a pixel, and its derivatives by dot centre, R and b.

    The pixel is at (x, y) from the centre of the dot. `offsets` is the number of offsets s_k.
    """
    sxx, sxy, syx, syy, smear_x, smear_y = dot[4:]
    cover = by_x = by_y = by_radius = by_blur = 0.0
    for k in range(offsets):
        share = (k - (offsets - 1) / 2) / offsets
        right_of, below = x - share * smear_x, y - share * smear_y
        across = sxx * right_of + sxy * below
        up = syx * right_of + syy * below
        distance = max(math.sqrt(across * across + up * up), 1e-9)
        beyond = (distance - radius) / blur
        if beyond < -_HALF_WIDTH:
            cover += 1.0
        elif beyond < _HALF_WIDTH:
            step = int((beyond + _HALF_WIDTH) * _STEPS)
            part = (beyond + _HALF_WIDTH) * _STEPS - step
            cover += _COVERS[step] + part * (_COVERS[step + 1] - _COVERS[step])
            edge = _EDGES[step] + part * (_EDGES[step + 1] - _EDGES[step])
            edge /= blur * offsets
            by_radius += edge
            by_blur += edge * beyond
            by_x += edge * (across * sxx + up * syx) / distance
            by_y += edge * (across * sxy + up * syy) / distance
    return cover / offsets, by_x, by_y, by_radius, by_blur


@inlined
def model_of_pixel(
    x: float, y: float, offsets: int, dot: Array, state: Array, derivatives: Array
) -> float:
    """Return the grey level of the model, and store its derivatives by the parameters.

    For x, y and `offsets`, see `cover_of_dot`.
    """
    white, contrast, by_column, by_row, _, _, radius, blur = state
    cover, by_x, by_y, by_radius, by_blur = cover_of_dot(x, y, offsets, dot, radius, blur)
    lit = 1.0 + by_column * x + by_row * y
    bare = white - contrast * cover
    derivatives[0], derivatives[1] = lit, -cover * lit
    derivatives[2], derivatives[3] = bare * x, bare * y
    derivatives[4] = -contrast * by_x * lit - bare * by_column
    derivatives[5] = -contrast * by_y * lit - bare * by_row
    derivatives[6] = -contrast * by_radius * lit
    derivatives[7] = -contrast * by_blur * lit
    return float(bare * lit)


@compiled(const_u1_2d, f8_1d, f8_1d, f8_2d, f8_1d, f8_3d, f8_2d, b1)
def normal_loop(
    grey: NDArray[np.uint8],
    state: Array,
    dot: Array,
    normal: Array,
    right: Array,
    squared: Array,
    rings: Array,
    last: bool,
) -> tuple[float, float]:
    """Compute the normal equations; return the sums of weighted squared residuals and of weights.

    The weight of a pixel is 1 in the fitted area, and decreases to 0 within one pixel at the edge
    of this area. The equations are stored in `normal` and `right`. If `last`, the same matrix with
    squared weights is stored in `squared` for each ring, for the covariance. The columns of
    `rings` then contain the sums of weights, of weighted residuals and of weighted squared
    residuals in each ring.
    """
    height, width = grey.shape
    x0, y0, radius, reach = state[4], state[5], state[6], dot[3]
    sxx, sxy, syx, syy, smear_x, smear_y = dot[4:]
    offsets = _OFFSETS if math.hypot(smear_x, smear_y) > _MIN_SMEAR else 1
    derivatives = np.empty(_PARAMETERS)
    whole = sxx * sxx + sxy * sxy + syx * syx + syy * syy
    # Semi-major axis sigma of an ellipse of area pi, from sigma^2 + 1 / sigma^2 = whole.
    box = reach * math.sqrt((whole + math.sqrt(max(whole * whole - 4.0, 0.0))) / 2)
    normal[:] = 0.0
    right[:] = 0.0
    if last:
        squared[:] = 0.0
        rings[:] = 0.0
    squares = count = 0.0
    for row in range(max(int(y0 - box), 0), min(int(y0 + box) + 2, height)):
        for column in range(max(int(x0 - box), 0), min(int(x0 + box) + 2, width)):
            x, y = column - x0, row - y0
            away = math.sqrt((sxx * x + sxy * y) ** 2 + (syx * x + syy * y) ** 2)
            weight = min(max(reach - away + 0.5, 0.0), 1.0)
            if weight == 0.0:
                continue
            modelled = model_of_pixel(x, y, offsets, dot, state, derivatives)
            left = float(grey[row, column]) - modelled
            squares += weight * left * left
            count += weight
            ring = min(max(int((away - radius) / _RING_WIDTH + _RINGS / 2), 0), _RINGS - 1)
            if last:
                rings[ring, 0] += weight
                rings[ring, 1] += weight * left
                rings[ring, 2] += weight * left * left
            for i in range(_PARAMETERS):
                weighted = weight * derivatives[i]
                right[i] += weighted * left
                for j in range(i, _PARAMETERS):
                    normal[i, j] += weighted * derivatives[j]
                    if last:
                        squared[ring, i, j] += weight * weighted * derivatives[j]
    for i in range(_PARAMETERS):
        normal[i, i] *= 1.0 + 1e-9
    return squares, count


@compiled(f8_2d, f8_1d)
def solve_loop(matrix: Array, right: Array) -> None:
    """Solve a positive definite system from its upper triangle; the solution replaces `right`."""
    size = len(right)
    for i in range(size):
        pivot = max(matrix[i, i], 1e-12)
        for j in range(i + 1, size):
            factor = matrix[i, j] / pivot
            for k in range(j, size):
                matrix[j, k] -= factor * matrix[i, k]
            right[j] -= factor * right[i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= max(matrix[i, i], 1e-12)


@inlined
def replace_by_variances(rings: Array, count: float) -> None:
    """Set the first column of `rings` to the variance of the pixels in each ring [grey levels^2].

    `count` is the sum of all weights. The mean residuals of the rings replace the parameters w, c,
    R and b. A ring of few pixels also contains one pixel with the mean variance of all rings.
    """
    total = means = 0.0
    for ring in range(_RINGS):
        weights = max(rings[ring, 0], 1e-12)
        rings[ring, 2] = max(rings[ring, 2] - rings[ring, 1] ** 2 / weights, 0.0)
        total += rings[ring, 2]
        means += min(weights, 1.0)
    freedom = max(count - means, 1.0)
    lost = freedom / max(freedom - _ANGULAR, 1.0)
    for ring in range(_RINGS):
        variance = (rings[ring, 2] + total / freedom) / max(rings[ring, 0], 1.0)
        rings[ring, 0] = lost * variance


@compiled(const_u1_2d, f8_2d, f8_2d)
def fit_loop(grey: NDArray[np.uint8], dots: Array, found: Array) -> None:
    """Fit dots and store the results in `found`; both have one row per dot.

    A row of `dots` contains the initial centre (2), the radius, the radius of the fitted area, S
    (4), and the displacement during the exposure (2). A row of `found` contains the centre (2),
    the grey level of the label, the contrast, the covariance (xx, xy, yy) and the residual.
    """
    state, right = np.empty(_PARAMETERS), np.empty(_PARAMETERS)
    normal = np.empty((_PARAMETERS, _PARAMETERS))
    squared, scratch = np.empty((_RINGS, _PARAMETERS, _PARAMETERS)), np.empty_like(normal)
    columns, rings = np.empty((2, _PARAMETERS)), np.empty((_RINGS, 3))
    for n in range(len(dots)):
        dot = dots[n]
        begin_loop(grey, dot, state)
        for _ in range(_MAX_ITERATIONS):
            normal_loop(grey, state, dot, normal, right, squared, rings, False)
            solve_loop(normal, right)
            length = math.hypot(right[4], right[5])
            share = min(1.0, _MAX_STEP / max(length, 1e-12))
            for i in range(_PARAMETERS):
                state[i] += right[i] if i < 4 else share * right[i]
            state[1] = max(state[1], 1.0)
            state[6] = min(max(state[6], _RADII[0] * dot[2]), _RADII[1] * dot[2])
            state[7] = min(max(state[7], _BLURS[0]), _BLURS[1])
            if length < _TOLERANCE or not math.isfinite(length):
                break
        squares, count = normal_loop(grey, state, dot, normal, right, squared, rings, True)
        replace_by_variances(rings, count)
        found[n, 0], found[n, 1] = state[4], state[5]
        found[n, 2], found[n, 3] = state[0], state[1]
        # Covariance for weights W and variances V: N^-1 (A W V W A) N^-1 with N = A W A.
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
                    for ring in range(_RINGS):
                        part = rings[ring, 0] * squared[ring, min(i, j), max(i, j)]
                        total += one[i] * part * other[j]
            found[n, 4 + k] = total
        found[n, 7] = math.sqrt(squares / max(count - _PARAMETERS, 1.0))


@dataclass(frozen=True)
class FittedDots:
    """Centres [pixels], (K, 2), of K fitted dots, with covariances and grey levels."""

    centres: Array
    covariances: Array
    """Covariances of the centres [pixels^2], (K, 2, 2)."""
    contrasts: Array
    """Differences between the grey levels of labels and of dots, (K,)."""
    whites: Array
    """Grey levels of the labels, (K,)."""
    residuals: Array
    """Root mean square residuals [grey levels], (K,)."""


def fit_dots(
    grey: NDArray[np.uint8], starts: Array, outlines: Array, dot_share: float, smears: Array
) -> FittedDots:
    """Fit K dots near the positions `starts` [pixels], (K, 2).

    `smears`, (K, 2), are the displacements of the dots during the exposure [pixels]. `outlines`,
    (K, 2, 2), are the matrices that map the outline of each dot to the unit circle [1/pixel].
    `dot_share` is the radius of a dot divided by the radius of its label [1].
    """
    radii = 1 / np.sqrt(np.abs(np.linalg.det(outlines)))
    shapes = (radii[:, None, None] * outlines).reshape(-1, 4)
    reaches = np.minimum(
        np.maximum(radii / dot_share - _LABEL_MARGIN, radii + 0.5), radii + _MAX_DISTANCE
    )
    found = np.empty((len(starts), 8))
    dots = np.column_stack([starts, radii, reaches, shapes, smears])
    fit_loop(np.ascontiguousarray(grey), dots, found)
    covariances = found[:, [4, 5, 5, 6]].reshape(-1, 2, 2)
    return FittedDots(found[:, :2], covariances, found[:, 3], found[:, 2], found[:, 7])
