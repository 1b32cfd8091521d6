# SPDX-License-Identifier: Apache-2.0
"""Unit cell: two rotors and the bar between them form a four-bar linkage of one degree of freedom.

Let theta_1 and theta_2 be the staggered angles of the left and the right rotor: theta = phi for an
even rotor, and theta = pi - phi for an odd one. The bar has its rest length if

    cos(theta_1 + theta_2) - cos(2 theta_bar) + (a / r) (sin(theta_2) - sin(theta_1)) = 0

with the rest angle theta_bar, the spacing a and the rotor length r (paper, eq. flip_discrete with
the opposite sign of a / r). With the mean s = (theta_1 + theta_2) / 2 and the half difference
delta = (theta_2 - theta_1) / 2, the condition becomes

    sin(delta) = (r / a) (cos(theta_bar)^2 / cos(s) - cos(s)).

Two symmetries map each solution to another solution. The first is s -> -s, that is (theta_1,
theta_2) -> (-theta_2, -theta_1). The second is delta -> pi - delta, that is (theta_1, theta_2) ->
(theta_2 - pi, theta_1 + pi). A full turn of one rotor changes s by pi. For the sign of s, turns
are added so that -pi / 2 < s < pi / 2; s then has the sign of sin(theta_1 + theta_2). If the lean
ratio d is above its critical value d_c, no solution has s = 0. The solutions with s > 0 and s < 0
are then two separate components, and the cell is a spinner (paper, 'Phase diagram', fig. 4). The
condition d > d_c is equivalent to r sin(theta_bar)^2 > a, and to lbar < 2 r - a for the rest
length lbar of the bar. Deviations of single rotors and springs are ignored.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from soliton_linkage.linkage.chain import Array, Chain, Motion

Integers = NDArray[np.int64]

_ARC_TOLERANCE = 1e-12
"""Tolerance of the integration along a curve [rad]; for d near d_c, rounding errors are larger."""
_CLOSED = 1e-6
"""A curve is closed if the difference of its ends is a whole number of turns to within this
[turns]."""


def partner_angles(chain: Chain, theta_1: ArrayLike) -> Array:
    """Return both angles theta_2 [rad] that are possible for each theta_1 [rad], shape (..., 2).

    If no theta_2 is possible, both are NaN.

    The bar has its rest length if p cos(theta_2) + q sin(theta_2) = g with p = r cos(theta_1), q =
    a - r sin(theta_1) and g = r cos(2 theta_bar) + a sin(theta_1). The solutions are atan2(q, p)
    -+ atan2(sqrt(p^2 + q^2 - g^2), g). The radicand is evaluated as the product

        p^2 + q^2 - g^2 = (lbar - 2 r cos(theta_bar)^2 - a sin(theta_1))
                          (lbar + 2 r cos(theta_bar)^2 + a sin(theta_1)).

    The first factor is 0 if d = d_c and theta_1 = pi / 2. Near these values the factor is computed
    without cancellation of digits.
    """
    factor, partners = _partners(chain, np.asarray(theta_1, dtype=np.float64))
    return np.where(factor[..., None] >= 0, partners, np.nan)


def configuration_curves(chain: Chain, points: int = 400) -> tuple[Array, ...]:
    """Return the components of the cell's configuration space as closed curves on the torus.

    Each curve has shape (points + 1, 2) and contains continuous staggered angles (theta_1,
    theta_2) [rad] in equal steps of arc length. A flipper has one contractible curve, which begins
    at s = 0 and passes first through the right-leaning states. A spinner has two curves. Along
    each of them theta_1 increases by one turn and theta_2 decreases by one turn. On the first
    curve sin(theta_1 + theta_2) is positive.
    """
    pieces = 2 if chain.motion is Motion.SPINNER else 4
    pieces_done = np.linspace(0, pieces, points + 1)
    piece = np.minimum(pieces_done.astype(np.int64), pieces - 1)
    share = pieces_done - piece
    quarter = _Arc(chain).configurations(np.where(piece % 2, 1 - share, share))
    swapped = quarter[:, ::-1] + np.array([-np.pi, np.pi])
    curve = np.where(((piece == 1) | (piece == 2))[:, None], swapped, quarter)
    if pieces == 2:
        return curve[::-1].copy(), -curve[::-1, ::-1]
    return (np.where((piece >= 2)[:, None], -curve[:, ::-1], curve),)


def windings(curve: ArrayLike) -> tuple[int, int]:
    """Return the winding numbers of theta_1 and theta_2 along a closed curve [rad], shape (K, 2).

    The winding numbers are (0, 0) for flippers and (1, -1) for spinners. Raises ValueError if the
    curve is not closed.
    """
    followed = np.asarray(curve, dtype=np.float64)
    turns = (followed[-1] - followed[0]) / (2 * np.pi)
    counts = np.round(turns)
    if np.abs(turns - counts).max() > _CLOSED:
        raise ValueError(
            f'the ends of the curve differ by {turns[0]:.6g} and {turns[1]:.6g} turns; give a '
            'closed curve whose last configuration equals the first'
        )
    return int(counts[0]), int(counts[1])


def ground_states(chain: Chain) -> Array:
    """Return the staggered angles (theta, theta) of the uniform states [rad], shape (4, 2).

    The state theta = theta_bar leans right, and -theta_bar leans left. In the states pi -
    theta_bar and pi + theta_bar the cell is upside down.
    """
    angle = chain.rest_angle
    return np.repeat([angle, -angle, math.pi - angle, math.pi + angle], 2).reshape(4, 2)


def component_of(chain: Chain, configurations: ArrayLike) -> Integers:
    """Return for each configuration the index of its curve in `configuration_curves`.

    The configurations have shape (..., 2), the indices shape (...). For flippers the index is 0.
    For spinners it is 0 if sin(theta_1 + theta_2) >= 0, as in the uniform states theta_bar and pi
    + theta_bar, otherwise 1.
    """
    given = np.asarray(configurations, dtype=np.float64)
    if chain.motion is not Motion.SPINNER:
        return np.zeros(given.shape[:-1], dtype=np.int64)
    return np.asarray(np.sin(given.sum(axis=-1)) < 0, dtype=np.int64)


def flipper_limit(rest_angles: ArrayLike) -> Array:
    """Return 1 / (2 sin(theta_bar)), the ratio r / a above which flippers wobble (d > 1)."""
    return np.asarray(0.5 / np.sin(np.asarray(rest_angles)))


def spinner_limit(rest_angles: ArrayLike) -> Array:
    """Return 1 / sin(theta_bar)^2, the ratio r / a above which chains are spinners (d > d_c)."""
    return np.asarray(1 / np.sin(np.asarray(rest_angles)) ** 2)


class _Arc:
    """Piece of a configuration curve with s >= 0 and |delta| <= pi / 2, as a function of theta_2.

    The symmetries in the module docstring give the rest of the curve.
    """

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        r, a, lbar = chain.rotor_length, chain.spacing, chain.rest_length
        widest = math.acos(2 * r * math.cos(chain.rest_angle) ** 2 / (lbar + a))
        if chain.motion is Motion.SPINNER:
            narrowest = 2 * math.asin(math.sqrt(_excess(chain) / (2 * r - a + lbar)))
            start = narrowest - math.pi / 2
        else:
            start = -math.asin(min(r / a * math.sin(chain.rest_angle) ** 2, 1.0))
        self._ends = (start, widest + math.pi / 2)

    def configurations(self, shares: Array) -> Array:
        start = self._ends[0]
        lengths = _solved(
            lambda theta_2, arc: 1 / self._rate(np.full_like(arc, theta_2)), self._ends, 0.0
        )
        length = float(lengths.y[0, -1])
        along = _solved(lambda _, theta_2: self._rate(theta_2), (0.0, length), start).sol
        theta_2 = np.clip(along(shares * length)[0], *self._ends)
        return np.stack([self._theta_1(theta_2), theta_2], axis=-1)

    def _theta_1(self, theta_2: Array) -> Array:
        return -_partners(self._chain, -theta_2)[1][..., 0]

    def _rate(self, theta_2: Array) -> Array:
        chain = self._chain
        theta_2 = np.clip(theta_2, *self._ends)
        theta_1 = self._theta_1(theta_2)
        common = chain.rotor_length * np.sin(theta_1 + theta_2)
        first = np.abs(common + chain.spacing * np.cos(theta_1))
        second = np.abs(common - chain.spacing * np.cos(theta_2))
        slope = np.minimum(second, first) / np.maximum(first, np.finfo(np.float64).tiny)
        return np.asarray(1 / np.sqrt(1 + slope**2))


def _solved(rate: Callable[..., Array], span: tuple[float, float], start: float) -> Any:
    tolerances = {'rtol': _ARC_TOLERANCE, 'atol': _ARC_TOLERANCE}
    return solve_ivp(rate, span, [start], method='DOP853', dense_output=True, **tolerances)


def _partners(chain: Chain, theta_1: Array) -> tuple[Array, Array]:
    """Return the first factor of the radicand in `partner_angles` [m], and both solutions."""
    r, a, lbar = chain.rotor_length, chain.spacing, chain.rest_length
    sine, cosine = np.sin(theta_1), np.cos(theta_1)
    height = 2 * r * math.cos(chain.rest_angle) ** 2
    narrowest = 4 * r * height * _excess(chain) / ((lbar + a) * (2 * r - a + lbar))
    first = narrowest + 2 * a * np.sin(np.pi / 4 - theta_1 / 2) ** 2
    root = np.sqrt(np.maximum(first, 0) * (lbar + height + a * sine))
    towards = np.arctan2(a - r * sine, r * cosine)
    away = np.arctan2(root, r * math.cos(2 * chain.rest_angle) + a * sine)
    return first, np.stack([towards - away, towards + away], axis=-1)


def _excess(chain: Chain) -> float:
    """Return r sin(theta_bar)^2 - a [m], which is at least 0 for spinners and at most 0 otherwise.

    If rounding errors give a sign that contradicts the motion class of the chain, return 0.
    """
    excess = chain.rotor_length * math.sin(chain.rest_angle) ** 2 - chain.spacing
    spinner = chain.motion is Motion.SPINNER
    return max(excess, 0.0) if spinner else min(excess, 0.0)
