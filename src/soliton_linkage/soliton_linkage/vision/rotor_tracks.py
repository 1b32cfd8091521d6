# SPDX-License-Identifier: Apache-2.0
"""The rotors from picture to picture: where each is expected, and how far it has turned."""

from __future__ import annotations

import numpy as np

from soliton_linkage.linkage.chain import Array, Motion, staggered, wrapped
from soliton_linkage.vision.identities import Expectation
from soliton_linkage.vision.layout import MarkerLayout

_MEMORY = 3
"""Latest sightings of a rotor that tell its rate and acceleration."""
_LONGEST_GAP = 0.25
"""Between sightings that tell a rate together [s]."""
_ACCELERATION = 300.0
"""That rotors have at rest, about [rad/s^2], when they are kicked; those that turn have about the
square of their rate, whatever their chain."""
_FAST = 10.0
"""Rate of a rotor of which nothing is known, about [rad/s]."""
_SURELY = 0.03
"""Standard deviation of what is expected after no time at all [rad]."""
_UNKNOWN = 1.5
"""Standard deviation beyond which a rotor may have turned by as much as its neighbours [rad]."""
_UNMEASURED = 0.07
"""Standard deviation of lengths over those that were told [1]: of parts that were made by hand."""
_MEASURED = 0.02, 0.03
"""Standard deviation of rotors' lengths and of bonds that were measured, over them [1]: springs
give way by as much."""
_LARGEST_DEVIATION = 0.2
"""From what was told beyond which it is no length of that rotor or bond [1]."""
_FEWEST = 5
"""Pictures after which a length is measured [1]."""
_MOST_AVERAGED = 300
"""Pictures that a mean is of [1]."""


class RotorTracks:
    """What was seen of the rotors so far."""

    def __init__(self, layout: MarkerLayout) -> None:
        """Know what was told of the chain."""
        chain = layout.chain
        rotors = chain.number_of_rotors
        self.lengths = chain.rotor_lengths.copy()
        """Of the rotors [m], shape (N,): the mean of what was seen, else what was told."""
        self.bonds = chain.rest_lengths[: rotors - 1].copy()
        """Distances of the masses of neighbours [m], shape (N - 1,), in the same way."""
        self.last_seen = np.full(rotors, -np.inf)
        """When each rotor was last seen [s], shape (N,)."""
        self._colours = layout.colours
        self._length_counts, self._bond_counts = np.zeros(rotors), np.zeros(rotors - 1)
        self._times = np.full((_MEMORY, rotors), -np.inf)
        self._angles = np.zeros((_MEMORY, rotors))
        self._spins = chain.motion is Motion.SPINNER
        self._start = staggered(np.zeros(rotors))
        self._told = self.lengths.copy(), self.bonds.copy()

    def expected(self, times: Array, pivots: Array, slack: float) -> Expectation:
        """What is expected at times [s], shape (N,); lengths are that uncertain at least [m]."""
        angles, deviations = self.predicted(times)
        return Expectation(
            pivots,
            self.lengths,
            _deviations(self.lengths, self._length_counts, _MEASURED[0], slack),
            angles,
            deviations,
            self.bonds,
            _deviations(self.bonds, self._bond_counts, _MEASURED[1], slack),
            self._colours,
        )

    def length_errors(self, lengths: Array) -> Array:
        """By how much lengths [m] are off the mean of those before, shape (N,) each.

        It is NaN where few were seen. The mean of n has an error of its own, which is taken off:
        that of the difference is sqrt(1 + 1 / n) times that of a length.
        """
        counts = np.maximum(self._length_counts, 1.0)
        errors = (lengths - self.lengths) / np.sqrt(1 + 1 / counts)
        return np.where(self._length_counts < _FEWEST, np.nan, errors)

    def predicted(self, times: Array) -> tuple[Array, Array]:
        """Angles at times [s] and their standard deviations [rad], shape (N,) each."""
        since = np.minimum(times - self._times[0], 1e3)
        rates, _, _ = self.motion()
        rates = np.where(since < _LONGEST_GAP, rates, 0.0)
        seen = np.isfinite(self._times[0])
        angles = np.where(seen, self._angles[0] + rates * since, self._start)
        fastest = float(np.abs(rates).max())
        deviations = _SURELY + (_ACCELERATION + fastest**2) * since**2 / 2
        return angles, np.where(seen, np.minimum(deviations, np.pi), np.pi)

    def motion(self) -> tuple[Array, Array, Array]:
        """Rates [rad/s] and accelerations [rad/s^2] at the last sightings, shape (N,) each.

        Also the standard deviations of the rates [rad/s], by what they may have changed since.
        """
        (t0, t1, t2), (a0, a1, a2) = self._times, self._angles
        with np.errstate(invalid='ignore', divide='ignore'):
            slope = (a0 - a1) / (t0 - t1)
            before = (a1 - a2) / (t1 - t2)
            acceleration = 2 * (slope - before) / (t0 - t2)
            two = (t0 - t1 < _LONGEST_GAP) & (t0 > t1)
            three = two & (t0 - t2 < _LONGEST_GAP) & (t1 > t2)
            acceleration = np.where(three, acceleration, 0.0)
            rates = np.where(two, slope + acceleration * (t0 - t1) / 2, 0.0)
            fastest = float(np.abs(rates).max())
            changed = np.minimum((_ACCELERATION + fastest**2) * (t0 - t1), _FAST)
            changed = np.where(three, np.abs(acceleration) * (t0 - t1) / 2, changed)
        return rates, acceleration, np.where(two, changed, max(_FAST, fastest))

    def unwrapped(self, times: Array, angles: Array) -> Array:
        """Angles [rad] with the turns that the rotors have made, NaN where they are, (N,).

        A rotor of a spinner that was hidden for long has made as many as its neighbours: all turn
        to the same side as a wall passes. Others make none beyond their last angle.
        """
        expected, deviations = self.predicted(times)
        sure = np.isfinite(angles) & (deviations < _UNKNOWN)
        turned = np.where(sure, expected + wrapped(angles - expected), np.nan)
        for rotor in np.flatnonzero(np.isfinite(angles) & ~sure):
            reference = self._as_neighbours(turned, int(rotor))
            turned[rotor] = reference + wrapped(angles[rotor] - reference)
        return turned

    def take(self, times: Array, angles: Array) -> None:
        """Take the angles [rad] that were seen at times [s], NaN of hidden rotors, (N,) each."""
        seen = np.isfinite(angles)
        self.last_seen[seen] = times[seen]
        for older in range(_MEMORY - 1, 0, -1):
            self._times[older, seen] = self._times[older - 1, seen]
            self._angles[older, seen] = self._angles[older - 1, seen]
        self._times[0, seen], self._angles[0, seen] = times[seen], angles[seen]

    def measure(self, pivots: Array, masses: Array) -> None:
        """Take the places of masses [m], NaN of hidden ones, shape (N, 2), for the lengths."""
        lengths, bonds = self._told
        _average(self.lengths, self._length_counts, lengths, np.hypot(*(masses - pivots).T))
        _average(self.bonds, self._bond_counts, bonds, np.hypot(*np.diff(masses, axis=0).T))

    def _as_neighbours(self, turned: Array, rotor: int) -> float:
        """Angle within half a turn of that of a rotor, by those seen next to it [rad]."""
        known = np.flatnonzero(np.isfinite(turned))
        if not (self._spins and len(known)):
            seen = np.isfinite(self._times[0, rotor])
            return float(self._angles[0, rotor] if seen else self._start[rotor])
        sides = (known[known < rotor][-1:], known[known > rotor][:1])
        return float(np.mean(turned[np.concatenate(sides)]))


def _deviations(lengths: Array, counts: Array, measured: float, slack: float) -> Array:
    share = np.where(counts < _FEWEST, _UNMEASURED, measured)
    return np.hypot(share * lengths, slack)


def _average(means: Array, counts: Array, told: Array, values: Array) -> None:
    seen = np.abs(values / told - 1) < _LARGEST_DEVIATION
    counts[seen] = np.minimum(counts[seen] + 1, _MOST_AVERAGED)
    means[seen] += (values[seen] - means[seen]) / counts[seen]
