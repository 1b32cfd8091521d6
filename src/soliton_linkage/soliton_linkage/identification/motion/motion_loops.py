# SPDX-License-Identifier: Apache-2.0
"""Loops over rotors and springs, for `free_motion`: a motion and its change with Q unknowns.

Arrays are `table`, (5, N), with r, a, l, k of rotors and springs, then the inertias; `columns`,
(5, N), the places of r, a, l, log k and log m among the unknowns; angles and rates, (N,); their
changes x and v, (N, Q), of which Q = 0 makes a motion alone; `forces`, (5,), the damping, the
dry friction, the rate at which that is nearly whole, and the parts of gravity along the chain and
down from it. The columns of damping, friction and log gravity begin with that of damping.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    COUNT,
    NUMBER,
    READ,
    READ_PLACES,
    READ_TABLE,
    ROW,
    TABLE,
    compiled,
)
from soliton_linkage.linkage.chain import Array

R, A, L, K, INERTIA = range(5)
"""Rows of the table, and but for the last of the columns, in which log m takes its place."""
M = INERTIA
"""Row of the columns of log m."""
(
    BELOW,
    MAIN,
    ABOVE,
    PULL,
    FIRST,
    SECOND,
    BY_R,
    BY_NEXT_R,
    BY_A,
    NEXT_BY_R,
    NEXT_BY_NEXT_R,
    NEXT_BY_A,
    RUBBING,
    DRAG,
    FALL,
) = range(15)
"""Rows of the work of springs and rotors, (15, N): diagonals, tension, levers, and second
derivatives; then the share of the friction that acts, the change of all drag with the rate, and
the acceleration by gravity."""
DAMPING, FRICTION, SLIDING, ALONG, DOWN = range(5)
"""Places of the forces."""
Places = NDArray[np.int64]


@compiled(READ_TABLE, READ, ROW, ROW, ROW, TABLE)
def accelerate(
    table: Array, forces: Array, angles: Array, rates: Array, values: Array, work: Array
) -> None:
    """Set the accelerations `values` [rad/s^2], (N,), and the work of all springs."""
    rotors = angles.size
    falling = forces[ALONG] != 0.0 or forces[DOWN] != 0.0
    for n in range(rotors):
        rubbing = math.tanh(rates[n] / forces[SLIDING])
        values[n] = -forces[DAMPING] * rates[n] - forces[FRICTION] * rubbing
        whole = 1 - rubbing * rubbing
        work[RUBBING, n] = rubbing
        work[DRAG, n] = forces[DAMPING] + forces[FRICTION] * whole / forces[SLIDING]
        work[MAIN, n] = work[FALL, n] = 0.0
        if falling:
            s, c = math.sin(angles[n]), math.cos(angles[n])
            weight = table[INERTIA, n] / table[R, n]
            work[FALL, n] = (forces[DOWN] * s + forces[ALONG] * c) / table[R, n]
            values[n] += table[INERTIA, n] * work[FALL, n]
            work[MAIN, n] = weight * (forces[DOWN] * c - forces[ALONG] * s)
    s, c = math.sin(angles[0]), math.cos(angles[0])
    for n in range(rotors - 1):
        s2, c2 = math.sin(angles[n + 1]), math.cos(angles[n + 1])
        r, r2, k = table[R, n], table[R, n + 1], table[K, n]
        across, up = table[A, n] + r2 * s2 - r * s, r2 * c2 - r * c
        length = math.sqrt(across * across + up * up)
        ux, uy = across / length, up / length
        f = length - table[L, n]
        x1, y1, x2, y2 = -r * c, r * s, r2 * c2, -r2 * s2
        first, second = x1 * ux + y1 * uy, x2 * ux + y2 * uy
        by_r, by_next = -s * ux - c * uy, s2 * ux + c2 * uy
        pull = -k * f
        values[n] += pull * first
        values[n + 1] += pull * second
        bend = (x1 * x1 + y1 * y1 - first * first) / length + ux * r * s + uy * r * c
        work[MAIN, n] -= k * (first * first + f * bend)
        bend = (x2 * x2 + y2 * y2 - second * second) / length - ux * r2 * s2 - uy * r2 * c2
        work[MAIN, n + 1] -= k * (second * second + f * bend)
        across = -k * (first * second + f * (x1 * x2 + y1 * y2 - first * second) / length)
        work[ABOVE, n] = work[BELOW, n] = across
        work[PULL, n], work[FIRST, n], work[SECOND, n] = pull, first, second
        bend = (-x1 * s - y1 * c - first * by_r) / length - ux * c + uy * s
        work[BY_R, n] = -k * (first * by_r + f * bend)
        bend = (x1 * s2 + y1 * c2 - first * by_next) / length
        work[BY_NEXT_R, n] = -k * (first * by_next + f * bend)
        work[BY_A, n] = -k * (first * ux + f * (x1 - first * ux) / length)
        bend = (-x2 * s - y2 * c - second * by_r) / length
        work[NEXT_BY_R, n] = -k * (second * by_r + f * bend)
        bend = (x2 * s2 + y2 * c2 - second * by_next) / length + ux * c2 - uy * s2
        work[NEXT_BY_NEXT_R, n] = -k * (second * by_next + f * bend)
        work[NEXT_BY_A, n] = -k * (second * ux + f * (x2 - second * ux) / length)
        s, c = s2, c2
    for n in range(rotors):
        values[n] /= table[INERTIA, n]


@compiled(ROW, ROW, NUMBER, ROW)
def combine(out: Array, base: Array, factor: float, other: Array) -> None:
    """Set out = base + factor other, all (Q,); out may be base."""
    for q in range(out.size):
        out[q] = base[q] + factor * other[q]


@compiled(READ_TABLE, READ_PLACES, COUNT, ROW, ROW, TABLE, TABLE, TABLE, TABLE)
def change_accelerations(
    table: Array,
    columns: Places,
    drag_column: int,
    rates: Array,
    values: Array,
    work: Array,
    x: Array,
    v: Array,
    changes: Array,
) -> None:
    """Set the changes of accelerations, (N, Q), given their values and the work of all springs."""
    rotors, size = x.shape
    for n in range(rotors):
        inverse = 1 / table[INERTIA, n]
        main, drag = work[MAIN, n] * inverse, -work[DRAG, n] * inverse
        row, own, rate = changes[n], x[n], v[n]
        for q in range(size):
            row[q] = main * own[q]
        if drag:
            combine(row, row, drag, rate)
        if n > 0:
            combine(row, row, work[BELOW, n - 1] * inverse, x[n - 1])
        if n < rotors - 1:
            combine(row, row, work[ABOVE, n] * inverse, x[n + 1])
        row[columns[R, n]] -= 2 * values[n] - work[FALL, n]
        row[columns[M, n]] -= values[n] - work[FALL, n]
        row[drag_column] -= rates[n] * inverse
        row[drag_column + 1] -= work[RUBBING, n] * inverse
        row[drag_column + 2] += work[FALL, n]
    for n in range(rotors - 1):
        r, r2, a = table[R, n], table[R, n + 1], table[A, n]
        stretch = table[K, n] * table[L, n]
        row, inverse = changes[n], 1 / table[INERTIA, n]
        row[columns[R, n]] += work[BY_R, n] * r * inverse
        row[columns[R, n + 1]] += work[BY_NEXT_R, n] * r2 * inverse
        row[columns[A, n]] += work[BY_A, n] * a * inverse
        row[columns[L, n]] += stretch * work[FIRST, n] * inverse
        row[columns[K, n]] += work[PULL, n] * work[FIRST, n] * inverse
        row, inverse = changes[n + 1], 1 / table[INERTIA, n + 1]
        row[columns[R, n]] += work[NEXT_BY_R, n] * r * inverse
        row[columns[R, n + 1]] += work[NEXT_BY_NEXT_R, n] * r2 * inverse
        row[columns[A, n]] += work[NEXT_BY_A, n] * a * inverse
        row[columns[L, n]] += stretch * work[SECOND, n] * inverse
        row[columns[K, n]] += work[PULL, n] * work[SECOND, n] * inverse


@compiled(READ_TABLE, READ_PLACES, COUNT, READ, COUNT, NUMBER, ROW, ROW, TABLE, TABLE)
def advance(
    table: Array,
    columns: Places,
    drag_column: int,
    forces: Array,
    steps: int,
    step: float,
    angles: Array,
    rates: Array,
    x: Array,
    v: Array,
) -> None:
    """Go some steps [s] on, in place, by the classical method of Runge and Kutta."""
    rotors, size = x.shape
    work, values = np.empty((15, rotors)), np.empty(rotors)
    angle, rate = np.empty(rotors), np.empty(rotors)
    angle_sum, rate_sum = np.empty(rotors), np.empty(rotors)
    at_x, at_v, changes = (
        np.empty((rotors, size)),
        np.empty((rotors, size)),
        np.empty((rotors, size)),
    )
    sum_x, sum_v = np.empty((rotors, size)), np.empty((rotors, size))
    for _ in range(steps):
        angle[:], rate[:], at_x[:], at_v[:] = angles, rates, x, v
        angle_sum[:], rate_sum[:], sum_x[:], sum_v[:] = angles, rates, x, v
        for stage in range(4):
            weight = step / 6 if stage in (0, 3) else step / 3
            ahead = step if stage == 2 else step / 2
            accelerate(table, forces, angle, rate, values, work)
            if size:
                change_accelerations(
                    table, columns, drag_column, rate, values, work, at_x, at_v, changes
                )
            for n in range(rotors):
                angle_sum[n] += weight * rate[n]
                rate_sum[n] += weight * values[n]
                angle[n] = angles[n] + ahead * rate[n]
                rate[n] = rates[n] + ahead * values[n]
                combine(sum_x[n], sum_x[n], weight, at_v[n])
                combine(sum_v[n], sum_v[n], weight, changes[n])
                combine(at_x[n], x[n], ahead, at_v[n])
                combine(at_v[n], v[n], ahead, changes[n])
        angles[:], rates[:], x[:], v[:] = angle_sum, rate_sum, sum_x, sum_v
