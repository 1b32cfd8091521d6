# SPDX-License-Identifier: Apache-2.0
"""What is known of a chain and its forces before any frame.

Lengths are alike as `Tolerances` say, and so are stiffnesses and masses: their logarithms are
normal about a mean. How wide these normal distributions are, the frames show too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.identification.geometry.adjustment import measurable
from soliton_linkage.identification.geometry.tolerances import Tolerances, unknowns_of
from soliton_linkage.identification.motion.free_motion import FreeMotion
from soliton_linkage.linkage.chain import Array

MASSES_BEGIN = 0.1
"""Standard deviation of masses and stiffnesses to begin with [1]: 0.3 lets some run away."""
_NARROWEST, _WIDEST = 1e-3, 0.3
"""The smallest and the largest that is learnt [1]."""
_DECAY = 1.0
"""Standard deviation of damping over a rotor's moment of inertia [1/s]."""
_STOPPING = 10.0
"""Standard deviation of what dry friction slows a rotor down by [rad/s^2]: rotors of a wall stop
in a second."""
_TOLD = 1e-12
"""Information on a change of the unknowns over the largest [1], below which it is rounding."""
_FALLING = 1.0
"""The same of the logarithm of gravity [1], whose unit is the mean spacing."""


def spreads_of_forces(inertia: float) -> Array:
    """Standard deviations of damping, friction and log gravity, for the inertia of a rotor."""
    return np.array([_DECAY * inertia, _STOPPING * inertia, _FALLING])


def learnt_spread(squares: float, count: int) -> float:
    """Standard deviation of so many logarithms of masses [1], by the sum of their squares."""
    return min(max(math.sqrt(squares / count), _NARROWEST), _WIDEST)


@dataclass(frozen=True)
class MotionPrior:
    """Normal distribution of the unknowns of a chain of springs."""

    gravity: float
    """About which the logarithm of gravity is normal [length/s^2], 0 for none."""
    tolerances: Tolerances
    of_masses: float = MASSES_BEGIN
    """Standard deviation by which masses and stiffnesses differ from each other [1]."""
    shift: Array | float = 0.0
    """Of its mean, in the order of the unknowns, (Q - 2 N,)."""

    def about(self, motion: FreeMotion) -> tuple[Array, Array]:
        """Information on a chain, (Q - 2 N, Q - 2 N), and its unknowns, from the mean on."""
        at, rotors = motion.parts, len(motion.masses)
        size = at.forces.stop
        information, values = np.zeros((size, size)), np.zeros(size)
        information[at.lengths, at.lengths] = self.tolerances.information(rotors)
        alike = np.eye(rotors - 1) - 1 / (rotors - 1)
        information[at.stiffnesses, at.stiffnesses] = alike / self.of_masses**2
        information[at.masses, at.masses] = np.eye(rotors) / self.of_masses**2
        spreads = spreads_of_forces(float(motion.inertias.mean()))
        information[at.forces, at.forces] = np.diag(spreads**-2)
        values[at.lengths] = unknowns_of(motion.lengths)
        values[at.stiffnesses] = np.log(motion.stiffnesses)
        values[at.masses] = np.log(motion.masses)
        fallen = math.log(motion.gravity / self.gravity) if self.gravity else 0.0
        values[at.forces] = motion.damping, motion.friction, fallen
        return information, values - self.shift

    def drawn(self, motion: FreeMotion, random: np.random.Generator) -> MotionPrior:
        """The same about a mean that is drawn from it; what it does not tell keeps still."""
        values, vectors = np.linalg.eigh(self.about(motion)[0])
        told = values > _TOLD * values[-1]
        steps = random.standard_normal(int(told.sum())) / np.sqrt(values[told])
        return replace(self, shift=np.asarray(vectors[:, told] @ steps))

    def relearnt(
        self, motion: FreeMotion, covariance: Array, tolerance: float | None
    ) -> MotionPrior:
        """The same as wide as a chain shows it, given what is known of that.

        A tolerance of lengths [1] is kept where it is given.
        """
        at = motion.parts
        tolerances = self.tolerances.relearnt(motion.lengths, covariance[at.lengths, at.lengths])
        if tolerance is not None:
            tolerances = Tolerances(tolerance, tolerances.of_offsets)
        springs, masses = np.log(motion.stiffnesses), np.log(motion.masses)
        squares = np.sum((springs - springs.mean()) ** 2) + np.sum(masses**2)
        squares += np.diag(covariance)[at.stiffnesses.start : at.masses.stop].sum()
        spread = learnt_spread(float(squares), 2 * len(masses) - 3)
        return MotionPrior(self.gravity, tolerances, spread)


def measurable_changes(motion: FreeMotion, gravity_known: bool) -> Array:
    """Orthonormal changes of a chain that keep the mean spacing and the mean mass.

    And gravity, where that is known, or there is none.
    """
    at, rotors = motion.parts, len(motion.masses)
    basis = np.eye(at.forces.stop)
    alike = np.linalg.qr(np.ones((rotors, 1)), mode='complete')[0][:, 1:]
    lengths = measurable(motion.lengths)
    basis[at.lengths, at.lengths] = basis[at.masses, at.masses] = 0
    basis[at.lengths, : lengths.shape[1]] = lengths
    basis[at.masses, at.masses.start : at.masses.stop - 1] = alike
    kept = [lengths.shape[1], at.masses.stop - 1]
    if gravity_known or not motion.gravity:
        kept.append(at.forces.stop - 1)
    return np.delete(basis, kept, axis=1)
