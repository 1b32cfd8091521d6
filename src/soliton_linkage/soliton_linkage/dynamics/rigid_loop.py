# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of `rigid`, which says what they compute."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import READ, READ_TABLE, compiled
from soliton_linkage.dynamics.derivative_loop import (
    BY_COSINE,
    BY_SINE,
    DAMPINGS,
    HELD,
    INERTIAS,
    LENGTHS,
    SPACINGS,
)
from soliton_linkage.linear.rigidity import VANISHING
from soliton_linkage.linkage.chain import Array

_FLUSHED = -1100
"""Power of 2 below which nothing is left of a component [1]."""


@compiled(READ, READ_TABLE)
def mode_of_bars(angles: Array, rows: Array) -> Array:
    """Zero mode of unit length in the metric of the inertia [kg^(-1/2) m^(-1)], shape (N,).

    It is that of `linear.rigidity.zero_mode`, followed in numbers with an exponent of their own
    throughout; the rows are those of `derivative_loop`.
    """
    rotors = rows.shape[1]
    mode, exponents = np.empty(rotors), np.empty(rotors, np.int64)
    mode[0], exponents[0], largest, sign = 1.0, 0, 0, 1.0
    h_left = rows[LENGTHS, 0] * math.sin(angles[0])
    v_left = rows[LENGTHS, 0] * math.cos(angles[0])
    for n in range(1, rotors):
        h = rows[LENGTHS, n] * math.sin(angles[n])
        v = rows[LENGTHS, n] * math.cos(angles[n])
        across, up = rows[SPACINGS, n - 1] + (h - h_left), v - v_left
        first, second = h_left * up - v_left * across, v * across - h * up
        first = VANISHING if abs(first) < VANISHING else first
        second = VANISHING if abs(second) < VANISHING else second
        sign = -sign if second < 0 else sign
        mode[n], shift = math.frexp(-mode[n - 1] * first / second)
        exponents[n] = exponents[n - 1] + shift
        largest = max(largest, exponents[n])
        h_left, v_left = h, v
    mass = 0.0
    for n in range(rotors):
        mode[n] = math.ldexp(mode[n], max(exponents[n] - largest, _FLUSHED))
        mass += rows[INERTIAS, n] * mode[n] ** 2
    return mode * (sign / math.sqrt(mass))


@compiled(READ, READ_TABLE)
def derivative_of_bars(state: Array, rows: Array) -> Array:
    """Time derivative of (angles, speed, dissipated), of its shape."""
    rotors, speed = rows.shape[1], state[rows.shape[1]]
    mode = mode_of_bars(state[:rotors], rows)
    changes, power, friction = np.empty(state.size), 0.0, 0.0
    for n in range(rotors):
        changes[n] = speed * mode[n]
        by_gravity = rows[BY_SINE, n] * math.sin(state[n])
        by_gravity += rows[BY_COSINE, n] * math.cos(state[n])
        power += mode[n] * (rows[HELD, n] + by_gravity)
        friction += speed * rows[DAMPINGS, n] * mode[n] ** 2
    changes[rotors], changes[rotors + 1] = power - friction, friction * speed
    return changes
