# SPDX-License-Identifier: Apache-2.0
"""Mass ratios of rigid bars, by the free motion that they leave.

Bars leave one degree of freedom, the arc s of the orbit. With phi(s) and its tangent t the chain
moves as

    sqrt(I) ds/dt = u,    I = sum_n m_n r_n^2 t_n^2,
    sqrt(I) du/dt = sum_n m_n r_n g sin(phi_n + tilt) t_n - c ds/dt
                    - b tanh(ds/dt / w) sum_n |t_n|,

so that u keeps still without gravity and drag: a wall is slow where the rotors under it are heavy.
Least squares between the arcs of a motion and those of the frames, each of the noise of a single
reading, give the masses over their mean. What is unsure of lengths and offsets moves the arcs of
all frames together: independent combinations of them, each of unit variance, are unknowns too.
Where lengths and offsets are off by dp, the orbit of the true chain is nearest to that of the one
that is known at

    dphi = -R^T (R R^T)^-1 (df/dp) dp

from its configuration at the same arc, and frames seem to be at arcs that are t . do further on.
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
from soliton_linkage.identification.bundle import factor, misclosures
from soliton_linkage.identification.free_motion import OF_FORCES
from soliton_linkage.identification.lengths import Lengths, split
from soliton_linkage.identification.readings import Readings
from soliton_linkage.identification.windows import (
    MASSES_BEGIN,
    free_spans,
    learnt_spread,
    spreads_of_forces,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit


def _acceleration(
    arc: float,
    speed: float,
    roots: Array,
    pulls: Array,
    rubbing: Array,
    column: int,
    grid: Array,
    drags: Array,
) -> tuple[float, float]:
    """Changes of arc and speed in time, by rows of the grid between which there are lines."""
    at = (arc - grid[0]) / grid[1]
    row = 0
    if at > 0.0:
        row = int(min(at, len(rubbing) - 2.0))
    part = min(max(at - row, 0.0), 1.0)
    root = (1 - part) * roots[row, column] + part * roots[row + 1, column]
    rub = (1 - part) * rubbing[row] + part * rubbing[row + 1]
    pull = (1 - part) * pulls[row, column] + part * pulls[row + 1, column]
    rate = speed / root
    drag = drags[0, column] * rate + drags[1, column] * rub * math.tanh(rate / grid[2])
    return rate, (pull - drag) / root


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
    pulls: Array,
    rubbing: Array,
    grid: Array,
    drags: Array,
    times: Array,
    begin: Array,
    arcs: Array,
) -> None:
    """Set arcs at times, (T, K), of K motions along an orbit from `begin`, arcs and speeds (2, K).

    On a grid of G arcs, which begins at grid[0] and is grid[1] apart, are the roots of the
    inertias and the pulls of gravity, (G, K), and the rubbing, (G,); `drags` are damping and dry
    friction, (2, K), which is nearly whole at the rate grid[2]. By the classical method of Runge
    and Kutta.
    """
    for k in range(begin.shape[1]):
        s, u = begin[0, k], begin[1, k]
        arcs[0, k] = s
        for n in range(1, len(times)):
            step = times[n] - times[n - 1]
            half = step / 2
            s1, u1 = acceleration(s, u, roots, pulls, rubbing, k, grid, drags)
            s2, u2 = acceleration(
                s + half * s1, u + half * u1, roots, pulls, rubbing, k, grid, drags
            )
            s3, u3 = acceleration(
                s + half * s2, u + half * u2, roots, pulls, rubbing, k, grid, drags
            )
            s4, u4 = acceleration(
                s + step * s3, u + step * u3, roots, pulls, rubbing, k, grid, drags
            )
            s += step / 6 * (s1 + 2 * s2 + 2 * s3 + s4)
            u += step / 6 * (u1 + 2 * u2 + 2 * u3 + u4)
            arcs[n, k] = s


GRID = 0.03
"""Between arcs of the tables [rad]: half of it changes masses by 1e-4."""


class Along(NamedTuple):
    """What moves bars, at the arcs of a grid, of K chains or changes of one."""

    inertia: Array
    """sum m r^2 t^2, shape (G, K)."""
    weight: NDArray[np.complex128]
    """sum m r t (cos phi + i sin phi), shape (G, K)."""


class AlongOrbit:
    """Configurations at even arcs of an orbit, and sums over the rotors there."""

    def __init__(self, orbit: Orbit, lengths: Lengths, arcs: Array) -> None:
        """Lay out a grid that holds some arcs [rad], and a site more on each side."""
        self._lengths = lengths
        self.begin = float(np.nanmin(arcs)) - orbit.site_arc
        """First arc of the grid [rad]."""
        count = math.ceil((float(np.nanmax(arcs)) + orbit.site_arc - self.begin) / GRID)
        grid = self.begin + GRID * np.arange(count + 1)
        self._angles = np.array([orbit.configuration(arc) for arc in grid.tolist()])
        self._tangents = np.array([orbit.tangent(arc) for arc in grid.tolist()])
        r = lengths.rotor_lengths
        self._inertias = (r * self._tangents) ** 2
        self._weights = r * self._tangents * np.exp(1j * self._angles)
        self.rubbing = np.abs(self._tangents).sum(axis=1)
        """sum |t|, shape (G,)."""

    def place(self, arcs: Array) -> tuple[NDArray[np.intp], Array]:
        """Row of the grid before each arc [rad], and the part of the way to the next [1]."""
        at = (arcs - self.begin) / GRID
        row = np.clip(at, 0, len(self.rubbing) - 2).astype(np.intp)
        return row, np.clip(at - row, 0.0, 1.0)

    def tangents(self, arcs: Array) -> Array:
        """Unit tangents at arcs [rad], (T, N)."""
        row, part = self.place(arcs)
        before, after = self._tangents[row], self._tangents[row + 1]
        return np.asarray(before + part[:, None] * (after - before))

    def of_masses(self, masses: Array) -> Along:
        """Sums for masses [1], of which each column is of a chain, shape (N, K)."""
        return Along(self._inertias @ masses, self._weights @ masses)

    def changes(self, masses: Array, changes: Array) -> Along:
        """Changes of these sums for masses [1], (N,), with changes of the unknowns, (P, K)."""
        t, r = self._tangents, self._lengths.rotor_lengths
        about = misclosures(self._lengths, self._angles.T)
        factors = factor(about.first, about.second, np.ones_like(t.T))
        turns = r * np.exp(1j * self._angles)
        inertia = np.empty((len(t), changes.shape[1]))
        weight = inertia.astype(np.complex128)
        for column, change in enumerate(changes.T):
            rotor, _, spacing, rest = split(change)
            of_bonds = (rotor[:-1], 0 * rest, spacing, rest, rotor[1:], 0 * rest)
            closing = np.einsum('ngu,un->ng', about.slopes, np.array(of_bonds))
            moved = -about.pulled(factors.solved(factors.whitened(closing))).T
            along = np.gradient(moved, GRID, axis=0) + rotor * t
            inertia[:, column] = 2 * (r**2 * t * along) @ masses
            weight[:, column] = (turns * (along + 1j * t * moved)) @ masses
        return Along(inertia, weight)


def arcs_of(orbit: Orbit, angles: Array, noise: float) -> tuple[Array, Array]:
    """Arc of each frame and its standard deviation [rad], shape (T,) each."""
    arc = fit_anywhere(orbit, angles[0]).arc
    found = []
    for frame in angles:
        nearest = fit_near(orbit, frame, arc)
        arc = nearest.arc
        found.append((arc, noise / math.sqrt(max(nearest.information, 1e-6))))
    arcs, spreads = np.array(found).T
    return arcs, spreads


_SLIDING = 0.1
"""Rate beyond which dry friction is nearly whole [rad/s], small beside those of walls."""
_ROUNDS = 2
"""Times that the standard deviation of masses is learnt [1]."""
_KNOWN = 1e-6
"""Standard deviation of the logarithm of gravity that is known [1]."""
_FREE = 1.5
"""Noise that is left of arcs over that of readings [1], beyond which something else moved them."""
_MOST_STEPS = 15
"""Of least squares for a given standard deviation of masses [1]; 4 to 6 are usual."""
_SETTLED = 1e-4
"""Gain of a step over the sum of squares that ends them [1]: of 1000 frames a tenth of what chance
changes."""
_OF_RATES = 8
"""Frames by which the rate at the begin is told [1]."""
_STEP = 1e-4
"""Of unknowns, to have the slopes of arcs [1]."""
_TOLD = 1e-9
"""Variance of a combination of lengths over the largest [1], below which it is rounding."""


class BarMotion(NamedTuple):
    """What a free motion shows, in lengths of the mean spacing and masses of the mean mass."""

    masses: Array
    """[1], shape (N,)."""
    mass_deviations: Array
    """Standard deviations of their logarithms [1], shape (N,)."""
    drag: tuple[float, float]
    """Damping [1/s] and dry friction [1/s^2]."""
    drag_deviations: tuple[float, float]
    gravity: float
    """[1/s^2]."""
    gravity_deviation: float
    """Standard deviation of its logarithm [1], 0 where it is known."""


def bar_motion(
    readings: Readings, lengths: Lengths, covariance: Array, noise: float, gravity_known: bool
) -> BarMotion | None:
    """What free motions of bars show, None where something else moves the chain.

    Lengths in units of the mean spacing have a covariance (P, P); the noise is that of a reading
    [rad]. Gravity is in units of the mean spacing too.
    """
    orbit = orbit_of(lengths.chain(Chain()))
    spans = free_spans(readings.times, readings.breaks)
    if not spans:
        return None
    angles = readings.seen - lengths.offsets
    arcs, spreads = np.full((2, len(angles)), np.nan)
    for span in spans:
        arcs[span], spreads[span] = arcs_of(orbit, angles[span], noise)
    fit = _Fit(AlongOrbit(orbit, lengths, arcs), readings, spans, arcs, spreads, gravity_known)
    fit.solve(MASSES_BEGIN)
    rotors, combinations = lengths.rotors, _combinations(covariance)
    for _ in range(_ROUNDS):
        fit.loosen(combinations)
        masses = fit.masses
        squares = float(np.sum(masses**2) + np.trace(fit.covariance[:rotors, :rotors]))
        fit.solve(learnt_spread(squares, rotors))
        if fit.excess > _FREE:
            return None
    return fit.found()


def _combinations(covariance: Array) -> Array:
    """Changes of the unknowns of lengths that are independent, of unit variance, (P, K)."""
    values, vectors = np.linalg.eigh(covariance)
    told = values > _TOLD * values[-1]
    return np.asarray(vectors[:, told] * np.sqrt(values[told]))


class _Fit:
    """Least squares between the arcs of motions and those of frames.

    The unknowns are logarithms of masses, forces, the begin of each span, and combinations of
    lengths and offsets.
    """

    def __init__(
        self,
        along: AlongOrbit,
        readings: Readings,
        spans: Sequence[slice],
        arcs: Array,
        spreads: Array,
        gravity_known: bool,
    ) -> None:
        self._along, self._times, self._spans = along, readings.times, spans
        self._arcs, self._spreads = arcs, spreads
        self._gravity = readings.gravity.acceleration
        self._known = gravity_known or not self._gravity
        self._tilts = [readings.tilt_at(readings.times[span.start]) for span in spans]
        self._rotors = readings.angles.shape[1]
        self._size = self._rotors + OF_FORCES
        frames = sum(span.stop - span.start for span in spans)
        self._loose = np.empty((frames, 0))
        self._unknowns = np.zeros(self._size)
        self._unknowns = np.concatenate([self._unknowns, *map(self._begin, spans)])
        self.covariance = np.empty((0, 0))
        self.excess = 1.0
        """Noise that is left of arcs over that of readings [1]."""

    @property
    def masses(self) -> Array:
        """Their logarithms [1], (N,)."""
        return self._unknowns[: self._rotors]

    def _begin(self, span: slice) -> Array:
        """Arc, and speed u, at the begin of a span."""
        few = slice(span.start, span.start + _OF_RATES)
        rate, arc = np.polyfit(self._times[few] - self._times[span.start], self._arcs[few], 1)
        row, _ = self._along.place(np.array(arc))
        inertia = self._along.of_masses(np.ones(self._rotors)).inertia[row]
        return np.array([arc, rate * math.sqrt(float(inertia))])

    def solve(self, spread: float) -> None:
        """Find the unknowns for masses with a standard deviation [1]."""
        inertia = float(self._along.of_masses(np.ones(self._rotors)).inertia.mean())
        forces = spreads_of_forces(inertia)
        if self._known:
            forces[-1] = _KNOWN
        prior = np.concatenate([np.full(self._rotors, spread), forces])
        count, loose = len(self._unknowns), self._loose.shape[1]
        least = np.concatenate([prior, np.ones(2 * len(self._spans))])

        def left(unknowns: Array) -> Array:
            of_motion, combinations = np.split(unknowns, [count])
            parts = [
                (self._moved(of_motion[:, None], number)[:, 0] - self._arcs[span])
                / self._spreads[span]
                for number, span in enumerate(self._spans)
            ]
            arcs = np.concatenate(parts) + self._loose @ combinations
            return np.concatenate([arcs, of_motion[: self._size] / prior, combinations])

        def slopes(unknowns: Array) -> Array:
            steps = _STEP * np.maximum(np.abs(unknowns[:count]), least)
            rows = []
            for number, span in enumerate(self._spans):
                own = self._size + 2 * number
                columns = [*range(self._size), own, own + 1]
                moved = np.repeat(unknowns[:count, None], 1 + len(columns), axis=1)
                moved[columns, 1 + np.arange(len(columns))] += steps[columns]
                arcs = self._moved(moved, number)
                part = np.zeros((span.stop - span.start, count))
                part[:, columns] = (arcs[:, 1:] - arcs[:, :1]) / steps[columns]
                rows.append(part / self._spreads[span][:, None])
            arcs = np.hstack([np.concatenate(rows), self._loose])
            known = np.concatenate([1 / prior, np.zeros(2 * len(self._spans)), np.ones(loose)])
            return np.concatenate([arcs, np.diag(known)[known > 0]])

        start = np.concatenate([self._unknowns, np.zeros(loose)])
        found = least_squares(
            left, start, jac=slopes, x_scale='jac', ftol=_SETTLED, max_nfev=_MOST_STEPS
        )
        self._unknowns = found.x[:count]
        frames = len(self._loose)
        squares = float(np.sum(found.fun[:frames] ** 2))
        self.excess = math.sqrt(squares / max(frames - count, 1))
        self.covariance = np.linalg.inv(found.jac.T @ found.jac) * max(self.excess, 1.0) ** 2

    def loosen(self, combinations: Array) -> None:
        """Let combinations of lengths and offsets, (P, K), each be unsure by 1 from now on."""
        changes = self._along.changes(np.exp(self.masses), combinations)
        offsets = split(combinations.T)[1].T
        rows = []
        for number, span in enumerate(self._spans):
            still = np.repeat(self._unknowns[:, None], 1 + offsets.shape[1], axis=1)
            arcs = self._moved(still, number, changes)
            apparent = self._along.tangents(self._arcs[span]) @ offsets
            moved = (arcs[:, 1:] - arcs[:, :1]) / _STEP
            rows.append((moved + apparent) / self._spreads[span][:, None])
        self._loose = np.concatenate(rows)

    def _moved(self, unknowns: Array, number: int, changes: Along | None = None) -> Array:
        """Arcs in the frames of a span [rad], (T, K), of K columns of unknowns.

        All columns but the first with a step of changes of the chain, where there are any.
        """
        span, along = self._spans[number], self._along
        damping, friction, fallen = unknowns[self._rotors : self._size]
        inertia, weight = along.of_masses(np.exp(unknowns[: self._rotors]))
        if changes is not None:
            inertia[:, 1:] += _STEP * changes.inertia
            weight[:, 1:] += _STEP * changes.weight
        roots = np.sqrt(inertia)
        turned = np.exp(1j * self._tilts[number])
        pulls = (weight * turned).imag * self._gravity * np.exp(fallen)
        grid = np.array([along.begin, GRID, _SLIDING])
        own = self._size + 2 * number
        begin = np.ascontiguousarray(unknowns[own : own + 2])
        drags = np.stack([damping, friction])
        times = self._times[span]
        arcs = np.empty((len(times), unknowns.shape[1]))
        move_along(roots, pulls, along.rubbing, grid, drags, times, begin, arcs)
        return arcs

    def found(self) -> BarMotion:
        """What was found, in units of the mean mass."""
        masses, rotors = np.exp(self.masses), self._rotors
        mean = float(masses.mean())
        alike = np.eye(rotors) - masses / (rotors * mean)
        of_masses = np.diag(alike @ self.covariance[:rotors, :rotors] @ alike.T)
        forces = slice(rotors, self._size)
        damping, friction, fallen = self._unknowns[forces].tolist()
        of_damping, of_friction, of_gravity = np.sqrt(np.diag(self.covariance))[forces].tolist()
        return BarMotion(
            masses / mean,
            np.sqrt(of_masses),
            (damping / mean, friction / mean),
            (of_damping / mean, of_friction / mean),
            self._gravity * math.exp(fallen),
            0.0 if self._known else of_gravity,
        )
