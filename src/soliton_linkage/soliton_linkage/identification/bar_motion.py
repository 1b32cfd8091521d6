# SPDX-License-Identifier: Apache-2.0
"""Relative masses of the rotors of a chain of rigid bars, from the free motion of the chain.

The angles phi of the rotors move along a curve, the orbit. With its arc length s [rad], its unit
tangent t, and a mass-weighted speed u, the equations of motion are

    sqrt(I) ds/dt = u,    I = sum_n m_n r_n^2 t_n^2,
    sqrt(I) du/dt = sum_n m_n r_n g sin(phi_n + tilt) t_n
                    - c ds/dt - b tanh(ds/dt / w) sum_n |t_n|,

with the masses m_n, the rotor lengths r_n, gravity g, the damping c, and the dry friction b, whose
torque is nearly constant at rates above w.

Let dp be the true minus the estimated logarithms of the lengths, and e the true minus the
estimated encoder offsets. The angles of the true orbit minus the angles of the estimated orbit are
-R^T (R R^T)^-1 (df/dp) dp, where f are the misclosures of the bonds (see `bundle`) and
R = df/dphi. The arc lengths that are computed from the readings are too large by t^T e.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from soliton_linkage.compiling import compile_loop, compiled, const_f8_1d, const_f8_2d, f8_2d
from soliton_linkage.estimation.relocalisation import fit_anywhere, fit_near
from soliton_linkage.identification.bundle import cholesky_factor, misclosures
from soliton_linkage.identification.free_motion import FORCE_UNKNOWNS
from soliton_linkage.identification.lengths import Lengths, split
from soliton_linkage.identification.readings import Readings
from soliton_linkage.identification.windows import (
    INITIAL_MASS_DEVIATION,
    estimated_deviation,
    force_deviations,
    free_intervals,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit

_GRID = 0.03
"""Step of the arc length in `_OrbitTable` [rad]. With half this step, the estimated masses change
by 1e-4 of their values."""
_SLIDING = 0.1
"""Rate w above which dry friction is nearly constant [rad/s]; rotors in walls turn faster."""
_ROUNDS = 2
"""Number of times that the prior of the log masses is estimated and the fit is repeated [1]."""
_KNOWN = 1e-6
"""Prior standard deviation of log gravity if gravity is known [1]."""
_LARGEST_EXCESS = 1.5
"""`bar_motion` returns None if the ratio of residual noise to reading noise is larger than this
[1], because the motion is then probably not free."""
_MOST_STEPS = 15
"""Largest number of evaluations of the residuals in a fit [1]; 4 to 6 are usual."""
_CONVERGED = 1e-4
"""A fit ends when a step decreases the sum of squares by less than this fraction [1]; noise
changes the sum by 10 times this fraction."""
_RATE_FRAMES = 8
"""Number of frames at the start of a free motion from which its initial speed is estimated [1]."""
_STEP = 1e-4
"""The step of a numerical derivative by an unknown is this times the absolute value of the unknown
or its prior standard deviation, whichever is larger [1]."""
_INFORMED = 1e-9
"""A combination of length errors is neglected if its variance is smaller than this fraction of the
largest variance [1], because it is then a rounding error."""


def _acceleration(
    arc: float,
    speed: float,
    roots: Array,
    gravity: Array,
    friction: Array,
    column: int,
    grid: Array,
    drags: Array,
) -> tuple[float, float]:
    at = (arc - grid[0]) / grid[1]
    row = 0
    if at > 0.0:
        row = int(min(at, len(friction) - 2.0))
    part = min(max(at - row, 0.0), 1.0)
    root = (1 - part) * roots[row, column] + part * roots[row + 1, column]
    lever = (1 - part) * friction[row] + part * friction[row + 1]
    force = (1 - part) * gravity[row, column] + part * gravity[row + 1, column]
    rate = speed / root
    drag = drags[0, column] * rate + drags[1, column] * lever * math.tanh(rate / grid[2])
    return rate, (force - drag) / root


acceleration = compile_loop(_acceleration, inlined=True)


@compiled(
    const_f8_2d,
    const_f8_2d,
    const_f8_1d,
    const_f8_1d,
    const_f8_2d,
    const_f8_1d,
    const_f8_2d,
    f8_2d,
)
def move_along(
    roots: Array,
    gravity: Array,
    friction: Array,
    grid: Array,
    drags: Array,
    times: Array,
    begin: Array,
    arcs: Array,
) -> None:
    """Compute the arc lengths [rad] of K motions along one orbit at T `times` [s].

    The motions differ in the unknowns (masses, drag, gravity, initial state), so that numerical
    derivatives can be computed. The results are stored in `arcs`, (T, K). `begin`, (2, K),
    contains the initial arc lengths and speeds u. `drags`, (2, K), contains damping and dry
    friction.

    At G arc lengths, `roots`, (G, K), contains sqrt(I); `gravity`, (G, K), contains sum_n m_n r_n
    g sin(phi_n + tilt) t_n; and `friction`, (G,), contains sum_n |t_n|. `grid` contains the first
    of these arc lengths, the step between them, and the rate w.
    """
    for k in range(begin.shape[1]):
        s, u = begin[0, k], begin[1, k]
        arcs[0, k] = s
        for n in range(1, len(times)):
            step = times[n] - times[n - 1]
            half = step / 2
            s1, u1 = acceleration(s, u, roots, gravity, friction, k, grid, drags)
            s2, u2 = acceleration(
                s + half * s1, u + half * u1, roots, gravity, friction, k, grid, drags
            )
            s3, u3 = acceleration(
                s + half * s2, u + half * u2, roots, gravity, friction, k, grid, drags
            )
            s4, u4 = acceleration(
                s + step * s3, u + step * u3, roots, gravity, friction, k, grid, drags
            )
            s += step / 6 * (s1 + 2 * s2 + 2 * s3 + s4)
            u += step / 6 * (u1 + 2 * u2 + 2 * u3 + u4)
            arcs[n, k] = s


class _Sums(NamedTuple):
    inertia: Array
    weight: NDArray[np.complex128]


class _OrbitTable:
    def __init__(self, orbit: Orbit, lengths: Lengths, arcs: Array) -> None:
        self._lengths = lengths
        self.begin = float(np.nanmin(arcs)) - orbit.site_arc
        count = math.ceil((float(np.nanmax(arcs)) + orbit.site_arc - self.begin) / _GRID)
        grid = self.begin + _GRID * np.arange(count + 1)
        self._angles = np.array([orbit.configuration(arc) for arc in grid.tolist()])
        self._tangents = np.array([orbit.tangent(arc) for arc in grid.tolist()])
        r = lengths.rotor_lengths
        self._inertias = (r * self._tangents) ** 2
        self._weights = r * self._tangents * np.exp(1j * self._angles)
        self.friction = np.abs(self._tangents).sum(axis=1)

    def locate(self, arcs: Array) -> tuple[NDArray[np.intp], Array]:
        at = (arcs - self.begin) / _GRID
        row = np.clip(at, 0, len(self.friction) - 2).astype(np.intp)
        return row, np.clip(at - row, 0.0, 1.0)

    def tangents(self, arcs: Array) -> Array:
        row, part = self.locate(arcs)
        before, after = self._tangents[row], self._tangents[row + 1]
        return np.asarray(before + part[:, None] * (after - before))

    def sums(self, masses: Array) -> _Sums:
        return _Sums(self._inertias @ masses, self._weights @ masses)

    def changes(self, masses: Array, changes: Array) -> _Sums:
        t, r = self._tangents, self._lengths.rotor_lengths
        linearised = misclosures(self._lengths, self._angles.T)
        factors = cholesky_factor(linearised.first, linearised.second, np.ones_like(t.T))
        turns = r * np.exp(1j * self._angles)
        inertia = np.empty((len(t), changes.shape[1]))
        weight = inertia.astype(np.complex128)
        for column, change in enumerate(changes.T):
            rotor, _, spacing, rest = split(change)
            bonds = (rotor[:-1], 0 * rest, spacing, rest, rotor[1:], 0 * rest)
            misclosure = np.einsum('ngu,un->ng', linearised.slopes, np.array(bonds))
            torques = linearised.torques(factors.solved(factors.whitened(misclosure)))
            moved = -torques.T
            stretch = np.gradient(moved, _GRID, axis=0) + rotor * t
            inertia[:, column] = 2 * (r**2 * t * stretch) @ masses
            weight[:, column] = (turns * (stretch + 1j * t * moved)) @ masses
        return _Sums(inertia, weight)


def _arcs_of(orbit: Orbit, angles: Array, noise: float) -> tuple[Array, Array]:
    arc = fit_anywhere(orbit, angles[0]).arc
    found = []
    for frame in angles:
        nearest = fit_near(orbit, frame, arc)
        arc = nearest.arc
        found.append((arc, noise / math.sqrt(max(nearest.information, 1e-6))))
    arcs, deviations = np.array(found).T
    return arcs, deviations


class BarMotion(NamedTuple):
    """Masses, drag and gravity from free motions, in units of the mean spacing and mean mass."""

    masses: Array
    mass_deviations: Array
    """Standard deviations of the natural logarithms of the masses [1], (N,)."""
    drag: tuple[float, float]
    """Damping [1/s] and dry friction [1/s^2] of each rotor."""
    drag_deviations: tuple[float, float]
    gravity: float
    gravity_deviation: float
    """Standard deviation of the logarithm of gravity [1]; 0 if gravity is known."""


def bar_motion(
    readings: Readings, lengths: Lengths, covariance: Array, noise: float, gravity_known: bool
) -> BarMotion | None:
    """Estimate masses, drag and gravity from free motions; return None if this is not possible.

    The result is None if no free motion has enough frames, or if the residuals are so large that
    other forces probably acted. `covariance` is the covariance of the unknowns of `lengths`, and
    `noise` is the standard deviation of a reading [rad]. Gravity is estimated unless
    `gravity_known`.
    """
    orbit = orbit_of(lengths.chain(Chain()))
    intervals = free_intervals(readings.times, readings.interruptions)
    if not intervals:
        return None
    angles = readings.unwrapped - lengths.offsets
    arcs, deviations = np.full((2, len(angles)), np.nan)
    for each in intervals:
        arcs[each], deviations[each] = _arcs_of(orbit, angles[each], noise)
    table = _OrbitTable(orbit, lengths, arcs)
    fit = _Fit(table, readings, intervals, arcs, deviations, gravity_known)
    fit.solve(INITIAL_MASS_DEVIATION)
    rotors, combinations = lengths.rotors, _combinations(covariance)
    for _ in range(_ROUNDS):
        fit.add_combinations(combinations)
        masses = fit.masses
        squares = float(np.sum(masses**2) + np.trace(fit.covariance[:rotors, :rotors]))
        fit.solve(estimated_deviation(squares, rotors))
        if fit.excess > _LARGEST_EXCESS:
            return None
    return fit.result()


def _combinations(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance)
    informed = values > _INFORMED * values[-1]
    return np.asarray(vectors[:, informed] * np.sqrt(values[informed]))


class _Fit:
    def __init__(
        self,
        table: _OrbitTable,
        readings: Readings,
        intervals: Sequence[slice],
        arcs: Array,
        deviations: Array,
        gravity_known: bool,
    ) -> None:
        self._table, self._times, self._intervals = table, readings.times, intervals
        self._arcs, self._deviations = arcs, deviations
        self._gravity = readings.gravity.acceleration
        self._known = gravity_known or not self._gravity
        self._tilts = [readings.tilt_at(readings.times[each.start]) for each in intervals]
        self._rotors = readings.angles.shape[1]
        self._size = self._rotors + FORCE_UNKNOWNS
        frames = sum(each.stop - each.start for each in intervals)
        self._combined = np.empty((frames, 0))
        self._unknowns = np.concatenate([np.zeros(self._size), *map(self._begin, intervals)])
        self.covariance = np.empty((0, 0))
        self.excess = 1.0

    @property
    def masses(self) -> Array:
        return self._unknowns[: self._rotors]

    def _begin(self, interval: slice) -> Array:
        few = slice(interval.start, interval.start + _RATE_FRAMES)
        rate, arc = np.polyfit(self._times[few] - self._times[interval.start], self._arcs[few], 1)
        row, _ = self._table.locate(np.array(arc))
        inertia = self._table.sums(np.ones(self._rotors)).inertia[row]
        return np.array([arc, rate * math.sqrt(float(inertia))])

    def solve(self, mass_deviation: float) -> None:
        inertia = float(self._table.sums(np.ones(self._rotors)).inertia.mean())
        forces = force_deviations(inertia)
        if self._known:
            forces[-1] = _KNOWN
        prior = np.concatenate([np.full(self._rotors, mass_deviation), forces])
        count, combinations = len(self._unknowns), self._combined.shape[1]
        least = np.concatenate([prior, np.ones(2 * len(self._intervals))])

        def residuals(unknowns: Array) -> Array:
            motion, others = np.split(unknowns, [count])
            parts = [
                (self._moved(motion[:, None], number)[:, 0] - self._arcs[interval])
                / self._deviations[interval]
                for number, interval in enumerate(self._intervals)
            ]
            arcs = np.concatenate(parts) + self._combined @ others
            return np.concatenate([arcs, motion[: self._size] / prior, others])

        def jacobian(unknowns: Array) -> Array:
            steps = _STEP * np.maximum(np.abs(unknowns[:count]), least)
            rows = []
            for number, interval in enumerate(self._intervals):
                own = self._size + 2 * number
                columns = [*range(self._size), own, own + 1]
                moved = np.repeat(unknowns[:count, None], 1 + len(columns), axis=1)
                moved[columns, 1 + np.arange(len(columns))] += steps[columns]
                arcs = self._moved(moved, number)
                part = np.zeros((interval.stop - interval.start, count))
                part[:, columns] = (arcs[:, 1:] - arcs[:, :1]) / steps[columns]
                rows.append(part / self._deviations[interval][:, None])
            arcs = np.hstack([np.concatenate(rows), self._combined])
            states = np.zeros(2 * len(self._intervals))
            weights = np.concatenate([1 / prior, states, np.ones(combinations)])
            return np.concatenate([arcs, np.diag(weights)[weights > 0]])

        start = np.concatenate([self._unknowns, np.zeros(combinations)])
        found = least_squares(
            residuals, start, jac=jacobian, x_scale='jac', ftol=_CONVERGED, max_nfev=_MOST_STEPS
        )
        self._unknowns = found.x[:count]
        frames = len(self._combined)
        squares = float(np.sum(found.fun[:frames] ** 2))
        self.excess = math.sqrt(squares / max(frames - count, 1))
        self.covariance = np.linalg.inv(found.jac.T @ found.jac) * max(self.excess, 1.0) ** 2

    def add_combinations(self, combinations: Array) -> None:
        changes = self._table.changes(np.exp(self.masses), combinations)
        offsets = split(combinations.T)[1].T
        rows = []
        for number, interval in enumerate(self._intervals):
            same = np.repeat(self._unknowns[:, None], 1 + offsets.shape[1], axis=1)
            arcs = self._moved(same, number, changes)
            apparent = self._table.tangents(self._arcs[interval]) @ offsets
            moved = (arcs[:, 1:] - arcs[:, :1]) / _STEP
            rows.append((moved + apparent) / self._deviations[interval][:, None])
        self._combined = np.concatenate(rows)

    def _moved(self, unknowns: Array, number: int, changes: _Sums | None = None) -> Array:
        table = self._table
        damping, friction, log_gravity = unknowns[self._rotors : self._size]
        inertia, weight = table.sums(np.exp(unknowns[: self._rotors]))
        if changes is not None:
            inertia[:, 1:] += _STEP * changes.inertia
            weight[:, 1:] += _STEP * changes.weight
        roots = np.sqrt(inertia)
        turned = np.exp(1j * self._tilts[number])
        gravity = (weight * turned).imag * self._gravity * np.exp(log_gravity)
        grid = np.array([table.begin, _GRID, _SLIDING])
        own = self._size + 2 * number
        begin = np.ascontiguousarray(unknowns[own : own + 2])
        drags = np.stack([damping, friction])
        times = self._times[self._intervals[number]]
        arcs = np.empty((len(times), unknowns.shape[1]))
        move_along(roots, gravity, table.friction, grid, drags, times, begin, arcs)
        return arcs

    def result(self) -> BarMotion:
        masses, rotors = np.exp(self.masses), self._rotors
        mean = float(masses.mean())
        relative = np.eye(rotors) - masses / (rotors * mean)
        variances = np.diag(relative @ self.covariance[:rotors, :rotors] @ relative.T)
        forces = slice(rotors, self._size)
        damping, friction, log_gravity = self._unknowns[forces].tolist()
        deviations = np.sqrt(np.diag(self.covariance))[forces].tolist()
        return BarMotion(
            masses / mean,
            np.sqrt(variances),
            (damping / mean, friction / mean),
            (deviations[0] / mean, deviations[1] / mean),
            self._gravity * math.exp(log_gravity),
            0.0 if self._known else deviations[2],
        )
