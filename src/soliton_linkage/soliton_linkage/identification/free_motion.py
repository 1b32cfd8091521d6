# SPDX-License-Identifier: Apache-2.0
"""Free motion of a chain of springs, with sensitivities to all unknowns.

The equation of motion of rotor n with mass m_n, length r_n and angle phi_n is

    m_n r_n^2 phi_n'' = -sum over both springs of k f df/dphi_n + g m_n r_n sin(phi_n + tilt)
                        - c phi_n' - b tanh(phi_n' / w),

where k is the stiffness and f the extension of a spring, g is gravity, and w the rate above which
dry friction is nearly constant. The Q unknowns are the P unknowns of `lengths`, log k of each
spring, log m of each rotor, the damping c, the dry friction b, log g, the initial angles and the
initial rates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.identification.lengths import UNKNOWNS_PER_ROTOR, Lengths, split_lengths
from soliton_linkage.identification.motion_loops import (
    BY_FORCE,
    INERTIA,
    NO_SOURCE,
    UNMOVED,
    A,
    K,
    L,
    R,
    integrate,
    pull_back,
)
from soliton_linkage.linkage.chain import Array

_LONGEST_STEP = 0.5
"""Longest integration step times `FreeMotion.fastest` [1]; errors of angles are below 5e-5 rad."""
_COARSE_STEP = 0.8
"""Longest integration step of sensitivities times `FreeMotion.fastest` [1]. For a wobbling flipper
of 40 rotors, steps of this length change the information on any combination of unknowns by at most
4 %."""
_BATCH = 32
"""Number of frames whose sensitivities are in memory at one time; for 40 rotors they need 3 MB."""
_SLIDING = 0.1
"""Rate w above which dry friction is nearly constant [rad/s]; with half this rate, the integration
needs more steps."""
FORCE_UNKNOWNS = 3
"""Number of unknowns of the forces: damping c, dry friction b and log gravity."""


class UnknownSlices(NamedTuple):
    """Slices of the Q unknowns of a motion, one slice for each kind of unknown."""

    lengths: slice
    stiffnesses: slice
    masses: slice
    forces: slice
    angles: slice
    rates: slice


def unknown_slices(rotors: int) -> UnknownSlices:
    """Return the slices for N `rotors`; the initial state follows the unknowns of the chain."""
    sizes = [UNKNOWNS_PER_ROTOR * rotors - 2, rotors - 1, rotors, FORCE_UNKNOWNS, rotors, rotors]
    ends = np.cumsum(sizes).tolist()
    return UnknownSlices(*map(slice, [0, *ends[:-1]], ends))


@dataclass(frozen=True)
class FreeMotion:
    """Chain of springs with its initial state; the unit of mass is approximately the mean mass."""

    lengths: Lengths
    stiffnesses: Array
    """Stiffnesses k [1/s^2], (N - 1,)."""
    masses: Array
    damping: float
    """Damping c of each rotor [length^2/s]."""
    angles: Array
    rates: Array
    friction: float = 0.0
    """Dry friction b of each rotor [length^2/s^2]."""
    gravity: float = 0.0
    """Gravity g in the plane of the chain [length/s^2], 0 if gravity does not act."""
    tilt: float = 0.0
    """Tilt of the chain, positive if the last rotor is lower [rad]."""

    @property
    def slices(self) -> UnknownSlices:
        """Slice of each kind of unknown."""
        return unknown_slices(len(self.masses))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.slices.rates.stop)

    @property
    def inertias(self) -> Array:
        """Moments of inertia of the rotors, divided by the unit of mass [length^2], (N,)."""
        return np.asarray(self.masses * self.lengths.rotor_lengths**2)

    @property
    def fastest(self) -> float:
        """Upper bound of the angular frequencies and decay rates of the chain [rad/s].

        The bound of the frequencies follows from the circle theorem of Gershgorin: the square of a
        frequency is at most the largest sum of k / m_n + k / sqrt(m_n m_j) over both springs of a
        rotor n, where j is the other rotor of the spring.
        """
        inverse = self.masses**-0.5
        couplings = self.stiffnesses * (inverse[:-1] + inverse[1:])
        squares = inverse * (np.append(couplings, 0.0) + np.insert(couplings, 0, 0.0))
        vibrations = math.sqrt(float(squares.max()))
        return vibrations + abs(self.friction) / _SLIDING / float(self.inertias.min())

    def changed(self, change: Array) -> FreeMotion:
        """Return this motion with `change`, (Q,), added to its unknowns."""
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
        """Return the same motion, with the mean spacing and the mean mass as units."""
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
    """Return a dictionary with a view of the unknowns of each kind.

    Its keys are the fields of `Deviations`, and `offset`, `friction` and `gravity`.
    """
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
    """Return the angles at each time [rad], (T, N)."""
    return states_at(motion, times)[:, 0]


def states_at(motion: FreeMotion, times: Array) -> Array:
    """Return the angles [rad] and the rates [rad/s] at each time, (T, 2, N)."""
    none = np.empty((0, 2, len(motion.masses)))
    return next(_states(motion, times, none, len(times), _LONGEST_STEP))[0]


def propagate(motion: FreeMotion, times: Array) -> tuple[Array, FreeMotion]:
    """Return the angles at each time [rad], (T, N), and a motion that begins at the last time."""
    states = states_at(motion, times)
    angles, rates = states[-1]
    return states[:, 0], replace(motion, angles=angles, rates=rates)


def states_with_sensitivities(motion: FreeMotion, times: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the states and the sensitivities at successive times, in batches of B times.

    The states are the angles [rad] and the rates [rad/s], (B, 2, N). The sensitivities are the
    derivatives of the angles by the unknowns, (Q, B, N).
    """
    yield from _states(motion, times, _initial_changes(motion), _BATCH, _COARSE_STEP)


def _initial_changes(motion: FreeMotion) -> Array:
    at = motion.slices
    changes = np.zeros((motion.size, 2, len(motion.masses)))
    changes[at.angles, 0] = changes[at.rates, 1] = np.eye(len(motion.masses))
    return changes


def transition(motion: FreeMotion, span: float) -> Array:
    """Return the derivatives of the state after a time `span` [s] by the unknowns, (Q, 2 N).

    The state consists of N angles and N rates.
    """
    changes = _initial_changes(motion)
    for _ in _states(motion, np.array([0.0, span]), changes, 2, _COARSE_STEP):
        pass
    return changes.reshape(motion.size, -1)


def gradient_of(motion: FreeMotion, times: Array, states: Array, weights: Array) -> Array:
    """Return the derivatives of sum(angles * `weights`) by the unknowns, (Q,).

    `weights` are (T, N). `states`, (T, 2, N), is the result of `states_at` for the same motion and
    times.
    """
    rotors, at = len(motion.masses), motion.slices
    pull, gradient = np.zeros((2, rotors)), np.zeros(5 * rotors + FORCE_UNKNOWNS)
    spans = np.diff(times, prepend=times[0])
    forces = _forces(motion, _LONGEST_STEP)
    pull_back(_table(motion), forces, spans, states, weights, pull, gradient)
    sources = _sources(motion)
    rows = np.where(sources <= BY_FORCE, 5 * rotors + BY_FORCE - sources, sources)
    derivatives = np.where(sources == UNMOVED, 0.0, gradient[rows])
    derivatives[at.angles], derivatives[at.rates] = pull
    return derivatives


def _states(
    motion: FreeMotion, times: Array, changes: Array, batch: int, longest: float
) -> Iterator[tuple[Array, Array]]:
    state = np.array([motion.angles, motion.rates])
    table, forces, sources = _table(motion), _forces(motion, longest), _sources(motion)
    spans = np.diff(times, prepend=times[0])
    for begin in range(0, len(spans), batch):
        some = spans[begin : begin + batch]
        states = np.empty((len(some), *state.shape))
        slopes = np.empty((len(changes), len(some), state.shape[1]))
        integrate(table, forces, sources, some, state, changes, states, slopes)
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


def _forces(motion: FreeMotion, longest: float) -> Array:
    along, down = motion.gravity * math.sin(motion.tilt), motion.gravity * math.cos(motion.tilt)
    step = longest / motion.fastest
    return np.array([motion.damping, motion.friction, _SLIDING, along, down, step])


def _sources(motion: FreeMotion) -> NDArray[np.int64]:
    rotors, at = len(motion.masses), motion.slices
    sources = np.full(motion.size, NO_SOURCE)
    for first, kind in ((0, R), (2, A), (3, L)):
        part = sources[at.lengths][first::UNKNOWNS_PER_ROTOR]
        part[:] = kind * rotors + np.arange(len(part))
    sources[at.lengths][1::UNKNOWNS_PER_ROTOR] = UNMOVED
    sources[at.stiffnesses] = K * rotors + np.arange(rotors - 1)
    sources[at.masses] = INERTIA * rotors + np.arange(rotors)
    sources[at.forces] = BY_FORCE - np.arange(FORCE_UNKNOWNS)
    return sources
