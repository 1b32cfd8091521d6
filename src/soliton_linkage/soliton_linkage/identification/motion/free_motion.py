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
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.geometry.lengths import OF_A_ROTOR, Lengths, split_lengths
from soliton_linkage.identification.motion import motion_loops
from soliton_linkage.linkage.chain import Array

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
    """Angles at each instant [rad], shape (T, N)."""
    return followed(motion, times)[0]


def followed(motion: FreeMotion, times: Array) -> tuple[Array, FreeMotion]:
    """Angles at each instant [rad], shape (T, N), and the motion from the last on."""
    nothing = np.empty((len(motion.masses), 0))
    angles, rates, _ = zip(*_frames(motion, times, nothing, nothing.copy()), strict=True)
    return np.array(angles), replace(motion, angles=angles[-1], rates=rates[-1])


def frames_with_changes(motion: FreeMotion, times: Array) -> Iterator[tuple[Array, Array]]:
    """Angles at each instant [rad], (N,), and their changes with all unknowns, (N, Q)."""
    rotors, at = len(motion.masses), motion.parts
    x, v = np.zeros((2, rotors, motion.size))
    x[:, at.angles] = v[:, at.rates] = np.eye(rotors)
    for angles, _, changes in _frames(motion, times, x, v):
        yield angles, changes


def _frames(
    motion: FreeMotion, times: Array, x: Array, v: Array
) -> Iterator[tuple[Array, Array, Array]]:
    """Angles, rates and changes of angles at each instant."""
    angles, rates = motion.angles.copy(), motion.rates.copy()
    table, columns, drag_column = _table(motion), _columns(motion), motion.parts.forces.start
    along, down = motion.gravity * math.sin(motion.tilt), motion.gravity * math.cos(motion.tilt)
    forces = np.array([motion.damping, motion.friction, _SLIDING, along, down])
    yield angles.copy(), rates.copy(), x.copy()
    for span in np.diff(times).tolist():
        steps = max(1, math.ceil(span * motion.fastest / _LONGEST_STEP))
        given = table, columns, drag_column, forces, steps, span / steps
        motion_loops.advance(*given, angles, rates, x, v)
        yield angles.copy(), rates.copy(), x.copy()


def _table(motion: FreeMotion) -> Array:
    lengths, rotors = motion.lengths, len(motion.masses)
    table = np.zeros((5, rotors))
    table[motion_loops.R] = lengths.rotor_lengths
    table[motion_loops.A, :-1] = lengths.spacings
    table[motion_loops.L, :-1] = lengths.rest_lengths
    table[motion_loops.K, :-1] = motion.stiffnesses
    table[motion_loops.INERTIA] = motion.inertias
    return table


def _columns(motion: FreeMotion) -> motion_loops.Places:
    """Places of r, a, l, log k and log m of each rotor among the unknowns, shape (5, N)."""
    own, at = np.arange(len(motion.masses)), motion.parts
    r = OF_A_ROTOR * own
    columns = [r, r + 2, r + 3, at.stiffnesses.start + own, at.masses.start + own]
    return np.ascontiguousarray(columns, dtype=np.int64)
