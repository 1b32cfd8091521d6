# SPDX-License-Identifier: Apache-2.0
"""Coefficients of the symmetric multistep method of `multistep_steps`."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from soliton_linkage.linkage.chain import Array

ORDER = 10
"""The error of a step of length h goes as h^12."""
STABLE_STEP = 0.63
"""Longest step in units of 1 / omega; vibrations of frequency omega stay bounded up to 0.649."""

STARTING_STEPS = 9
"""Steps of another method that make the past that this one needs."""

MEMORY = 16
"""Rows of w, of which 8 are needed; row n & 15 has w_n."""

REMEMBERED = 10
"""Kicks before the last one that the error is made of."""

AHEAD = 5
"""How many steps the last one is ahead of the state that is told, which both sides give."""

_TWICE_COSINES = Fraction(-9, 8), Fraction(-5, 8), Fraction(5, 8), Fraction(15, 16)
"""2 cos psi_k; numbers that floats have exactly, so that the turn of free rotors is constant."""


def _product(*polynomials: list[Fraction]) -> list[Fraction]:
    product = [Fraction(1)]
    for polynomial in polynomials:
        longer = [Fraction(0)] * (len(product) + len(polynomial) - 1)
        for i, left in enumerate(product):
            for j, right in enumerate(polynomial):
                longer[i + j] += left * right
        product = longer
    return product


def _moment(coefficients: list[Fraction], power: int) -> Fraction:
    """Sum over j of coefficients c_j (j - middle)^power / power!."""
    middle = len(coefficients) // 2
    total = sum((c * (j - middle) ** power for j, c in enumerate(coefficients)), Fraction(0))
    return total / math.factorial(power)


def _solved(rows: list[list[Fraction]], values: list[Fraction]) -> list[Fraction]:
    """Solution of linear equations, without pivots."""
    system = [[*row, value] for row, value in zip(rows, values, strict=True)]
    for i, row in enumerate(system):
        row[:] = [entry / row[i] for entry in row]
        for other in system:
            if other is not row:
                factor = other[i]
                other[:] = [a - factor * b for a, b in zip(other, row, strict=True)]
    return [row[-1] for row in system]


def _coefficients() -> tuple[list[Fraction], list[Fraction], float]:
    """The q_j, the b_j, and the error of a step over h^12 d^12 x / dt^12.

    With x(t) = e^t, sum_j q_j [x(j + 1) - 2 x(j) + x(j - 1)] = sum_j b_j x''(j), j from -4 to 4,
    has to hold up to the power 10 of the time.
    """
    one = Fraction(1)
    recursion = _product(*([one, -c, one] for c in _TWICE_COSINES))
    left = _product(recursion, [one, Fraction(-2), one])
    powers = range(0, ORDER - 1, 2)
    rows = [[_moment(_pair(j), power) for j in range(ORDER // 2)] for power in powers]
    half = _solved(rows, [_moment(left, power + 2) for power in powers])
    response = [half[abs(j)] for j in range(-4, 5)]
    missing = _moment(left, ORDER + 2) - _moment(response, ORDER)
    scale = sum(recursion)
    return recursion, response, float(missing / scale)


def _pair(j: int) -> list[Fraction]:
    """1 at both -j and j of -4 to 4."""
    return [Fraction(abs(place) == j) for place in range(-4, 5)]


def _floats(values: list[Fraction]) -> Array:
    return np.array([float(value) for value in values])


_RECURSION, _RESPONSE, ERROR = _coefficients()
"""The q_j, the b_j, and what tenth differences of the kicks are multiplied by."""

RECURSION, RESPONSE = _floats(_RECURSION), _floats(_RESPONSE)

DIFFERENCE = np.array([float((-1) ** j * math.comb(10, j)) for j in range(11)])
"""Tenth difference of numbers in a row."""


def _recalling() -> Array:
    """w_1 to w_8 from the changes of the turns 1 to 8 and the kicks 1 to 8, shape (8, 16)."""
    # Columns: what w_-7 to w_0, and then the kicks 1 to 8, make of w_-7 to w_8.
    memory = np.zeros((16, 16))
    memory[:8, :8] = np.eye(8)
    changes = np.zeros((8, 16))
    for n in range(8):
        kick = np.eye(16)[8 + n]
        memory[8 + n] = kick - RECURSION[1:] @ memory[n : 8 + n][::-1]
        changes[n] = RESPONSE @ memory[n : 9 + n][::-1]
    of_changes = np.linalg.solve(changes[:, :8], np.eye(8))
    of_kicks = -of_changes @ changes[:, 8:]
    later = memory[8:]
    return np.hstack([later[:, :8] @ of_changes, later[:, :8] @ of_kicks + later[:, 8:]])


RECALLING = _recalling()
"""w_1 to w_8 from the changes of the turns 1 to 8 and the kicks 1 to 8."""


def _bubbles() -> Array:
    """Coefficients of 1 to s^11 of the W_j of `interpolating`, shape (12, 10)."""
    nodes = np.arange(1 - AHEAD, 1 + AHEAD, dtype=np.float64)
    polynomials = []
    for node in nodes:
        others = nodes[nodes != node]
        acceleration = np.poly1d(np.poly(others) / np.prod(node - others))
        whole = acceleration.integ(2)
        # Its first integrals vanish at 0; the cubic takes its value and slope at 1 away.
        value, slope = whole(1), whole.deriv()(1)
        polynomials.append((whole - np.poly1d([slope - 2 * value, 3 * value - slope, 0, 0])).c)
    return np.array(polynomials).T[::-1]


_BUBBLES = _bubbles()


def interpolating(places: Array) -> tuple[Array, Array]:
    """Weights for angles and, times h, for rates at places from 0 to 1 between instants.

    Columns are of the angles at both ends, of h times the rates there, and of the kicks of ten
    instants around. But for a cubic, accelerations are the polynomial of degree 9 through these,

        x(s) = cubic that meets angles and rates + sum_j W_j(s) h^2 a_j,

    whose W_j vanish at both ends with their slopes. Two arrays of shape (places, 14).
    """
    s = places[:, np.newaxis]
    powers = np.arange(12)
    slopes = powers[1:] * s ** powers[:-1]
    angles = (1 + 2 * s) * (1 - s) ** 2, s**2 * (3 - 2 * s), s * (1 - s) ** 2, s**2 * (s - 1)
    rates = 6 * s * (s - 1), 6 * s * (1 - s), (1 - s) * (1 - 3 * s), s * (3 * s - 2)
    return np.hstack([*angles, s**powers @ _BUBBLES]), np.hstack([*rates, slopes @ _BUBBLES[1:]])


def _smoothing() -> tuple[Array, Array]:
    """Weights of ten turns and eleven kicks in the angles and rates that are told.

    Rows are of x_n - X_n, changed in sign, and of h times the rate; columns of the turns from
    n - 5 to n + 4, and of the kicks from n - 5 to n + 5. Where the method vibrates by itself,
    angles are multiples of e^(i psi_k n), which vanish in means that are weighted with the q_j;
    what these change in polynomials up to degree 12 the kicks put right.
    """
    places = range(-AHEAD, AHEAD + 1)
    share = {j: q / sum(_RECURSION) for j, q in zip(range(-4, 5), _RECURSION, strict=True)}
    none = Fraction(0)
    turns = [
        [
            sum((s for j, s in share.items() if j > i), none)
            if i >= 0
            else -sum((s for j, s in share.items() if j <= i), none)
            for i in places[:-1]
        ],
        [(share.get(i, none) + share.get(i + 1, none)) / 2 for i in places[:-1]],
    ]
    powers = range(2, ORDER + 3)
    rows = [[Fraction(p * (p - 1) * j ** (p - 2)) for j in places] for p in powers]
    kicks = []
    for weights in turns:
        moments = [
            sum(
                (w * ((i + 1) ** p - i**p) for w, i in zip(weights, places[:-1], strict=True)),
                none,
            )
            for p in powers
        ]
        kicks.append(_solved(rows, [-moment for moment in moments]))
    return np.array([_floats(row) for row in turns]), np.array([_floats(row) for row in kicks])


OF_TURNS, OF_KICKS = _smoothing()
"""What turns and kicks add to the angle, and to h times the rate, that are told."""
