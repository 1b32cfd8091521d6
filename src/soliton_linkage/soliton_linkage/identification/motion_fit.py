# SPDX-License-Identifier: Apache-2.0
"""Lengths, stiffnesses, masses and damping by the free motion of springs, all frames at once.

Springs about a moving wall are strained, in proportion to the square of its speed, so that bonds
do not close. The whole motion follows from its begin: least squares between its angles and the
readings is the likeliest chain under normal noise. It begins with few frames, which any chain
nearly follows, and takes in more as it learns (Levenberg and Marquardt).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.identification.adjustment import measurable
from soliton_linkage.identification.free_motion import FreeMotion, frames, frames_with_changes
from soliton_linkage.identification.lengths import OF_A_ROTOR
from soliton_linkage.identification.tolerances import Tolerances, unknowns_of
from soliton_linkage.linkage.chain import Array

_FIRST = 40
"""Frames to begin with [1], in which a wall passes a rotor or two."""
_GROWTH = 1.12
"""Frames over those of the round before [1]; 1.6 loses the wall of some flippers."""
_TOGETHER = 50
"""Frames whose sensitivities go into one product of matrices [1]."""
_STEPS = 10
"""Steps with each number of frames but the last, at most [1]; 2 or 3 are usual."""
_LAST_STEPS = 12
"""Steps with all frames for given tolerances [1]; 2 to 6 are usual."""
_ROUNDS = 4
"""Times that tolerances are learnt [1]."""
_SETTLED = 0.1
"""Gain of a step, as twice a logarithm of the likelihood, that ends the last steps [1]."""
_COARSE = 3.0
"""The same with few frames [1]."""
_DAMPINGS = 6
"""Dampings that are tried for one step [1], the last 1000 times the first."""
_BEGIN = 0.1
"""Standard deviation of masses and stiffnesses to begin with [1]: 0.3 lets some run away."""
_WIDEST = 0.3
"""The largest of masses and stiffnesses [1]."""
_NARROWEST = 1e-3
"""The smallest [1]."""
_DECAY = 1.0
"""Standard deviation of damping over a rotor's moment of inertia, before any frame [1/s]."""


@dataclass(frozen=True)
class MotionFit:
    """A motion that the readings show, and how well."""

    motion: FreeMotion
    covariance: Array
    """Of the unknowns of the motion, in their order, shape (Q, Q)."""
    noise: float
    """Standard deviation of a reading [rad], by what the motion leaves of all."""
    left: Array
    """What is left of the readings [rad], 0 where none was read, shape (T, N)."""
    tolerances: Tolerances
    of_forces: float
    """Standard deviation by which masses and stiffnesses differ from each other [1]."""


class MotionFitting:
    """Brings a motion ever nearer to readings."""

    def __init__(
        self,
        times: Array,
        readings: Array,
        start: FreeMotion,
        noise: float,
        tolerance: float | None,
    ) -> None:
        """Begin with a motion, for readings [rad] (T, N), NaN where missing, of a noise [rad].

        A tolerance of lengths [1] is learnt unless it is given.
        """
        self._times, self._readings = times, readings
        self._noise, self._tolerance = noise, tolerance
        self._tolerances = Tolerances() if tolerance is None else Tolerances(tolerance)
        self._of_forces = _BEGIN
        self._motion = start
        rotors = len(start.masses)
        geometry = OF_A_ROTOR * rotors - 2
        self._geometry = slice(0, geometry)
        self._springs = slice(geometry, geometry + rotors - 1)
        self._masses = slice(geometry + rotors - 1, geometry + 2 * rotors - 1)
        self._drag = geometry + 2 * rotors - 1
        self._basis = self._measurable()

    def fit(self) -> MotionFit:
        """FreeMotion that all readings show."""
        count = min(_FIRST, len(self._times))
        while count < len(self._times):
            self._improve(count, _STEPS, _COARSE)
            count = min(math.ceil(_GROWTH * count), len(self._times))
        covariance = np.zeros((0, 0))
        for _ in range(_ROUNDS):
            self._improve(count, _LAST_STEPS, _SETTLED)
            before = self._tolerances
            covariance = self._learn()
            if self._tolerances.close_to(before, 0.05):
                break
        angles = np.array(list(frames(self._motion, self._times)))
        left = self._readings - self._motion.lengths.offsets - angles
        return MotionFit(
            self._motion,
            covariance,
            self._noise,
            np.where(np.isfinite(left), left, 0.0),
            self._tolerances,
            self._of_forces,
        )

    def _measurable(self) -> Array:
        """Orthonormal changes that keep the mean spacing and the mean mass, (Q, Q - 2)."""
        size = self._motion.size
        basis = np.eye(size)
        rotors = len(self._motion.masses)
        alike = np.linalg.qr(np.ones((rotors, 1)), mode='complete')[0][:, 1:]
        basis[self._geometry, self._geometry] = 0
        basis[self._masses, self._masses] = 0
        lengths = measurable(self._motion.lengths)
        basis[self._geometry, : lengths.shape[1]] = lengths
        first = self._masses.start
        basis[self._masses, first : first + rotors - 1] = alike
        return np.delete(basis, [lengths.shape[1], first + rotors - 1], axis=1)

    def _prior(self, motion: FreeMotion) -> tuple[Array, Array]:
        """Information on the unknowns before any frame, (Q, Q), and what it is about, (Q,)."""
        information, values = np.zeros((motion.size, motion.size)), np.zeros(motion.size)
        rotors = len(motion.masses)
        own = self._geometry
        information[own, own] = self._tolerances.information(rotors)
        values[own] = unknowns_of(motion.lengths)
        alike = np.eye(rotors - 1) - 1 / (rotors - 1)
        information[self._springs, self._springs] = alike / self._of_forces**2
        information[self._masses, self._masses] = np.eye(rotors) / self._of_forces**2
        values[self._springs] = np.log(motion.stiffnesses)
        values[self._masses] = np.log(motion.masses)
        inertia = float(np.mean(motion.masses * motion.lengths.rotor_lengths**2))
        information[self._drag, self._drag] = (_DECAY * inertia) ** -2
        values[self._drag] = motion.damping
        return information, values

    def _cost(self, motion: FreeMotion, count: int) -> float:
        """Twice the negative logarithm of the likelihood, infinite where a motion runs away."""
        angles = np.array(list(frames(motion, self._times[:count])))
        left = self._readings[:count] - motion.lengths.offsets - angles
        information, values = self._prior(motion)
        cost = float(np.nansum(left**2)) / self._noise**2 + float(values @ information @ values)
        return cost if np.isfinite(angles).all() else math.inf

    def _normal(self, count: int) -> tuple[Array, Array, float]:
        """Normal equations of readings of unit variance, and the sum of their squares."""
        motion = self._motion
        rotors = np.arange(len(motion.masses))
        matrix, vector, squares = np.zeros((motion.size, motion.size)), np.zeros(motion.size), 0.0
        rows: list[Array] = []
        left: list[Array] = []
        for frame, (angles, x) in enumerate(frames_with_changes(motion, self._times[:count])):
            x[rotors, OF_A_ROTOR * rotors + 1] += 1
            rows.append(x)
            left.append(self._readings[frame] - motion.lengths.offsets - angles)
            if len(rows) == _TOGETHER or frame == count - 1:
                errors = np.concatenate(left)
                seen = np.isfinite(errors)
                slopes, errors = np.concatenate(rows)[seen], errors[seen]
                matrix += slopes.T @ slopes
                vector += slopes.T @ errors
                squares += float(errors @ errors)
                rows, left = [], []
        return matrix, vector, squares

    def _improve(self, count: int, steps: int, settled: float) -> None:
        """Go some steps towards the first frames, until one gains little."""
        damping = 0.0
        for _ in range(steps):
            matrix, vector, squares = self._normal(count)
            information, values = self._prior(self._motion)
            gradient = self._basis.T @ (vector / self._noise**2 - information @ values)
            full = self._basis.T @ (matrix / self._noise**2 + information) @ self._basis
            before = squares / self._noise**2 + float(values @ information @ values)
            for _ in range(_DAMPINGS):
                damped = full + damping * np.diag(np.diag(full))
                change = self._basis @ np.linalg.solve(damped, gradient)
                changed = self._motion.changed(change)
                with np.errstate(all='ignore'):
                    gain = before - self._cost(changed, count)
                if gain > -settled:
                    break
                damping = max(4 * damping, 1e-4)
            else:
                return
            self._motion, damping = changed, damping / 8
            if gain < settled:
                return

    def _learn(self) -> Array:
        """Learn noise and tolerances from all frames; return the covariance (Q, Q)."""
        matrix, _, squares = self._normal(len(self._times))
        motion = self._motion
        information = matrix / self._noise**2 + self._prior(motion)[0]
        inverse = np.linalg.inv(self._basis.T @ information @ self._basis)
        covariance = np.asarray(self._basis @ inverse @ self._basis.T)
        known = float(np.sum(covariance * matrix)) / self._noise**2
        self._noise = math.sqrt(squares / (int(np.isfinite(self._readings).sum()) - known))
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
        return covariance
