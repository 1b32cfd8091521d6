# SPDX-License-Identifier: Apache-2.0
"""Rotors and pivots from picture to picture: expected places, turns, measured lengths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Motion, staggered, wrapped
from soliton_linkage.vision.assignment import Prediction
from soliton_linkage.vision.layout import MarkerLayout

_MEMORY = 3
"""DotMeasurements of a rotor that define its rate and acceleration [1]."""
_LONGEST_GAP = 0.25
"""Longest time between sightings that define a rate [s]."""
_ACCELERATION = 300.0
"""Acceleration of resting rotors that are kicked [rad/s^2]; that of turning rotors is about the
square of their rate in any chain."""
_FAST = 10.0
"""Rate of a rotor before its first sightings [rad/s]."""
_SURELY = 0.03
"""Standard deviation of a prediction over no time [rad]."""
_UNKNOWN = 1.5
"""Standard deviation beyond which a rotor may have turned by as much as its neighbours [rad]."""
_UNMEASURED = 0.07
"""Standard deviation of lengths over the configured ones [1]: that of parts made by hand."""
_MEASURED = 0.02, 0.03
"""Relative standard deviation of measured rotors and bonds [1]: springs yield by as much."""
_LARGEST_DEVIATION = 0.2
"""Largest deviation of a length from the configured one [1]."""
_FEWEST = 5
"""Pictures after which a length is measured [1]."""
_MOST_AVERAGED = 300
"""Most pictures in a mean [1]."""
_BESIDE = 0.25
"""Largest distance of pivots from their line, over the spacing [1]."""
_OFF = 0.4
"""Largest deviation of distances of pivots from multiples of the spacing, over it [1]."""
_LEAST_SHARE = 0.8
"""Share of the pivots that must be seen before they are numbered [1]."""
_MOST_PIVOTS = 1000
"""Most pictures in the mean of a pivot [1], so that a bench that settles slowly is followed."""
_LIKE_BLACK = 4.0
"""Largest cost of the colour of a black dot [1]: that of two standard deviations."""


class RotorTracks:
    """Angles, rates and lengths of the rotors in the pictures so far."""

    def __init__(self, layout: MarkerLayout) -> None:
        chain = layout.chain
        rotors = chain.number_of_rotors
        self.lengths = chain.rotor_lengths.copy()
        """Lengths of the rotors [m], shape (N,): measured mean, or else the configured value."""
        self.bonds = chain.rest_lengths[: rotors - 1].copy()
        """Distances of the masses of neighbours [m], shape (N - 1,), in the same way."""
        self._colours = layout.colours
        self._length_counts, self._bond_counts = np.zeros(rotors), np.zeros(rotors - 1)
        self._times = np.full((_MEMORY, rotors), -np.inf)
        self._angles = np.zeros((_MEMORY, rotors))
        self._spins = chain.motion is Motion.SPINNER
        self._start = staggered(np.zeros(rotors))
        self._told = self.lengths.copy(), self.bonds.copy()

    def expected(self, times: Array, pivots: Array, slack: float) -> Prediction:
        """Return the expectation at times [s], shape (N,), with length errors of `slack` [m]."""
        angles, deviations = self.predicted(times)
        return Prediction(
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
        """Return the deviations of lengths [m] from their means so far, shape (N,) each.

        They are divided by sqrt(1 + 1 / n), because the mean of n lengths has an error, too. NaN
        stands for rotors with few sightings.
        """
        counts = np.maximum(self._length_counts, 1.0)
        errors = (lengths - self.lengths) / np.sqrt(1 + 1 / counts)
        return np.where(self._length_counts < _FEWEST, np.nan, errors)

    def predicted(self, times: Array) -> tuple[Array, Array]:
        """Return predicted angles at times [s] and their standard deviations [rad], (N,) each."""
        since = np.minimum(times - self._times[0], 1e3)
        rates, _, _ = self.motion()
        rates = np.where(since < _LONGEST_GAP, rates, 0.0)
        seen = np.isfinite(self._times[0])
        angles = np.where(seen, self._angles[0] + rates * since, self._start)
        fastest = float(np.abs(rates).max())
        deviations = _SURELY + (_ACCELERATION + fastest**2) * since**2 / 2
        return angles, np.where(seen, np.minimum(deviations, np.pi), np.pi)

    def motion(self) -> tuple[Array, Array, Array]:
        """Return rates [rad/s], accelerations [rad/s^2] and errors of rates [rad/s], (N,) each."""
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
        """Return angles [rad] with the turns of the rotors, (N,).

        A rotor of a spinner that was hidden for long has made as many turns as its neighbours,
        because all turn to the same side as a wall passes. Other rotors do not turn over.
        """
        expected, deviations = self.predicted(times)
        known = np.isfinite(angles) & (deviations < _UNKNOWN)
        turned = np.where(known, expected + wrapped(angles - expected), np.nan)
        for rotor in np.flatnonzero(np.isfinite(angles) & ~known):
            reference = self._as_neighbours(turned, int(rotor))
            turned[rotor] = reference + wrapped(angles[rotor] - reference)
        return turned

    def take(self, times: Array, angles: Array) -> None:
        """Add the angles [rad] at times [s], NaN for hidden rotors, (N,) each."""
        seen = np.isfinite(angles)
        for older in range(_MEMORY - 1, 0, -1):
            self._times[older, seen] = self._times[older - 1, seen]
            self._angles[older, seen] = self._angles[older - 1, seen]
        self._times[0, seen], self._angles[0, seen] = times[seen], angles[seen]

    def measure(self, pivots: Array, masses: Array) -> None:
        """Add the lengths between pivots and masses [m], NaN for hidden ones, shape (N, 2)."""
        lengths, bonds = self._told
        _average(self.lengths, self._length_counts, lengths, np.hypot(*(masses - pivots).T))
        _average(self.bonds, self._bond_counts, bonds, np.hypot(*np.diff(masses, axis=0).T))

    def _as_neighbours(self, turned: Array, rotor: int) -> float:
        """Return the angle of a rotor to within half a turn, by its neighbours [rad]."""
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
    """Mean places of the pivots, which are numbered once most were seen."""

    def __init__(self, layout: MarkerLayout) -> None:
        chain = layout.chain
        self.known = np.zeros(chain.number_of_rotors, dtype=bool)
        """Whether each pivot is known, shape (N,): most are, or none."""
        self.places = np.column_stack([chain.pivots, np.zeros(chain.number_of_rotors)])
        """Places [m], shape (N, 2): configured ones, or interpolated from known ones."""
        self.found = 0
        """Number of dots that may be pivots."""
        self._layout = layout
        self._spots = np.zeros((0, 2))
        self._counts = np.zeros(0)

    def update(self, places: Array, colour_costs: Array) -> None:
        """Add the dots of a picture: places at both heights [m], (2, K, 2), and colour costs."""
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
        """Keep dots near the line of the pivots, and number them if most were seen."""
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
        rotors = len(self.places)
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
