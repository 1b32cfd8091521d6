# SPDX-License-Identifier: Apache-2.0
"""Compiled loops that integrate a free motion, its sensitivities, and its adjoint.

The classical Runge-Kutta method integrates the angles phi. The sensitivities of the angles to the
unknowns q, X = dphi/dq and V = X', satisfy

    X' = V,    V' = (dphi''/dphi) X + (dphi''/dphi') V + dphi''/dq,

and `pull_back` integrates the adjoint equations. Arguments for N rotors and Q unknowns, with the
symbols of `free_motion`:

    table, (5, N): r, a, l, k, and the moments of inertia;
    forces, (6,): c, b, w, gravity along the chain and across it, and the longest step;
    work, (8, N): accelerations phi'' and their derivatives by angles, rates and forces;
    direct, (5 N, 3): row i N + n contains the derivatives of phi'' of the rotors n - 1, n, n + 1
        by log r_n (i = 0), log a_n, log l_n, log k_n or log m_n (i = 4);
    sources, (Q,): the row in direct for a length, stiffness or mass; NO_SOURCE for an initial
        angle or rate, UNMOVED for an offset, BY_FORCE for c, BY_FORCE - 1 for b, BY_FORCE - 2 for
        log g.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    compile_loop,
    compiled,
    const_f8_1d,
    const_f8_2d,
    f8,
    f8_1d,
    f8_2d,
    f8_3d,
    i8_1d,
    inlined,
)
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.springs import spring_between

R, A, L, K, INERTIA = range(5)
M = INERTIA
"""Index of log m in `direct`; R, A, L and K are the indices of log r, log a, log l and log k."""
ACCELERATION, BELOW, MAIN, ABOVE, DRAG, BY_DAMPING, BY_FRICTION, FALL = range(8)
"""Rows of `work`: the acceleration of rotor n; its derivatives by the angles of the rotors n - 1,
n and n + 1, by the rate of rotor n, by c and by b; and FALL, the acceleration by gravity, which is
the derivative by log g."""
DAMPING, FRICTION, SLIDING, ALONG, DOWN, LONGEST = range(6)
NO_SOURCE, UNMOVED, BY_FORCE = -1, -2, -3

spring = compile_loop(spring_between, inlined=True)


@inlined
def put_torques_without_springs(
    table: Array, forces: Array, angles: Array, rates: Array, work: Array
) -> None:
    """Store the torques of damping, friction and gravity, and their derivatives, in `work`.

    The rows ACCELERATION and MAIN contain torques and their derivatives until `accelerate` divides
    these rows by the moments of inertia.
    """
    rotors, values, inertias = angles.size, work[ACCELERATION], table[INERTIA]
    gravity = forces[ALONG] != 0.0 or forces[DOWN] != 0.0
    for n in range(rotors):
        part = math.tanh(rates[n] / forces[SLIDING])
        values[n] = -forces[DAMPING] * rates[n] - forces[FRICTION] * part
        slope = (1 - part * part) / forces[SLIDING]
        work[DRAG, n] = -(forces[DAMPING] + forces[FRICTION] * slope) / inertias[n]
        work[BY_DAMPING, n], work[BY_FRICTION, n] = -rates[n] / inertias[n], -part / inertias[n]
        work[MAIN, n] = work[FALL, n] = 0.0
        if gravity:
            s, c = math.sin(angles[n]), math.cos(angles[n])
            work[FALL, n] = (forces[DOWN] * s + forces[ALONG] * c) / table[R, n]
            values[n] += inertias[n] * work[FALL, n]
            work[MAIN, n] = inertias[n] / table[R, n] * (forces[DOWN] * c - forces[ALONG] * s)


@compiled(const_f8_2d, const_f8_1d, f8_1d, f8_1d, f8_2d, f8_2d)
def accelerate(
    table: Array, forces: Array, angles: Array, rates: Array, work: Array, direct: Array
) -> None:
    """Compute accelerations and their derivatives for angles [rad] and rates [rad/s], (N,) each.

    The results are stored in `work` and `direct`. If `direct` is empty, derivatives are not
    computed.
    """
    put_torques_without_springs(table, forces, angles, rates, work)
    rotors, values, inertias = angles.size, work[ACCELERATION], table[INERTIA]
    derivatives = direct.size > 0
    direct[:rotors] = 0.0
    work[BELOW, 0] = work[ABOVE, rotors - 1] = 0.0
    s, c = math.sin(angles[0]), math.cos(angles[0])
    for n in range(rotors - 1):
        s2, c2 = math.sin(angles[n + 1]), math.cos(angles[n + 1])
        r, r2, a, rest, k = table[R, n], table[R, n + 1], table[A, n], table[L, n], table[K, n]
        i, i2 = inertias[n], inertias[n + 1]
        x1, y1, x2, y2 = -r * c, r * s, r2 * c2, -r2 * s2
        offset = a * a + r * r + r2 * r2 - rest * rest
        f, first, second = spring(y1, -x1, -y2, x2, a, offset, rest)
        pull = -k * f
        values[n] += pull * first
        values[n + 1] += pull * second
        if derivatives:
            length = rest + f
            ux, uy = (a - y2 - y1) / length, (x2 + x1) / length
            by_r, by_next = -s * ux - c * uy, s2 * ux + c2 * uy
            bend = (x1 * x1 + y1 * y1 - first * first) / length + ux * r * s + uy * r * c
            work[MAIN, n] -= k * (first * first + f * bend)
            bend = (x2 * x2 + y2 * y2 - second * second) / length - ux * r2 * s2 - uy * r2 * c2
            work[MAIN, n + 1] -= k * (second * second + f * bend)
            across = -k * (first * second + f * (x1 * x2 + y1 * y2 - first * second) / length)
            work[ABOVE, n], work[BELOW, n + 1] = across / i, across / i2
            bend = (-x1 * s - y1 * c - first * by_r) / length - ux * c + uy * s
            direct[n, 1] += -k * (first * by_r + f * bend) * r / i
            bend = (x1 * s2 + y1 * c2 - first * by_next) / length
            direct[n + 1, 0] = -k * (first * by_next + f * bend) * r2 / i
            bend = (-x2 * s - y2 * c - second * by_r) / length
            direct[n, 2] = -k * (second * by_r + f * bend) * r / i2
            bend = (x2 * s2 + y2 * c2 - second * by_next) / length + ux * c2 - uy * s2
            direct[n + 1, 1] += -k * (second * by_next + f * bend) * r2 / i2
            row = A * rotors + n
            direct[row, 1] = -k * (first * ux + f * (x1 - first * ux) / length) * a / i
            direct[row, 2] = -k * (second * ux + f * (x2 - second * ux) / length) * a / i2
            row = L * rotors + n
            direct[row, 1], direct[row, 2] = k * rest * first / i, k * rest * second / i2
            row = K * rotors + n
            direct[row, 1], direct[row, 2] = pull * first / i, pull * second / i2
        s, c = s2, c2
    for n in range(rotors):
        values[n] /= inertias[n]
        if derivatives:
            work[MAIN, n] /= inertias[n]
            driven = values[n] - work[FALL, n]
            direct[n, 1] -= driven + values[n]
            direct[M * rotors + n, 1] = -driven


@compiled(const_f8_2d, const_f8_1d, f8, f8_2d, f8_3d, f8_3d, f8_3d)
def advance(
    table: Array, forces: Array, step: float, state: Array, at: Array, works: Array, directs: Array
) -> None:
    """Advance the angles and rates in `state`, (2, N), by one Runge-Kutta step [s].

    The states in the four stages of the step are stored in `at`, (4, 2, N). The results of
    `accelerate` for these states are stored in `works` and `directs`.
    """
    rotors = state.shape[1]
    at[0] = state
    for stage in range(4):
        if stage:
            ahead = step if stage == 3 else step / 2
            for n in range(rotors):
                at[stage, 0, n] = state[0, n] + ahead * at[stage - 1, 1, n]
                at[stage, 1, n] = state[1, n] + ahead * works[stage - 1, ACCELERATION, n]
        accelerate(table, forces, at[stage, 0], at[stage, 1], works[stage], directs[stage])
    for stage in range(4):
        weight = step / 6 if stage in (0, 3) else step / 3
        for n in range(rotors):
            state[0, n] += weight * at[stage, 1, n]
            state[1, n] += weight * works[stage, ACCELERATION, n]


@compiled(f8, f8_3d, f8_3d, i8_1d, f8_2d, f8_3d)
def advance_sensitivities(
    step: float,
    works: Array,
    directs: Array,
    sources: NDArray[np.int64],
    own: Array,
    changes: Array,
) -> None:
    """Advance `changes`, sensitivities of angles and rates, (Q, 2, N), by a Runge-Kutta step [s].

    `works` and `directs` are the results of `advance` for the step. `own`, (5, N + 2), is working
    memory; the first and the last element of its row 0 must be 0.
    """
    rotors = changes.shape[2]
    x_at, v_at, acceleration, x_sum, v_sum = own[0], own[1], own[2], own[3], own[4]
    for q in range(changes.shape[0]):
        source, x, v = sources[q], changes[q, 0], changes[q, 1]
        if source == UNMOVED:
            continue
        for n in range(rotors):
            x_at[n + 1], v_at[n] = x[n], v[n]
            x_sum[n] = v_sum[n] = 0.0
        for stage in range(4):
            work = works[stage]
            for n in range(rotors):
                acceleration[n + 1] = (
                    work[BELOW, n] * x_at[n]
                    + work[MAIN, n] * x_at[n + 1]
                    + work[ABOVE, n] * x_at[n + 2]
                    + work[DRAG, n] * v_at[n]
                )
            if source >= 0:
                for j in range(3):
                    acceleration[source % rotors + j] += directs[stage, source, j]
            elif source <= BY_FORCE:
                for n in range(rotors):
                    acceleration[n + 1] += work[BY_DAMPING + BY_FORCE - source, n]
            weight = step / 6 if stage in (0, 3) else step / 3
            ahead = step if stage == 2 else step / 2
            for n in range(rotors):
                x_sum[n] += weight * v_at[n]
                v_sum[n] += weight * acceleration[n + 1]
                x_at[n + 1] = x[n] + ahead * v_at[n]
                v_at[n] = v[n] + ahead * acceleration[n + 1]
        for n in range(rotors):
            x[n] += x_sum[n]
            v[n] += v_sum[n]


@compiled(const_f8_2d, const_f8_1d, i8_1d, const_f8_1d, f8_2d, f8_3d, f8_3d, f8_3d)
def integrate(
    table: Array,
    forces: Array,
    sources: NDArray[np.int64],
    spans: Array,
    state: Array,
    changes: Array,
    states: Array,
    slopes: Array,
) -> None:
    """Integrate `state`, (2, N), and sensitivities `changes`, (Q, 2, N), over T time `spans` [s].

    At the end of each span, the angles and rates are stored in `states`, (T, 2, N), and the
    sensitivities of the angles in `slopes`, (Q, T, N).
    """
    rotors, size = state.shape[1], changes.shape[0]
    at, works = np.empty((4, 2, rotors)), np.empty((4, 8, rotors))
    directs, own = np.zeros((4, 5 * rotors if size else 0, 3)), np.zeros((5, rotors + 2))
    for frame in range(spans.size):
        if spans[frame] != 0:
            steps = math.ceil(abs(spans[frame]) / forces[LONGEST])
            for _ in range(steps):
                advance(table, forces, spans[frame] / steps, state, at, works, directs)
                if size:
                    advance_sensitivities(
                        spans[frame] / steps, works, directs, sources, own, changes
                    )
        states[frame] = state
        for q in range(size):
            slopes[q, frame] = changes[q, 0]


@compiled(f8, f8_3d, f8_3d, f8_2d, f8_1d)
def reverse(step: float, works: Array, directs: Array, pull: Array, gradient: Array) -> None:
    """Propagate the adjoint `pull` of the state, (2, N), back over one Runge-Kutta step [s].

    The derivatives by the 5 N parameters of the chain and the 3 parameters of the forces are added
    to `gradient`, (5 N + 3,). `works` and `directs` are the results of `advance` for the step.
    """
    rotors = pull.shape[1]
    after, torque, total = np.zeros((2, rotors)), np.zeros(rotors + 2), pull.copy()
    for stage in range(3, -1, -1):
        weight = step / 6 if stage in (0, 3) else step / 3
        ahead = 0.0 if stage == 3 else step if stage == 2 else step / 2
        work = works[stage]
        for n in range(rotors):
            torque[n + 1] = weight * pull[1, n] + ahead * after[1, n]
        for n in range(rotors):
            after[1, n] = weight * pull[0, n] + ahead * after[0, n] + work[DRAG, n] * torque[n + 1]
        for n in range(rotors):
            value = work[MAIN, n] * torque[n + 1]
            if n > 0:
                value += work[ABOVE, n - 1] * torque[n]
            if n < rotors - 1:
                value += work[BELOW, n + 1] * torque[n + 2]
            after[0, n] = value
        for kind in range(5):
            for n in range(rotors):
                row = kind * rotors + n
                for j in range(3):
                    gradient[row] += directs[stage, row, j] * torque[n + j]
        for force in range(3):
            for n in range(rotors):
                gradient[5 * rotors + force] += work[BY_DAMPING + force, n] * torque[n + 1]
        for n in range(rotors):
            total[0, n] += after[0, n]
            total[1, n] += after[1, n]
    pull[:] = total


@compiled(const_f8_2d, const_f8_1d, const_f8_1d, f8_3d, f8_2d, f8_2d, f8_1d)
def pull_back(
    table: Array,
    forces: Array,
    spans: Array,
    states: Array,
    weights: Array,
    pull: Array,
    gradient: Array,
) -> None:
    """Differentiate the sum of all angles times `weights`, (T, N).

    The derivatives by the initial state are added to `pull`, (2, N). The derivatives by the
    parameters of the chain and of the forces are added to `gradient`, (5 N + 3,). `states` is the
    result of `integrate`.
    """
    rotors = pull.shape[1]
    at, works = np.empty((4, 2, rotors)), np.empty((4, 8, rotors))
    directs, none = np.zeros((4, 5 * rotors, 3)), np.empty((4, 0, 3))
    most = max(1, math.ceil(np.abs(spans).max() / forces[LONGEST]))
    begins = np.empty((most, 2, rotors))
    for frame in range(spans.size - 1, -1, -1):
        for n in range(rotors):
            pull[0, n] += weights[frame, n]
        if frame == 0 or spans[frame] == 0:
            continue
        steps = math.ceil(abs(spans[frame]) / forces[LONGEST])
        state, step = states[frame - 1].copy(), spans[frame] / steps
        begins[0] = state
        for number in range(1, steps):
            advance(table, forces, step, state, at, works, none)
            begins[number] = state
        for number in range(steps - 1, -1, -1):
            advance(table, forces, step, begins[number], at, works, directs)
            reverse(step, works, directs, pull, gradient)
