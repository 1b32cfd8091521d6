# SPDX-License-Identifier: Apache-2.0
"""Free motion of springs from frame to frame, and its change with all that it depends on.

    m_n r_n^2 phi_n'' = -sum over both springs of k f df/dphi_n - c phi_n',

with f the length of a spring less that at rest. The unknowns are those of `Lengths`, then log k
of each spring, log m of each rotor, c, the first angles and the first rates. Their sensitivities
X = dphi/dq and V = X' obey the same equation to first order,

    X' = V,    V' = (dphi''/dphi) X + (dphi''/dphi') V + dphi''/dq,

and are integrated along with it, by the classical method of Runge and Kutta.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from soliton_linkage.identification.lengths import OF_A_ROTOR, Lengths
from soliton_linkage.linkage.chain import Array

_LONGEST_STEP = 0.4
"""Of the integration, over the shortest time in which springs and masses vibrate [1]: a wall then
misses its angles by 1e-5 rad after a second."""


@dataclass(frozen=True)
class Motion:
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

    @property
    def fastest(self) -> float:
        """Upper bound of the frequencies of small vibrations [rad/s]."""
        return 2 * math.sqrt(float(self.stiffnesses.max() / self.masses.min()))

    def changed(self, change: Array) -> Motion:
        """This with a change of the unknowns."""
        rotors = len(self.masses)
        parts = np.split(change, np.cumsum([OF_A_ROTOR * rotors - 2, rotors - 1, rotors, 1, rotors]))
        lengths, springs, masses, damping, angles, rates = parts
        return Motion(
            self.lengths.changed(lengths),
            self.stiffnesses * np.exp(springs),
            self.masses * np.exp(masses),
            self.damping + float(damping[0]),
            self.angles + angles,
            self.rates + rates,
        )


class Acceleration:
    """Accelerations of a motion and their changes with angles, rates and unknowns."""

    def __init__(self, motion: Motion) -> None:
        """Prepare what stays the same along the motion."""
        self._motion = motion
        rotors = len(motion.masses)
        self.inertias = motion.masses * motion.lengths.rotor_lengths**2
        self.size = OF_A_ROTOR * rotors - 2 + 2 * rotors + 2 * rotors
        left = np.arange(rotors - 1)
        self._columns = {
            'r': OF_A_ROTOR * np.arange(rotors),
            'a': OF_A_ROTOR * left + 2,
            'l': OF_A_ROTOR * left + 3,
            'k': OF_A_ROTOR * rotors - 2 + left,
            'm': OF_A_ROTOR * rotors - 2 + rotors - 1 + np.arange(rotors),
            'c': OF_A_ROTOR * rotors - 2 + 2 * rotors - 1,
        }

    def values(self, angles: Array, rates: Array) -> Array:
        """phi'' [rad/s^2], shape (N,)."""
        f, _, firsts, _ = self._springs(angles, False)
        pull = -self._motion.stiffnesses * f
        torques = -self._motion.damping * rates
        torques[:-1] += pull * firsts[0]
        torques[1:] += pull * firsts[1]
        return np.asarray(torques / self.inertias)

    def with_changes(
        self, angles: Array, rates: Array
    ) -> tuple[Array, tuple[Array, Array, Array], Array]:
        """phi'', its change with the angles as three diagonals, and that with the unknowns.

        The diagonals are below, on and above the main one, (N - 1,), (N,), (N - 1,); the last
        has the shape (N, Q).
        """
        motion, columns = self._motion, self._columns
        f, _, firsts, seconds = self._springs(angles, True)
        k, r, a = motion.stiffnesses, motion.lengths.rotor_lengths, motion.lengths.spacings
        # firsts[j], seconds[i][j]: of phi_n, phi_{n+1}, r_n, r_{n+1}, a
        slopes = -k * (firsts[:2, None] * firsts[None] + f * seconds)
        pull = -k * f
        torques = -motion.damping * rates
        torques[:-1] += pull * firsts[0]
        torques[1:] += pull * firsts[1]
        accelerations = torques / self.inertias
        main = np.zeros(len(r))
        main[:-1] += slopes[0, 0]
        main[1:] += slopes[1, 1]
        above = slopes[0, 1] / self.inertias[:-1]
        below = slopes[1, 0] / self.inertias[1:]
        changes = np.zeros((len(r), self.size))
        bonds = np.arange(len(k))
        for side in (0, 1):
            rows = bonds + side
            scale = 1 / self.inertias[rows]
            changes[rows, columns['r'][:-1]] += slopes[side, 2] * r[:-1] * scale
            changes[rows, columns['r'][1:]] += slopes[side, 3] * r[1:] * scale
            changes[rows, columns['a']] = slopes[side, 4] * a * scale
            changes[rows, columns['l']] = k * firsts[side] * motion.lengths.rest_lengths * scale
            changes[rows, columns['k']] = pull * firsts[side] * scale
        rotors = np.arange(len(r))
        changes[rotors, columns['r']] -= 2 * accelerations
        changes[rotors, columns['m']] = -accelerations
        changes[rotors, columns['c']] = -rates / self.inertias
        return accelerations, (below, main / self.inertias, above), changes

    def _springs(self, angles: Array, curved: bool) -> tuple[Array, Array, Array, Array]:
        """Extensions, lengths, and the changes of lengths to first and to second order."""
        lengths = self._motion.lengths
        r = lengths.rotor_lengths
        sine, cosine = np.sin(angles), np.cos(angles)
        s1, s2, c1, c2, r1, r2 = sine[:-1], sine[1:], cosine[:-1], cosine[1:], r[:-1], r[1:]
        across, up = lengths.spacings + r2 * s2 - r1 * s1, r2 * c2 - r1 * c1
        length = np.hypot(across, up)
        ux, uy = across / length, up / length
        one, none = np.ones_like(s1), np.zeros_like(s1)
        x = np.array([-r1 * c1, r2 * c2, -s1, s2, one])
        y = np.array([r1 * s1, -r2 * s2, -c1, c2, none])
        firsts = x * ux + y * uy
        seconds = np.empty((0,))
        if curved:
            seconds = (x[:2, None] * x + y[:2, None] * y - firsts[:2, None] * firsts) / length
            seconds[0, 0] += ux * r1 * s1 + uy * r1 * c1
            seconds[1, 1] -= ux * r2 * s2 + uy * r2 * c2
            seconds[0, 2] += -ux * c1 + uy * s1
            seconds[1, 3] += ux * c2 - uy * s2
        return length - lengths.rest_lengths, length, firsts, seconds


def frames(motion: Motion, times: Array) -> Iterator[Array]:
    """Angles at each instant [rad], shape (N,)."""
    force = Acceleration(motion)
    angles, rates = motion.angles.copy(), motion.rates.copy()
    yield angles
    for span in np.diff(times):
        count = max(1, math.ceil(span * motion.fastest / _LONGEST_STEP))
        h = span / count
        for _ in range(count):
            k1 = force.values(angles, rates)
            k2 = force.values(angles + h / 2 * rates, rates + h / 2 * k1)
            middle = rates + h / 2 * k2
            k3 = force.values(angles + h / 2 * (rates + h / 2 * k1), middle)
            k4 = force.values(angles + h * middle, rates + h * k3)
            angles = angles + h * rates + h**2 / 6 * (k1 + k2 + k3)
            rates = rates + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        yield angles


def frames_with_changes(motion: Motion, times: Array) -> Iterator[tuple[Array, Array]]:
    """Angles at each instant, (N,), and their changes with all unknowns, (N, Q)."""
    force = Acceleration(motion)
    rotors = len(motion.masses)
    angles, rates = motion.angles.copy(), motion.rates.copy()
    x, v = np.zeros((rotors, force.size)), np.zeros((rotors, force.size))
    own = np.arange(rotors)
    x[own, force.size - 2 * rotors + own] = 1
    v[own, force.size - rotors + own] = 1
    drag = -motion.damping / force.inertias[:, None]

    def slopes(angles: Array, rates: Array, x: Array, v: Array) -> tuple[Array, Array]:
        values, (below, main, above), changes = force.with_changes(angles, rates)
        changes += main[:, None] * x
        changes[1:] += below[:, None] * x[:-1]
        changes[:-1] += above[:, None] * x[1:]
        if motion.damping:
            changes += drag * v
        return values, changes

    yield angles, x
    for span in np.diff(times):
        count = max(1, math.ceil(span * motion.fastest / _LONGEST_STEP))
        h = span / count
        for _ in range(count):
            k1, d1 = slopes(angles, rates, x, v)
            half = v + h / 2 * d1
            k2, d2 = slopes(angles + h / 2 * rates, rates + h / 2 * k1, x + h / 2 * v, half)
            middle, middles = rates + h / 2 * k2, v + h / 2 * d2
            k3, d3 = slopes(
                angles + h / 2 * (rates + h / 2 * k1), middle, x + h / 2 * half, middles
            )
            k4, d4 = slopes(angles + h * middle, rates + h * k3, x + h * middles, v + h * d3)
            angles = angles + h * rates + h**2 / 6 * (k1 + k2 + k3)
            rates = rates + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            x = x + h * v + h**2 / 6 * (d1 + d2 + d3)
            v = v + h / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
        yield angles, x
