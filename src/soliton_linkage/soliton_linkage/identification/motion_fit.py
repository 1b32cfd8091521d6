# SPDX-License-Identifier: Apache-2.0
"""A chain and its forces by the free motion of springs, all frames at once.

Springs about a moving wall are strained, in proportion to the square of its speed, so that bonds
do not close. The motion follows from where it begins: least squares between its angles and the
readings is the likeliest chain under normal noise. Frames are divided into windows, each of which
begins anew, so that angles stay nearly linear in all unknowns (multiple shooting, after Bock);
windows grow as the chain becomes known, and end where the chain is pushed. The begins are
eliminated window by window: with the normal equations of a window in blocks of the chain q and
its begin s,

    (A_qq - A_qs A_ss^-1 A_sq) dq = b_q - A_qs A_ss^-1 b_s

adds up to what all windows say of the chain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.adjustment import measurable
from soliton_linkage.identification.free_motion import (
    OF_FORCES,
    FreeMotion,
    frames,
    frames_with_changes,
)
from soliton_linkage.identification.lengths import OF_A_ROTOR
from soliton_linkage.identification.tolerances import Tolerances, unknowns_of
from soliton_linkage.identification.windows import FreeWindow, joined
from soliton_linkage.linkage.chain import Array

_STEPS = 6
"""Steps with windows of one length, at most [1]; 2 or 3 are usual."""
_LAST_STEPS = 40
"""Steps with the longest windows for given tolerances [1]; 2 to 6 are usual, 20 where lengths and
stiffnesses stand in for each other along bent valleys."""
_ROUNDS = 4
"""Times that tolerances are learnt [1]."""
_SETTLED = 0.1
"""Gain of a step, as twice a logarithm of the likelihood, that ends the last steps [1]."""
_COARSE = 3.0
"""The same with shorter windows [1]."""
_STIFFER = (1, 1 / 5, 5)
"""Stiffnesses over the given one to begin with [1]; steps go a factor of 2 or 3 by themselves.
Springs that vibrate faster than frames come are none that frames show."""
_DAMPINGS = 12
"""Dampings that are tried for one step [1], the last 100: six stop short of the least in bent
valleys."""
_DAMPED = 1e-3
"""Damping beyond which a small gain is that of a short step [1], not of the end."""
_BEGIN = 0.1
"""Standard deviation of masses and stiffnesses to begin with [1]: 0.3 lets some run away."""
_WIDEST = 0.3
"""The largest of masses and stiffnesses [1]."""
_NARROWEST = 1e-3
"""The smallest [1]."""
_DECAY = 1.0
"""Standard deviation of damping over a rotor's moment of inertia, before any frame [1/s]."""
_STOPPING = 10.0
"""Standard deviation of what dry friction slows a rotor down by, before any frame [rad/s^2]:
rotors of a wall stop in a second."""
_FALLING = 1.0
"""The same of the logarithm of gravity [1], whose unit is the mean spacing."""
_CHANCE = 3.0
"""By how many standard deviations bars must leave more than springs [1]."""
_UNSURE = 10.0
"""Standard deviation of a begin that no reading tells [rad], [rad/s]: more than rotors do."""


@dataclass(frozen=True)
class MotionFit:
    """A motion that the readings show, and how well."""

    windows: tuple[FreeWindow, ...]
    covariance: Array
    """Of the unknowns of the chain, in their order, shape (Q - 2 N, Q - 2 N)."""
    information: Array
    """What readings alone say of the same."""
    basis: Array
    """Orthonormal changes of a chain that keep the mean spacing and the mean mass."""
    noise: float
    """Standard deviation of a reading [rad], by what the motion leaves of all."""
    times: Array
    """Of the frames [s], shape (T,)."""
    left: Array
    """What is left of readings [rad], over their spreads, 0 where none was read, (T, N)."""
    tolerances: Tolerances
    of_forces: float
    """Standard deviation by which masses and stiffnesses differ from each other [1]."""

    @property
    def motion(self) -> FreeMotion:
        """Of the first window."""
        return self.windows[0].motion


class _Begun(NamedTuple):
    """Normal equations of a window; its begin is at the end of the unknowns."""

    matrix: Array
    """(Q, Q)."""
    vector: Array
    """(Q,)."""


class MotionFitting:
    """Brings a chain, and where each window begins, ever nearer to readings."""

    def __init__(
        self,
        windows: Sequence[FreeWindow],
        times: Array,
        readings: Array,
        spreads: Array,
        noise: float,
        tolerance: float | None,
        gravity_known: bool = True,
    ) -> None:
        """Begin with motions, for readings [rad], NaN where missing, (T, N), of times [s], (T,).

        The standard deviation of a reading is its spread [1], (T, N), times the noise [rad]. A
        tolerance of lengths [1] is learnt unless it is given, and gravity where it is not known
        in lengths of the mean spacing, as that is not.
        """
        self._times, self._readings, self._spreads = times, readings, spreads
        self._noise, self._tolerance = noise, tolerance
        self._tolerances = Tolerances() if tolerance is None else Tolerances(tolerance)
        self._of_forces = _BEGIN
        self._windows = tuple(windows)
        motion = windows[0].motion
        self._gravity, self._gravity_known = motion.gravity, gravity_known
        self._rotors = rotors = len(motion.masses)
        geometry = OF_A_ROTOR * rotors - 2
        self._geometry = slice(0, geometry)
        self._springs = slice(geometry, geometry + rotors - 1)
        self._masses = slice(geometry + rotors - 1, geometry + 2 * rotors - 1)
        self._drag = geometry + 2 * rotors - 1
        self._size = self._drag + OF_FORCES
        self._basis = self._measurable()

    def fit(self, of_bars: float) -> MotionFit | None:
        """Chain that all readings show, None where bars, which leave a noise [rad], do as well."""
        if not self._begun(of_bars):
            return None
        while (windows := joined(self._windows)) != self._windows:
            self._windows = windows
            self._improve(_STEPS, _COARSE)
        for _ in range(_ROUNDS):
            self._improve(_LAST_STEPS, _SETTLED)
            before = self._tolerances
            learnt = self._learn()
            if self._tolerances.close_to(before, 0.05):
                break
        if self._noise > of_bars:
            return None
        left = np.zeros_like(self._readings)
        for window in self._windows:
            left[window.frames] = np.nan_to_num(self._left(window))
        return MotionFit(
            self._windows,
            *learnt,
            self._basis,
            self._noise,
            self._times,
            left,
            self._tolerances,
            self._of_forces,
        )

    def _begun(self, of_bars: float) -> bool:
        """Begin with the stiffness about the given one that leaves least, if less than bars."""
        given, found = self._windows, []
        stiffest = float(np.median(np.diff(self._times))) ** -2
        for factor in _STIFFER:
            self._windows = _stiffened(given, factor)
            if factor > 1 and self._motion.stiffnesses.max() > stiffest:
                continue
            self._improve(_STEPS, _COARSE)
            if of_bars**2 > self._squared_noise() * (1 + _CHANCE * self._chance()):
                self._windows = joined(self._windows)
                self._improve(_STEPS, _COARSE)
                found.append((self._cost(self._windows), self._windows))
                if self._squared_noise() < self._noise**2 * (1 + _CHANCE * self._chance()):
                    break
        if found:
            self._windows = min(found, key=lambda each: each[0])[1]
        return bool(found)

    def _squared_noise(self) -> float:
        """Of readings, by what the windows leave of them [rad^2]."""
        squares = sum(float(np.nansum(self._left(window) ** 2)) for window in self._windows)
        known = self._size + 2 * self._rotors * len(self._windows)
        return squares / max(self._readings_seen() - known, 1)

    def _readings_seen(self) -> int:
        return sum(int(self._seen(window).sum()) for window in self._windows)

    def _chance(self) -> float:
        """Standard deviation of what bars leave more of noise squared, over that [1].

        Bars and springs leave the same of a frame but for what springs say more, one number.
        """
        return math.sqrt(2 / (self._readings_seen() * self._rotors))

    @property
    def _motion(self) -> FreeMotion:
        return self._windows[0].motion

    def _left(self, window: FreeWindow) -> Array:
        """What a window leaves of its readings [rad], over their spreads, NaN where missing."""
        angles = frames(window.motion, self._times[window.frames])
        left = self._readings[window.frames] - window.motion.lengths.offsets - angles
        return np.asarray(left / self._spreads[window.frames])

    def _measurable(self) -> Array:
        """Orthonormal changes of a chain that keep the mean spacing and the mean mass.

        And gravity, where that is known, or there is none.
        """
        basis = np.eye(self._size)
        alike = np.linalg.qr(np.ones((self._rotors, 1)), mode='complete')[0][:, 1:]
        basis[self._geometry, self._geometry] = 0
        basis[self._masses, self._masses] = 0
        lengths = measurable(self._motion.lengths)
        basis[self._geometry, : lengths.shape[1]] = lengths
        first = self._masses.start
        basis[self._masses, first : first + self._rotors - 1] = alike
        kept = [lengths.shape[1], first + self._rotors - 1]
        if self._gravity_known or not self._motion.gravity:
            kept.append(self._drag + 2)
        return np.delete(basis, kept, axis=1)

    def _prior(self, motion: FreeMotion) -> tuple[Array, Array]:
        """Information on a chain before any frame, and what it is about."""
        size = self._size
        information, values = np.zeros((size, size)), np.zeros(size)
        own, rotors = self._geometry, self._rotors
        information[own, own] = self._tolerances.information(rotors)
        values[own] = unknowns_of(motion.lengths)
        alike = np.eye(rotors - 1) - 1 / (rotors - 1)
        information[self._springs, self._springs] = alike / self._of_forces**2
        information[self._masses, self._masses] = np.eye(rotors) / self._of_forces**2
        values[self._springs] = np.log(motion.stiffnesses)
        values[self._masses] = np.log(motion.masses)
        inertia = float(motion.inertias.mean())
        forces = slice(self._drag, size)
        unsure = np.array([_DECAY * inertia, _STOPPING * inertia, _FALLING])
        information[forces, forces] = np.diag(unsure**-2)
        values[forces] = motion.damping, motion.friction, self._fallen(motion)
        return information, values

    def _fallen(self, motion: FreeMotion) -> float:
        """Logarithm of gravity over what it began with [1]."""
        return math.log(motion.gravity / self._gravity) if self._gravity else 0.0

    def _cost(self, windows: Sequence[FreeWindow]) -> float:
        """Twice the negative logarithm of the likelihood, infinite where a motion runs away."""
        information, values = self._prior(windows[0].motion)
        cost = float(values @ information @ values)
        for window in windows:
            left = self._left(window)
            if not np.isfinite(left[self._seen(window)]).all():
                return math.inf
            cost += float(np.nansum(left**2)) / self._noise**2
        return cost

    def _seen(self, window: FreeWindow) -> Array:
        return np.isfinite(self._readings[window.frames])

    def _normal(self, window: FreeWindow) -> tuple[_Begun, float]:
        """Normal equations of a window for readings of unit variance, and their squares."""
        rotors = np.arange(self._rotors)
        rows, angles = [], []
        for frame, x in frames_with_changes(window.motion, self._times[window.frames]):
            x[rotors, OF_A_ROTOR * rotors + 1] += 1
            rows.append(x)
            angles.append(frame)
        left = self._readings[window.frames] - window.motion.lengths.offsets - np.array(angles)
        seen = np.isfinite(left)
        spreads = self._spreads[window.frames][seen]
        slopes, errors = np.array(rows)[seen] / spreads[:, None], left[seen] / spreads
        return _Begun(slopes.T @ slopes, slopes.T @ errors), float(errors @ errors)

    def _improve(self, steps: int, settled: float) -> None:
        """Go some steps, until one gains little."""
        damping = 0.0
        for _ in range(steps):
            begun, squares = zip(*map(self._normal, self._windows), strict=True)
            information, values = self._prior(self._motion)
            before = sum(squares) / self._noise**2 + float(values @ information @ values)
            for _ in range(_DAMPINGS):
                changed = self._changed(begun, information, values, damping)
                with np.errstate(all='ignore'):
                    gain = before - self._cost(changed)
                if gain > 0:
                    break
                damping = max(4 * damping, 1e-4)
            else:
                return
            self._windows = changed
            if gain < settled and damping < _DAMPED:
                return
            damping /= 8

    def _changed(
        self, begun: Sequence[_Begun], information: Array, values: Array, damping: float
    ) -> tuple[FreeWindow, ...]:
        """Windows after a damped step of least squares."""
        matrix, vector = information.copy(), -information @ values
        backs = []
        for each in begun:
            own, pull, back = self._eliminated(each, damping)
            matrix += own
            vector += pull
            backs.append(back)
        full = self._basis.T @ matrix @ self._basis
        full += damping * np.diag(np.diag(full))
        change = self._basis @ np.linalg.solve(full, self._basis.T @ vector)
        return tuple(
            FreeWindow(
                window.frames,
                window.motion.changed(np.concatenate([change, begin - across @ change])),
            )
            for window, (begin, across) in zip(self._windows, backs, strict=True)
        )

    def _eliminated(
        self, begun: _Begun, damping: float
    ) -> tuple[Array, Array, tuple[Array, Array]]:
        """What a window says of the chain, and how its begin follows from that."""
        size, scale = self._size, self._noise**-2
        matrix, vector = begun.matrix * scale, begun.vector * scale
        begin = matrix[size:, size:] * (1 + damping * np.eye(2 * self._rotors))
        begin += np.eye(len(begin)) / _UNSURE**2
        across = np.asarray(np.linalg.solve(begin, matrix[size:, :size]))
        moved = np.asarray(np.linalg.solve(begin, vector[size:]))
        own = matrix[:size, :size] - matrix[:size, size:] @ across
        return own, vector[:size] - matrix[:size, size:] @ moved, (moved, across)

    def _learn(self) -> tuple[Array, Array]:
        """Learn noise and tolerances from all frames; covariance of the chain, information."""
        begun, squares = zip(*map(self._normal, self._windows), strict=True)
        motion = self._motion
        information = np.sum([self._eliminated(each, 0.0)[0] for each in begun], axis=0)
        whole = information + self._prior(motion)[0]
        inverse = np.linalg.inv(self._basis.T @ whole @ self._basis)
        covariance = np.asarray(self._basis @ inverse @ self._basis.T)
        known = float(np.sum(covariance * information)) + 2 * self._rotors * len(self._windows)
        self._noise = math.sqrt(sum(squares) / max(self._readings_seen() - known, 1.0))
        learnt = self._tolerances.relearnt(
            motion.lengths, covariance[self._geometry, self._geometry]
        )
        if self._tolerance is not None:
            learnt = replace(learnt, of_lengths=self._tolerance)
        self._tolerances = learnt
        springs, masses = np.log(motion.stiffnesses), np.log(motion.masses)
        variances = np.diag(covariance)[self._springs.start : self._masses.stop]
        total = np.sum((springs - springs.mean()) ** 2) + np.sum(masses**2) + variances.sum()
        spread = math.sqrt(float(total) / (2 * len(masses) - 3))
        self._of_forces = min(max(spread, _NARROWEST), _WIDEST)
        return covariance, information


def _stiffened(windows: Sequence[FreeWindow], factor: float) -> tuple[FreeWindow, ...]:
    """Windows of springs that are so many times as stiff."""
    return tuple(
        FreeWindow(
            window.frames,
            replace(window.motion, stiffnesses=factor * window.motion.stiffnesses),
        )
        for window in windows
    )
