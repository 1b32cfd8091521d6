# SPDX-License-Identifier: Apache-2.0
"""Compiled loop of `equation_of_motion`, which says what it computes."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import READ, READ_TABLE, YES, compile_loop, compiled
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.springs import spring_between

LENGTHS, SPACINGS, OFFSETS, REST_LENGTHS, STIFFNESSES = range(5)
"""Rows of what springs have, the first four those of `Chain.spring_parameters`."""
INERTIAS, DAMPINGS, HELD, BY_SINE, BY_COSINE = range(5, 10)
"""Rows of what else acts on rotors: gravity by the sines and cosines of their angles."""
ROWS = BY_COSINE + 1
"""Number of rows, each with a place for every rotor."""
spring = compile_loop(spring_between, inlined=True)


@compiled(READ, READ_TABLE, YES)
def derivative(state: Array, rows: Array, periodic: bool) -> Array:
    """Time derivative of a state, of its shape; `Chain.springs` has the equations of springs."""
    rotors = rows.shape[1]
    changes, positions, dissipated = np.empty(state.size), np.empty((2, rotors)), 0.0
    for n in range(rotors):
        sine, cosine, rate = math.sin(state[n]), math.cos(state[n]), state[rotors + n]
        positions[0, n], positions[1, n] = rows[LENGTHS, n] * sine, rows[LENGTHS, n] * cosine
        friction = rows[DAMPINGS, n] * rate
        dissipated += friction * rate
        by_gravity = rows[BY_SINE, n] * sine + rows[BY_COSINE, n] * cosine
        changes[n], changes[rotors + n] = rate, rows[HELD, n] + by_gravity - friction
    for left in range(rotors if periodic else rotors - 1):
        right = left + 1 if left + 1 < rotors else 0
        extension, first, second = spring(
            positions[0, left],
            positions[1, left],
            positions[0, right],
            positions[1, right],
            rows[SPACINGS, left],
            rows[OFFSETS, left],
            rows[REST_LENGTHS, left],
        )
        pull = rows[STIFFNESSES, left] * extension
        changes[rotors + left] -= pull * first
        changes[rotors + right] -= pull * second
    for n in range(rotors):
        changes[rotors + n] /= rows[INERTIAS, n]
    if state.size > 2 * rotors:
        changes[2 * rotors] = dissipated
    return changes
