# SPDX-License-Identifier: Apache-2.0
"""Free motion of springs from frame to frame, and its change with all that it depends on.

    m_n r_n^2 phi_n'' = -sum over both springs of k f df/dphi_n + g m_n r_n sin(phi_n + tilt)
                        - c phi_n' - b tanh(phi_n' / w),

with f the length of a spring less that at rest, and dry friction b, which is whole beyond rates w.
The unknowns are those of `Lengths`, then log k of each spring, log m of each rotor, c, b, log g,
the first angles and the first rates. Their sensitivities
X = dphi/dq and V = X' obey the same equation to first order,

    X' = V,    V' = (dphi''/dphi) X + (dphi''/dphi') V + dphi''/dq,

and are integrated along with it, by the classical method of Runge and Kutta.

Compiled loops take `table`, (5, N), with r, a, l, k of rotors and springs, then the inertias;
`columns`, (5, N), the places of r, a, l, log k and log m among the unknowns; `forces`, (5,), the
damping, the dry friction, the rate at which that is nearly whole, and the parts of gravity along
the chain and down from it; angles and rates, (N,), and their changes x and v, (N, Q), of which
Q = 0 makes a motion alone.
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
from soliton_linkage.identification.lengths import OF_A_ROTOR, Lengths, split_lengths
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.springs import spring_between

R, A, L, K, INERTIA = range(5)
"""Rows of the table, and but for the last of the columns, in which log m takes its place."""
M = INERTIA
"""Row of the columns of log m."""
BELOW, MAIN, ABOVE, PULL, FIRST, SECOND, BY_R, BY_NEXT_R = range(8)
BY_A, NEXT_BY_R, NEXT_BY_NEXT_R, NEXT_BY_A, RUBBING, DRAG, FALL, ACCELERATION = range(8, 16)
"""Rows of the work of springs and rotors, (16, N): diagonals, tension, levers, and second
derivatives; then the share of the friction that acts, the change of all drag with the rate, the
acceleration by gravity and that by all torques."""
DAMPING, FRICTION, SLIDING, ALONG, DOWN = range(5)
"""Places of the forces."""
Places = NDArray[np.int64]


spring = compile_loop(spring_between, inlined=True)


@compiled(const_f8_2d, const_f8_1d, f8_1d, f8_1d, f8_2d)
def accelerate(table: Array, forces: Array, angles: Array, rates: Array, work: Array) -> None:
    """Set the accelerations [rad/s^2] and the work of all springs."""
    rotors, values = angles.size, work[ACCELERATION]
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


@compiled(f8_1d, f8_1d, f8, f8_1d)
def combine(out: Array, base: Array, factor: float, other: Array) -> None:
    """Set out = base + factor other, all (Q,); out may be base."""
    for q in range(out.size):
        out[q] = base[q] + factor * other[q]


@compiled(const_f8_2d, const_i8_2d, i8, f8_1d, f8_2d, f8_2d, f8_2d, f8_2d)
def change_accelerations(
    table: Array,
    columns: Places,
    drag_column: int,
    rates: Array,
    work: Array,
    x: Array,
    v: Array,
    changes: Array,
) -> None:
    """Set the changes of accelerations, (N, Q), given the work of all springs."""
    rotors, size = x.shape
    values = work[ACCELERATION]
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


@compiled(const_f8_2d, const_i8_2d, i8, const_f8_1d, i8, f8, f8_2d, f8_3d)
def advance(
    table: Array,
    columns: Places,
    drag_column: int,
    forces: Array,
    steps: int,
    step: float,
    state: Array,
    changes: Array,
) -> None:
    """Go some steps [s] on, in place, by the classical method of Runge and Kutta.

    Angles and rates are the rows of `state`, (2, N), x and v those of `changes`, (2, N, Q).
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
                change_accelerations(
                    table,
                    columns,
                    drag_column,
                    at[1],
                    work,
                    at_changes[0],
                    at_changes[1],
                    rate_changes,
                )
            for n in range(rotors):
                sums[0, n] += weight * at[1, n]
                sums[1, n] += weight * work[ACCELERATION, n]
                at[0, n] = state[0, n] + ahead * at[1, n]
                at[1, n] = state[1, n] + ahead * work[ACCELERATION, n]
                combine(sum_changes[0, n], sum_changes[0, n], weight, at_changes[1, n])
                combine(sum_changes[1, n], sum_changes[1, n], weight, rate_changes[n])
                combine(at_changes[0, n], changes[0, n], ahead, at_changes[1, n])
                combine(at_changes[1, n], changes[1, n], ahead, rate_changes[n])
        state[:], changes[:] = sums, sum_changes


_LONGEST_STEP = 0.4
"""Of the integration, over the shortest time in which springs and masses vibrate [1]: a crossing
of 40 rotors then misses angles by 2e-5 rad at most; 0.2 by 2e-6 rad in twice the time."""
_SLIDING = 0.1
"""Rate beyond which dry friction is nearly whole [rad/s], small beside those of walls; half of it
takes more steps where there is friction."""
OF_FORCES = 3
"""Unknowns of a chain beside lengths, stiffnesses and masses: c, b and log g."""


class Parts(NamedTuple):
    """Where the unknowns of a motion stand."""

    lengths: slice
    stiffnesses: slice
    masses: slice
    forces: slice
    angles: slice
    rates: slice


def parts_of(rotors: int) -> Parts:
    """Where the unknowns of a motion of N rotors stand, those of the chain before its begin."""
    sizes = [OF_A_ROTOR * rotors - 2, rotors - 1, rotors, OF_FORCES, rotors, rotors]
    ends = np.cumsum(sizes).tolist()
    return Parts(*map(slice, [0, *ends[:-1]], ends))


@dataclass(frozen=True)
class FreeMotion:
    """Where springs and masses begin, and what moves them; lengths in any unit.

    Masses are in units of their mean, stiffnesses and damping as they follow from that.
    """

    lengths: Lengths
    stiffnesses: Array
    """k over the mean mass [1/s^2], shape (N - 1,)."""
    masses: Array
    """m over the mean mass [1], shape (N,)."""
    damping: float
    """c over the mean mass [length^2/s]."""
    angles: Array
    """At the first frame [rad], shape (N,)."""
    rates: Array
    """At the first frame [rad/s], shape (N,)."""
    friction: float = 0.0
    """Dry friction b of each rotor over the mean mass [length^2/s^2]."""
    gravity: float = 0.0
    """g, in the plane of the chain [length/s^2], 0 for none."""
    tilt: float = 0.0
    """Of the chain, above 0 where the last rotor is the lower end [rad]."""

    @property
    def parts(self) -> Parts:
        """Where its unknowns stand."""
        return parts_of(len(self.masses))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.parts.rates.stop)

    @property
    def inertias(self) -> Array:
        """Moments of inertia over the mean mass [length^2], shape (N,)."""
        return np.asarray(self.masses * self.lengths.rotor_lengths**2)

    @property
    def fastest(self) -> float:
        """Upper bound of the rates of vibrations and of their decay [rad/s]."""
        vibrations = 2 * math.sqrt(float(self.stiffnesses.max() / self.masses.min()))
        return vibrations + abs(self.friction) / _SLIDING / float(self.inertias.min())

    def changed(self, change: Array) -> FreeMotion:
        """This with a change of the unknowns."""
        lengths, springs, masses, forces, angles, rates = (change[part] for part in self.parts)
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

    def in_means(self) -> FreeMotion:
        """The same motion in units of the mean spacing and the mean mass."""
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
    """Parts of the unknowns of a chain, by the names of `Deviations`, and what has none."""
    at = parts_of((len(unknowns) + 3 - OF_FORCES) // (OF_A_ROTOR + 2))
    damping, friction, gravity = np.split(unknowns[at.forces], OF_FORCES)
    return {
        **split_lengths(unknowns[at.lengths]),
        'stiffness': unknowns[at.stiffnesses],
        'mass': unknowns[at.masses],
        'damping': damping,
        'friction': friction,
        'gravity': gravity,
    }


def frames(motion: FreeMotion, times: Array) -> Array:
    """Return the angles at each instant [rad], shape (T, N)."""
    return followed(motion, times)[0]


def followed(motion: FreeMotion, times: Array) -> tuple[Array, FreeMotion]:
    """Return the angles at each instant [rad], shape (T, N), and the motion from the last on."""
    states = [state for state, _ in _frames(motion, times, np.empty((2, len(motion.masses), 0)))]
    angles, rates = states[-1]
    return np.array([state[0] for state in states]), replace(motion, angles=angles, rates=rates)


def frames_with_changes(motion: FreeMotion, times: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the angles at each instant [rad], (N,), and their changes with unknowns, (N, Q)."""
    rotors, at = len(motion.masses), motion.parts
    changes = np.zeros((2, rotors, motion.size))
    changes[0, :, at.angles] = changes[1, :, at.rates] = np.eye(rotors)
    for state, changed in _frames(motion, times, changes):
        yield state[0], changed


def _frames(motion: FreeMotion, times: Array, changes: Array) -> Iterator[tuple[Array, Array]]:
    """Yield angles and rates, (2, N), and the changes of angles, (N, Q), at each instant."""
    state = np.array([motion.angles, motion.rates])
    chain = _table(motion), _columns(motion), motion.parts.forces.start
    along, down = motion.gravity * math.sin(motion.tilt), motion.gravity * math.cos(motion.tilt)
    forces = np.array([motion.damping, motion.friction, _SLIDING, along, down])
    yield state.copy(), changes[0].copy()
    for span in np.diff(times).tolist():
        steps = max(1, math.ceil(span * motion.fastest / _LONGEST_STEP))
        advance(*chain, forces, steps, span / steps, state, changes)
        yield state.copy(), changes[0].copy()


def _table(motion: FreeMotion) -> Array:
    lengths, rotors = motion.lengths, len(motion.masses)
    table = np.zeros((5, rotors))
    table[R] = lengths.rotor_lengths
    table[A, :-1] = lengths.spacings
    table[L, :-1] = lengths.rest_lengths
    table[K, :-1] = motion.stiffnesses
    table[INERTIA] = motion.inertias
    return table


def _columns(motion: FreeMotion) -> Places:
    """Places of r, a, l, log k and log m of each rotor among the unknowns, shape (5, N)."""
    own, at = np.arange(len(motion.masses)), motion.parts
    r = OF_A_ROTOR * own
    columns = [r, r + 2, r + 3, at.stiffnesses.start + own, at.masses.start + own]
    return np.ascontiguousarray(columns, dtype=np.int64)
