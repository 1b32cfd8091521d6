# SPDX-License-Identifier: Apache-2.0
"""The rotors from picture to picture: where each is expected, and how far it has turned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
_BESIDE = 0.25
"""Of the spacing by which pivots may be beside their line, as frames are glued [1]."""
_OFF = 0.4
"""By which distances of pivots may differ from multiples of the spacing, over it [1]."""
_LEAST_SHARE = 0.8
"""Of the pivots that must have been seen before they are numbered [1]."""
_MOST_PIVOTS = 1000
"""Pictures that a mean is of, so that a bench that settles slowly is followed [1]."""
_LIKE_BLACK = 4.0
"""Cost of the colour up to which a dot is black [1]: that of two standard deviations."""


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


class Pivots:
    """Finds the pivots, once most were seen, and goes on to average them and to find others."""

    def __init__(self, layout: MarkerLayout) -> None:
        """Know none yet."""
        chain = layout.chain
        self.known = np.zeros(chain.number_of_rotors, dtype=bool)
        """Which pivots are known, shape (N,): most are, or none."""
        self.places = np.column_stack([chain.pivots, np.zeros(chain.number_of_rotors)])
        """Of the pivots [m], shape (N, 2): told ones, or between those that are known."""
        self.found = 0
        """How many dots have been found that may be pivots."""
        self._layout = layout
        self._spots = np.zeros((0, 2))
        self._counts = np.zeros(0)

    def look(self, places: Array, colour_costs: Array) -> None:
        """Take what dots of a picture show: places at both heights [m], (2, K, 2), and colours."""
        black = colour_costs[:, 0] <= _LIKE_BLACK
        if self.known.any():
            self._average(places[:, black])
        else:
            self._collect(places[0, black])

    def _average(self, places: Array) -> None:
        if not places.shape[1]:
            return
        rotors = np.arange(len(self.places))
        apart = np.hypot(*(places[rotors % 2] - self.places[:, None]).transpose(2, 0, 1))
        nearest = np.argmin(apart, axis=1)
        spacing, same = self._layout.chain.spacing, self._layout.dot_radius / 2
        seen = apart[rotors, nearest] < np.where(self.known, same, _BESIDE * spacing)
        self._counts[seen] = np.minimum(self._counts[seen] + 1, _MOST_PIVOTS)
        shift = places[rotors % 2, nearest] - self.places
        self.places[seen] += shift[seen] / self._counts[seen, None]
        self.known |= seen

    def _collect(self, places: Array) -> None:
        """Keep dots near the line of the pivots, and find the pivots among them."""
        spacing = self._layout.chain.spacing
        ends = self.places[0, 0] - spacing / 2, 2 * self.places[-1, 0] - self.places[0, 0]
        near = np.abs(places[:, 1]) < _BESIDE * spacing
        near &= (places[:, 0] > ends[0]) & (places[:, 0] < ends[1] + spacing)
        for place in places[near]:
            apart = np.hypot(*(self._spots - place).T) if len(self._spots) else np.zeros(0)
            same = int(np.argmin(apart)) if len(apart) else -1
            if same >= 0 and apart[same] < self._layout.label_radius:
                self._counts[same] += 1
                self._spots[same] += (place - self._spots[same]) / self._counts[same]
            else:
                self._spots = np.vstack([self._spots, place])
                self._counts = np.append(self._counts, 1.0)
        self.found = len(self._spots)
        self._settle()

    def _settle(self) -> None:
        """Number the dots by their distances, where these are about multiples of the spacing."""
        rotors, spacing = len(self.places), self._layout.chain.spacing
        often = np.argsort(-self._counts, kind='stable')[:rotors]
        order: NDArray[np.intp] = often[np.argsort(self._spots[often, 0])]
        if len(order) < _LEAST_SHARE * rotors:
            return
        xs = self._spots[order, 0]
        steps = np.diff(xs) / spacing
        numbers = np.cumsum(np.rint([xs[0] / spacing, *steps])).astype(np.intp)
        off = np.abs(steps - np.rint(steps)).max(initial=0.0)
        doubled = len(set(numbers.tolist())) < len(numbers)
        if off > _OFF or doubled or numbers[0] < 0 or numbers[-1] >= rotors:
            return
        self.known[numbers] = True
        counts = np.zeros(rotors)
        counts[numbers] = self._counts[order]
        self._counts = counts
        told = self.places[:, 0].copy()
        ahead = np.interp(told, told[numbers], xs - told[numbers])
        self.places = np.column_stack(
            [told + ahead, np.interp(told, told[numbers], self._spots[order, 1])]
        )
        self.places[numbers] = self._spots[order]
