# SPDX-License-Identifier: Apache-2.0
"""Mass ratios of rigid bars, by the free motion that they leave.

Bars leave one degree of freedom, the arc s of the orbit. With phi(s) and its tangent t the chain
moves as

    sqrt(I) ds/dt = u,    I = sum_n m_n r_n^2 t_n^2,
    sqrt(I) du/dt = sum_n m_n r_n g sin(phi_n + tilt) t_n - c ds/dt
                    - b tanh(ds/dt / w) sum_n |t_n|,

so that u keeps still without gravity and drag: a wall is slow where the rotors under it are heavy.
Least squares between the arcs of a motion and those of the frames, each of the noise of a single
reading, give the masses over their mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from soliton_linkage.estimation.nearest_point import fit_anywhere, fit_near
from soliton_linkage.identification.geometry.lengths import Lengths, split
from soliton_linkage.identification.motion.windows import free_spans
from soliton_linkage.identification.readings import Readings
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit

_GRID = 0.03
"""Between arcs of the tables [rad]: half of it changes masses by 1e-4."""
_SLIDING = 0.1
"""Rate beyond which dry friction is nearly whole [rad/s], small beside those of walls."""
_BEGIN = 0.1
"""Standard deviation of masses to begin with [1]."""
_NARROWEST, _WIDEST = 1e-3, 0.3
"""Of the standard deviation of masses that is learnt [1]."""
_ROUNDS = 3
"""Times that it is learnt [1]."""
_DECAY, _STOPPING, _FALLING = 1.0, 10.0, 1.0
"""Standard deviations of damping [1/s] and friction [rad/s^2] over the inertia of a rotor, and of
the logarithm of gravity [1], before any frame."""
_KNOWN = 1e-6
"""The last of these where gravity is known [1]."""
_FREE = 1.5
"""Noise that is left of arcs over that of readings [1], beyond which something else moved them."""
_MOST_STEPS = 15
"""Of least squares for a given standard deviation of masses [1]; 4 to 6 are usual."""
_OF_RATES = 8
"""Frames by which the rate at the begin is told [1]."""
_STEP = 1e-4
"""Of unknowns, to have the slopes of arcs [1]."""
_OF_FORCES = 3
"""Damping, friction and log gravity."""


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
    """Standard deviation of its logarithm [1]."""


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
        arcs[span], spreads[span] = _arcs_of(orbit, angles[span], noise)
    tables = _AlongOrbit(orbit, lengths, arcs)
    fit = _Fit(tables, readings, spans, arcs, spreads, gravity_known)
    spread = _BEGIN
    for _ in range(_ROUNDS):
        solution, inverse = fit.solved(spread)
        if fit.excess > _FREE:
            return None
        rotors = lengths.rotors
        masses = solution[:rotors]
        total = float(np.sum(masses**2) + np.trace(inverse[:rotors, :rotors]))
        spread = min(max(math.sqrt(total / rotors), _NARROWEST), _WIDEST)
    return _motion(fit, solution, inverse, covariance)


class _AlongOrbit:
    """Parts of inertia, weight and friction along the orbit, by rotors."""

    def __init__(self, orbit: Orbit, lengths: Lengths, arcs: Array) -> None:
        self.begin = float(np.nanmin(arcs)) - orbit.site_arc
        count = math.ceil((float(np.nanmax(arcs)) + orbit.site_arc - self.begin) / _GRID)
        grid = self.begin + _GRID * np.arange(count + 1)
        angles = np.array([orbit.configuration(arc) for arc in grid.tolist()])
        tangents = np.array([orbit.tangent(arc) for arc in grid.tolist()])
        r = lengths.rotor_lengths
        self.inertias = (r * tangents) ** 2
        """r_n^2 t_n^2, shape (G, N)."""
        self.weights = r * tangents * np.exp(1j * angles)
        """r_n t_n (cos phi_n + i sin phi_n), shape (G, N)."""
        self.rubbing = np.abs(tangents).sum(axis=1)
        """sum_n |t_n|, shape (G,)."""


def _arcs_of(orbit: Orbit, angles: Array, noise: float) -> tuple[Array, Array]:
    """Arc of each frame and its standard deviation [rad], shape (T,) each."""
    arc = fit_anywhere(orbit, angles[0]).arc
    found = []
    for frame in angles:
        nearest = fit_near(orbit, frame, arc)
        arc = nearest.arc
        found.append((arc, noise / math.sqrt(max(nearest.information, 1e-6))))
    arcs, spreads = np.array(found).T
    return arcs, spreads


class _Fit:
    """Least squares between the arcs of motions and those of frames."""

    def __init__(
        self,
        tables: _AlongOrbit,
        readings: Readings,
        spans: Sequence[slice],
        arcs: Array,
        spreads: Array,
        gravity_known: bool,
    ) -> None:
        self._tables, self._times = tables, readings.times
        self._arcs, self._spreads = arcs, spreads
        self._known = gravity_known
        self.gravity = readings.gravity.acceleration
        self.spans = spans
        self._tilts = [readings.tilt_at(readings.times[span.start]) for span in self.spans]
        self.rotors = tables.inertias.shape[1]
        self.size = self.rotors + _OF_FORCES
        self.excess = 1.0
        self._unknowns = np.concatenate([np.zeros(self.size), *map(self._begin, self.spans)])

    def _begin(self, span: slice) -> Array:
        """Arc, and speed u, at the begin of a span."""
        few = slice(span.start, span.start + _OF_RATES)
        rate, arc = np.polyfit(self._times[few] - self._times[span.start], self._arcs[few], 1)
        row = round((float(arc) - self._tables.begin) / _GRID)
        return np.array([arc, rate * math.sqrt(self._tables.inertias[row].sum())])

    def solved(self, spread: float) -> tuple[Array, Array]:
        """Unknowns, and their covariance, for masses with a standard deviation [1]."""
        inertia = float(self._tables.inertias.sum(axis=1).mean())
        falling = _KNOWN if self._known or not self.gravity else _FALLING
        forces = [_DECAY * inertia, _STOPPING * inertia, falling]
        prior = np.array([*[spread] * self.rotors, *forces])

        def left(unknowns: Array) -> Array:
            parts = [
                (self._motion(unknowns[:, None], number)[:, 0] - self._arcs[span])
                / self._spreads[span]
                for number, span in enumerate(self.spans)
            ]
            return np.concatenate([*parts, unknowns[: self.size] / prior])

        def slopes(unknowns: Array) -> Array:
            steps = _STEP * np.maximum(np.abs(unknowns), [*prior, *[1.0] * (2 * len(self.spans))])
            rows = []
            for number, span in enumerate(self.spans):
                own = self.size + 2 * number
                columns = [*range(self.size), own, own + 1]
                moved = np.repeat(unknowns[:, None], 1 + len(columns), axis=1)
                moved[columns, 1 + np.arange(len(columns))] += steps[columns]
                arcs = self._motion(moved, number)
                part = np.zeros((span.stop - span.start, len(unknowns)))
                part[:, columns] = (arcs[:, 1:] - arcs[:, :1]) / steps[columns]
                rows.append(part / self._spreads[span][:, None])
            return np.concatenate([*rows, np.eye(self.size, len(unknowns)) / prior[:, None]])

        found = least_squares(
            left, self._unknowns, jac=slopes, x_scale='jac', max_nfev=_MOST_STEPS
        )
        self._unknowns = found.x
        frames = sum(span.stop - span.start for span in self.spans)
        squares = float(np.sum(found.fun[:frames] ** 2))
        self.excess = math.sqrt(squares / max(frames - len(found.x), 1))
        inverse = np.linalg.inv(found.jac.T @ found.jac) * max(self.excess, 1.0) ** 2
        return found.x, inverse

    def _motion(self, unknowns: Array, number: int) -> Array:
        """Arcs in the frames of a span [rad], (T, K), of K columns of unknowns."""
        span, tables = self.spans[number], self._tables
        masses = np.exp(unknowns[: self.rotors])
        damping, friction, fallen = unknowns[self.rotors : self.size]
        gravity = self.gravity * np.exp(fallen)
        roots = np.sqrt(tables.inertias @ masses)
        turned = np.exp(1j * self._tilts[number])
        pulls = (tables.weights * turned).imag @ masses * gravity
        last = len(roots) - 2
        columns = np.arange(unknowns.shape[1])

        def derivative(state: Array) -> Array:
            at = (state[0] - tables.begin) / _GRID
            row = np.clip(at, 0, last).astype(np.intp)
            part = np.clip(at - row, 0.0, 1.0)
            root = (1 - part) * roots[row, columns] + part * roots[row + 1, columns]
            rubbing = (1 - part) * tables.rubbing[row] + part * tables.rubbing[row + 1]
            pull = (1 - part) * pulls[row, columns] + part * pulls[row + 1, columns]
            rate = state[1] / root
            drag = damping * rate + friction * rubbing * np.tanh(rate / _SLIDING)
            return np.array([rate, (pull - drag) / root])

        own = self.size + 2 * number
        state = unknowns[own : own + 2].copy()
        arcs = [state[0]]
        for step in np.diff(self._times[span]).tolist():
            state = _stepped(derivative, state, step)
            arcs.append(state[0])
        return np.array(arcs)


def _stepped(derivative: Callable[[Array], Array], state: Array, step: float) -> Array:
    """State after a step [s], by the classical method of Runge and Kutta."""
    first = derivative(state)
    second = derivative(state + step / 2 * first)
    third = derivative(state + step / 2 * second)
    fourth = derivative(state + step * third)
    return np.asarray(state + step / 6 * (first + 2 * second + 2 * third + fourth))


def _motion(fit: _Fit, solution: Array, inverse: Array, covariance: Array) -> BarMotion:
    """In units of the mean mass; what is unsure of lengths makes masses unsure, inertias known."""
    rotors = fit.rotors
    masses = np.exp(solution[:rotors])
    mean = float(masses.mean())
    alike = np.eye(rotors) - masses / (rotors * mean)
    lengths = split(np.diag(covariance))[0]
    of_masses = np.diag(alike @ inverse[:rotors, :rotors] @ alike.T) + 4 * lengths
    deviations = np.sqrt(np.diag(inverse))
    damping, friction, fallen = (float(each) for each in solution[rotors : fit.size])
    return BarMotion(
        masses / mean,
        np.sqrt(of_masses),
        (damping / mean, friction / mean),
        (float(deviations[rotors]) / mean, float(deviations[rotors + 1]) / mean),
        fit.gravity * math.exp(fallen),
        float(deviations[rotors + 2]),
    )
