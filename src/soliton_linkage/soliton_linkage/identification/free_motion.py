# SPDX-License-Identifier: Apache-2.0
"""Simulation of the free motion of a chain of springs, with sensitivities to all unknowns.

The equation of motion of rotor n is

    m_n r_n^2 phi_n'' = -sum over both springs of k f df/dphi_n + g m_n r_n sin(phi_n + tilt)
                        - c phi_n' - b tanh(phi_n' / w),

where f is the extension of a spring, c the damping, and b the dry friction. The torque of dry
friction is nearly constant at rates above w. The Q unknowns q are the unknowns of `Lengths`, log k
of each spring, log m of each rotor, c, b, log g, the initial angles and the initial rates. The
sensitivities X = dphi/dq and V = X' satisfy

    X' = V,    V' = (dphi''/dphi) X + (dphi''/dphi') V + dphi''/dq.

The classical Runge-Kutta method integrates the sensitivities together with the motion.

The compiled loops have these arguments:

- `table`, (5, N): r, a, l, k, and the moments of inertia;
- `columns`, (5, N): the indices of r, a, l, log k and log m among the unknowns;
- `forces`, (6,): c, b, w, gravity along the chain and across it, and the longest step;
- angles and rates, (N,), and their sensitivities x and v, (N, Q).

With Q = 0 only the motion is integrated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    compile_loop,
    compiled,
    const_f8_1d,
    const_f8_2d,
    const_i8_2d,
    f8,
    f8_1d,
    f8_2d,
    f8_3d,
    i8,
)
from soliton_linkage.identification.lengths import UNKNOWNS_PER_ROTOR, Lengths, split_lengths
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.springs import spring_between

R, A, L, K, INERTIA = range(5)
"""Rows of `table`. The first four are also rows of `columns`."""
M = INERTIA
"""Row of log m in `columns`."""
BELOW, MAIN, ABOVE, PULL, FIRST, SECOND, BY_R, BY_NEXT_R = range(8)
BY_A, NEXT_BY_R, NEXT_BY_NEXT_R, NEXT_BY_A, FRICTION_PART, DRAG, FALL, ACCELERATION = range(8, 16)
"""Rows of the workspace `work`, (16, N): three diagonals of the stiffness matrix (`BELOW` to
`ABOVE`), force of each spring (`PULL`), derivatives of its extension by both angles (`FIRST` and
`SECOND`), derivatives of the torques by lengths (`BY_R` to `NEXT_BY_A`), dry friction divided by b
(`FRICTION_PART`), derivative of the total drag by the rate (`DRAG`), acceleration by gravity
(`FALL`), and acceleration by all torques (`ACCELERATION`)."""
DAMPING, FRICTION, SLIDING, ALONG, DOWN, LONGEST = range(6)
"""Indices in `forces`."""
Columns = NDArray[np.int64]


spring = compile_loop(spring_between, inlined=True)


@compiled(const_f8_2d, const_f8_1d, f8_1d, f8_1d, f8_2d)
def accelerate(table: Array, forces: Array, angles: Array, rates: Array, work: Array) -> None:
    """Set all rows of the workspace, among them the accelerations [rad/s^2]."""
    rotors, values = angles.size, work[ACCELERATION]
    gravity = forces[ALONG] != 0.0 or forces[DOWN] != 0.0
    for n in range(rotors):
        part = math.tanh(rates[n] / forces[SLIDING])
        values[n] = -forces[DAMPING] * rates[n] - forces[FRICTION] * part
        slope = 1 - part * part
        work[FRICTION_PART, n] = part
        work[DRAG, n] = forces[DAMPING] + forces[FRICTION] * slope / forces[SLIDING]
        work[MAIN, n] = work[FALL, n] = 0.0
        if gravity:
            s, c = math.sin(angles[n]), math.cos(angles[n])
            weight = table[INERTIA, n] / table[R, n]
            work[FALL, n] = (forces[DOWN] * s + forces[ALONG] * c) / table[R, n]
            values[n] += table[INERTIA, n] * work[FALL, n]
            work[MAIN, n] = weight * (forces[DOWN] * c - forces[ALONG] * s)
    s, c = math.sin(angles[0]), math.cos(angles[0])
    for n in range(rotors - 1):
        s2, c2 = math.sin(angles[n + 1]), math.cos(angles[n + 1])
        r, r2, a, rest, k = table[R, n], table[R, n + 1], table[A, n], table[L, n], table[K, n]
        x1, y1, x2, y2 = -r * c, r * s, r2 * c2, -r2 * s2
        offset = a * a + r * r + r2 * r2 - rest * rest
        f, first, second = spring(y1, -x1, -y2, x2, a, offset, rest)
        length = rest + f
        ux, uy = (a - y2 - y1) / length, (x2 + x1) / length
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


@compiled(const_f8_2d, const_i8_2d, f8_1d, f8_2d, f8_2d, f8_2d, f8_2d)
def accelerate_sensitivities(
    table: Array,
    columns: Columns,
    rates: Array,
    work: Array,
    x: Array,
    v: Array,
    changes: Array,
) -> None:
    """Set `changes`, the sensitivities of the accelerations, (N, Q), given the workspace."""
    rotors, size = x.shape
    values, drag_column = work[ACCELERATION], columns[M, 0] + rotors
    for n in range(rotors):
        inverse = 1 / table[INERTIA, n]
        main, drag = work[MAIN, n] * inverse, -work[DRAG, n] * inverse
        below = work[BELOW, n - 1] * inverse if n > 0 else 0.0
        above = work[ABOVE, n] * inverse if n < rotors - 1 else 0.0
        row, own, rate = changes[n], x[n], v[n]
        before, after = x[max(n - 1, 0)], x[min(n + 1, rotors - 1)]
        for q in range(size):
            row[q] = main * own[q] + below * before[q] + above * after[q] + drag * rate[q]
        row[columns[R, n]] -= 2 * values[n] - work[FALL, n]
        row[columns[M, n]] -= values[n] - work[FALL, n]
        row[drag_column] -= rates[n] * inverse
        row[drag_column + 1] -= work[FRICTION_PART, n] * inverse
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


@compiled(const_f8_2d, const_i8_2d, const_f8_1d, i8, f8, f8_2d, f8_3d)
def advance(
    table: Array,
    columns: Columns,
    forces: Array,
    steps: int,
    step: float,
    state: Array,
    changes: Array,
) -> None:
    """Integrate a number of steps in place by the classical Runge-Kutta method.

    `step` is the duration of a step [s]. `state`, (2, N), contains angles and rates. `changes`,
    (2, N, Q), contains x and v.
    """
    rotors, size = changes.shape[1:]
    work, rate_changes = np.empty((16, rotors)), np.empty((rotors, size))
    for _ in range(steps):
        at, sums, at_changes, sum_changes = (
            state.copy(),
            state.copy(),
            changes.copy(),
            changes.copy(),
        )
        for stage in range(4):
            weight = step / 6 if stage in (0, 3) else step / 3
            ahead = step if stage == 2 else step / 2
            accelerate(table, forces, at[0], at[1], work)
            if size:
                accelerate_sensitivities(
                    table, columns, at[1], work, at_changes[0], at_changes[1], rate_changes
                )
            for n in range(rotors):
                sums[0, n] += weight * at[1, n]
                sums[1, n] += weight * work[ACCELERATION, n]
                at[0, n] = state[0, n] + ahead * at[1, n]
                at[1, n] = state[1, n] + ahead * work[ACCELERATION, n]
                for q in range(size):
                    rate, change = at_changes[1, n, q], rate_changes[n, q]
                    sum_changes[0, n, q] += weight * rate
                    sum_changes[1, n, q] += weight * change
                    at_changes[0, n, q] = changes[0, n, q] + ahead * rate
                    at_changes[1, n, q] = changes[1, n, q] + ahead * change
        state[:], changes[:] = sums, sum_changes


@compiled(const_f8_2d, const_i8_2d, const_f8_1d, const_f8_1d, f8_2d, f8_3d, f8_3d, f8_3d)
def integrate(
    table: Array,
    columns: Columns,
    forces: Array,
    spans: Array,
    state: Array,
    changes: Array,
    states: Array,
    slopes: Array,
) -> None:
    """Integrate over T successive spans of time [s], and store the results after each span.

    `states`, (T, 2, N), receives angles and rates. `slopes`, (T, N, Q), receives x.
    """
    for frame in range(spans.size):
        if spans[frame] != 0:
            steps = math.ceil(abs(spans[frame]) / forces[LONGEST])
            advance(table, columns, forces, steps, spans[frame] / steps, state, changes)
        states[frame], slopes[frame] = state, changes[0]


_LONGEST_STEP = 0.4
"""Longest step times the largest rate of vibration and decay [1]. After a wall has crossed 40
rotors, errors of angles are at most 2e-5 rad. Sensitivity: at 0.5x, they are 2e-6 rad, and the
computing time doubles."""
_BATCH = 32
"""Number of frames whose sensitivities are computed in one batch [1]. A batch of 40 rotors needs
3 MB."""
_SLIDING = 0.1
"""Rate w above which dry friction is nearly constant [rad/s]. It is small compared with the rates
of rotors in a moving wall. Sensitivity: at 0.5x, the integration of friction needs more steps."""
FORCE_UNKNOWNS = 3
"""Number of unknown forces [1]: c, b and log g."""


class UnknownSlices(NamedTuple):
    """Indices of each kind of unknowns among the unknowns of a motion."""

    lengths: slice
    stiffnesses: slice
    masses: slice
    forces: slice
    angles: slice
    rates: slice


def unknown_slices(rotors: int) -> UnknownSlices:
    """Return the indices of the unknowns of N rotors: first the chain, then the initial state."""
    sizes = [UNKNOWNS_PER_ROTOR * rotors - 2, rotors - 1, rotors, FORCE_UNKNOWNS, rotors, rotors]
    ends = np.cumsum(sizes).tolist()
    return UnknownSlices(*map(slice, [0, *ends[:-1]], ends))


@dataclass(frozen=True)
class FreeMotion:
    """A chain of springs, the forces on its rotors, and its initial state.

    Lengths may be in any unit. Masses, stiffnesses, damping and friction are divided by the mean
    mass.
    """

    lengths: Lengths
    stiffnesses: Array
    """Stiffnesses k divided by the mean mass [1/s^2], shape (N - 1,)."""
    masses: Array
    """Masses m divided by the mean mass [1], shape (N,)."""
    damping: float
    """Damping c of each rotor divided by the mean mass [length^2/s]."""
    angles: Array
    """Initial angles [rad], shape (N,)."""
    rates: Array
    """Initial rates [rad/s], shape (N,)."""
    friction: float = 0.0
    """Dry friction b of each rotor divided by the mean mass [length^2/s^2]."""
    gravity: float = 0.0
    """Gravity g in the plane of the chain [length/s^2], 0 if gravity does not act."""
    tilt: float = 0.0
    """Tilt of the chain, positive if the last rotor is lower [rad]."""

    @property
    def slices(self) -> UnknownSlices:
        """Indices of each kind of unknowns."""
        return unknown_slices(len(self.masses))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.slices.rates.stop)

    @property
    def inertias(self) -> Array:
        """Moments of inertia divided by the mean mass [length^2], shape (N,)."""
        return np.asarray(self.masses * self.lengths.rotor_lengths**2)

    @property
    def fastest(self) -> float:
        """Upper bound of the angular frequencies of vibrations and of the decay rates [rad/s]."""
        vibrations = 2 * math.sqrt(float(self.stiffnesses.max() / self.masses.min()))
        return vibrations + abs(self.friction) / _SLIDING / float(self.inertias.min())

    def changed(self, change: Array) -> FreeMotion:
        """Return the motion after a change of the unknowns."""
        lengths, springs, masses, forces, angles, rates = (change[part] for part in self.slices)
        damping, friction, gravity = forces.tolist()
        return replace(
            self,
            lengths=self.lengths.changed(lengths),
            stiffnesses=self.stiffnesses * np.exp(springs),
            masses=self.masses * np.exp(masses),
            damping=self.damping + damping,
            friction=self.friction + friction,
            gravity=self.gravity * math.exp(gravity),
            angles=self.angles + angles,
            rates=self.rates + rates,
        )

    def normalised(self) -> FreeMotion:
        """Return the motion in units of the mean spacing and the mean mass of its chain."""
        spacing, mass = float(self.lengths.spacings.mean()), float(self.masses.mean())
        return replace(
            self,
            lengths=self.lengths.scaled(1.0),
            stiffnesses=self.stiffnesses / mass,
            masses=self.masses / mass,
            damping=self.damping / (mass * spacing**2),
            friction=self.friction / (mass * spacing**2),
            gravity=self.gravity / spacing,
        )


def split_chain(unknowns: Array) -> dict[str, Array]:
    """Return each kind of unknowns of a chain by name; `Deviations` uses the same names."""
    at = unknown_slices((len(unknowns) + 3 - FORCE_UNKNOWNS) // (UNKNOWNS_PER_ROTOR + 2))
    damping, friction, gravity = np.split(unknowns[at.forces], FORCE_UNKNOWNS)
    return {
        **split_lengths(unknowns[at.lengths]),
        'stiffness': unknowns[at.stiffnesses],
        'mass': unknowns[at.masses],
        'damping': damping,
        'friction': friction,
        'gravity': gravity,
    }


def angles_at(motion: FreeMotion, times: Array) -> Array:
    """Return the angles at each time [rad], shape (T, N)."""
    return propagate(motion, times)[0]


def states_at(motion: FreeMotion, times: Array) -> Array:
    """Return the angles [rad] and the rates [rad/s] at each time, shape (T, 2, N)."""
    return next(_states(motion, times, np.empty((2, len(motion.masses), 0)), len(times)))[0]


def propagate(motion: FreeMotion, times: Array) -> tuple[Array, FreeMotion]:
    """Return the angles at each time [rad], (T, N), and the motion that begins at the last."""
    states = states_at(motion, times)
    angles, rates = states[-1]
    return states[:, 0], replace(motion, angles=angles, rates=rates)


def states_with_sensitivities(motion: FreeMotion, times: Array) -> Iterator[tuple[Array, Array]]:
    """Yield results for successive batches of B times.

    Each result consists of angles and rates, (B, 2, N), and sensitivities of angles, (B, N, Q).
    """
    rotors, at = len(motion.masses), motion.slices
    changes = np.zeros((2, rotors, motion.size))
    changes[0, :, at.angles] = changes[1, :, at.rates] = np.eye(rotors)
    yield from _states(motion, times, changes, _BATCH)


def _states(
    motion: FreeMotion, times: Array, changes: Array, batch: int
) -> Iterator[tuple[Array, Array]]:
    """Yield states, (B, 2, N), and sensitivities of angles, (B, N, Q), for batches of B times."""
    state = np.array([motion.angles, motion.rates])
    along, down = motion.gravity * math.sin(motion.tilt), motion.gravity * math.cos(motion.tilt)
    longest = _LONGEST_STEP / motion.fastest
    forces = np.array([motion.damping, motion.friction, _SLIDING, along, down, longest])
    table, columns = _table(motion), _columns(motion)
    spans = np.diff(times, prepend=times[0])
    for begin in range(0, len(spans), batch):
        some = spans[begin : begin + batch]
        states, slopes = (
            np.empty((len(some), *state.shape)),
            np.empty((len(some), *changes.shape[1:])),
        )
        integrate(table, columns, forces, some, state, changes, states, slopes)
        yield states, slopes


def _table(motion: FreeMotion) -> Array:
    lengths, rotors = motion.lengths, len(motion.masses)
    table = np.zeros((5, rotors))
    table[R] = lengths.rotor_lengths
    table[A, :-1] = lengths.spacings
    table[L, :-1] = lengths.rest_lengths
    table[K, :-1] = motion.stiffnesses
    table[INERTIA] = motion.inertias
    return table


def _columns(motion: FreeMotion) -> Columns:
    """Return the indices of r, a, l, log k and log m among the unknowns, shape (5, N)."""
    own, at = np.arange(len(motion.masses)), motion.slices
    r = UNKNOWNS_PER_ROTOR * own
    columns = [r, r + 2, r + 3, at.stiffnesses.start + own, at.masses.start + own]
    return np.ascontiguousarray(columns, dtype=np.int64)
