# SPDX-License-Identifier: Apache-2.0
"""Tracking of rotors and pivots: predicted angles, turns, and mean lengths and pivot positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Motion, staggered, wrapped
from soliton_linkage.vision.assignment import Prediction
from soliton_linkage.vision.layout import MarkerLayout

_MEMORY = 3
"""Number of measurements from which rate and acceleration are computed."""
_MAX_GAP = 0.25
"""A rate is computed only from measurements within less than this time [s]."""
_ACCELERATION = 300.0
"""Typical acceleration of a rotor that starts from rest, for example after a kick [rad/s^2]."""
_INITIAL_RATE = 10.0
"""Assumed standard deviation of the rate of a rotor before its second measurement [rad/s]."""
_MIN_DEVIATION = 0.03
"""Assumed standard deviation of a predicted angle immediately after a measurement [rad]."""
_MAX_DEVIATION = 1.5
"""The whole turns of a rotor are computed from its predicted angle only if the standard deviation
of the prediction is smaller than this [rad]."""
_UNMEASURED = 0.07
"""Assumed relative standard deviation of configured lengths [1], typical of handmade parts."""
_MEASURED_ROTOR, _MEASURED_BOND = 0.02, 0.03
"""Assumed relative standard deviations of measured rotor lengths, and of measured bond
lengths [1]; the second one is larger, because bonds may be springs."""
_MAX_LENGTH_ERROR = 0.2
"""A measured length is ignored if it differs from the configured one by more than this [1]."""
_MIN_MEASUREMENTS, _MAX_MEASUREMENTS = 5, 30
"""The mean length of a rotor or bond is used after the first number of measurements, and includes
about the second number of the last ones [1]. A mean over more measurements contains the constant
error of the position in which the mass rested before. Errors of moving dots would be overestimated
by it. Sensitivity: at 0.5x, slowly varying errors of codecs are underestimated; at 10x, errors of
moving dots are overestimated by 3 %."""
_PIVOT_TOLERANCE = 0.25
"""Largest distance of a pivot from its expected position, relative to the spacing [1]."""
_SPACING_TOLERANCE = 0.4
"""The pivots are numbered only if the distances of neighbouring ones differ from multiples of the
spacing by at most this fraction of the spacing [1]."""
_MIN_VISIBLE = 0.8
"""The pivots are numbered as soon as this fraction of them has been visible [1]."""
_MAX_PIVOT_PICTURES = 1000
"""Largest number of averaged positions of a pivot, so that the mean follows slow motions."""
_MAX_BLACK_COST = 4.0
"""A dot counts as black if the cost of the colour black is at most this [1], which is the cost of
an error of two standard deviations."""


class RotorTracks:
    """Angles, rates and lengths of the rotors, tracked from picture to picture."""

    def __init__(self, layout: MarkerLayout) -> None:
        chain = layout.chain
        rotors = chain.number_of_rotors
        self.lengths = chain.rotor_lengths.copy()
        """Mean measured length of each rotor [m], (N,), at first the configured value."""
        self.bonds = chain.rest_lengths[: rotors - 1].copy()
        """Mean measured distance of neighbouring masses [m], (N - 1,), at first the rest
        length."""
        self._colours = layout.colours
        self._length_counts, self._bond_counts = np.zeros(rotors), np.zeros(rotors - 1)
        self._times = np.full((_MEMORY, rotors), -np.inf)
        self._angles = np.zeros((_MEMORY, rotors))
        self._spins = chain.motion is Motion.SPINNER
        self._start = staggered(np.zeros(rotors))
        self._configured = self.lengths.copy(), self.bonds.copy()

    def predict(self, times: Array, pivots: Array, dot_deviation: float) -> Prediction:
        """Return the states predicted for times [s], (N,).

        `pivots` are the positions of the pivots [m], (N, 2), and `dot_deviation` is the standard
        deviation of the position of a dot [m].
        """
        unknown, loose = (n < _MIN_MEASUREMENTS for n in (self._length_counts, self._bond_counts))
        of_lengths = np.where(unknown, _UNMEASURED, _MEASURED_ROTOR) * self.lengths
        of_bonds = np.where(loose, _UNMEASURED, _MEASURED_BOND) * self.bonds
        return Prediction(
            pivots,
            self.lengths,
            np.hypot(of_lengths, dot_deviation),
            *self.predict_angles(times),
            self.bonds,
            np.hypot(of_bonds, dot_deviation),
            self._colours,
        )

    def length_errors(self, lengths: Array) -> Array:
        """Return errors of measured lengths [m], (N,); NaN before `_MIN_MEASUREMENTS` pictures.

        An error is the difference from the mean of n earlier lengths, divided by sqrt(1 + 1 / n).
        """
        counts = np.maximum(self._length_counts, 1.0)
        errors = (lengths - self.lengths) / np.sqrt(1 + 1 / counts)
        return np.where(self._length_counts < _MIN_MEASUREMENTS, np.nan, errors)

    def predict_angles(self, times: Array) -> tuple[Array, Array]:
        """Return angles and standard deviations [rad] predicted for times [s], (N,) each."""
        since = np.minimum(times - self._times[0], 1e3)
        rates, _, _ = self.motion()
        rates = np.where(since < _MAX_GAP, rates, 0.0)
        measured = np.isfinite(self._times[0])
        angles = np.where(measured, self._angles[0] + rates * since, self._start)
        fastest = float(np.abs(rates).max())
        deviations = _MIN_DEVIATION + (_ACCELERATION + fastest**2) * since**2 / 2
        return angles, np.where(measured, np.minimum(deviations, np.pi), np.pi)

    def motion(self) -> tuple[Array, Array, Array]:
        """Return rates [rad/s], accelerations [rad/s^2] and typical rate errors, (N,) each."""
        (t0, t1, t2), (a0, a1, a2) = self._times, self._angles
        with np.errstate(invalid='ignore', divide='ignore'):
            slope = (a0 - a1) / (t0 - t1)
            before = (a1 - a2) / (t1 - t2)
            acceleration = 2 * (slope - before) / (t0 - t2)
            two = (t0 - t1 < _MAX_GAP) & (t0 > t1)
            three = two & (t0 - t2 < _MAX_GAP) & (t1 > t2)
            acceleration = np.where(three, acceleration, 0.0)
            rates = np.where(two, slope + acceleration * (t0 - t1) / 2, 0.0)
            fastest = float(np.abs(rates).max())
            errors = np.minimum((_ACCELERATION + fastest**2) * (t0 - t1), _INITIAL_RATE)
            errors = np.where(three, np.abs(acceleration) * (t0 - t1) / 2, errors)
        return rates, acceleration, np.where(two, errors, max(_INITIAL_RATE, fastest))

    def unwrap(self, times: Array, angles: Array) -> Array:
        """Return the `angles` [rad], (N,), plus the whole turns that the rotors have made.

        The number of turns brings the result as near as possible to the predicted angle. If the
        prediction is too uncertain (see `_MAX_DEVIATION`), another angle replaces it. In a chain
        with `Motion.SPINNER`, this is the mean of the results for two rotors with known turns: the
        nearest one to the left and the nearest one to the right. In other chains, or if no turns
        are known, it is the last measured angle of the rotor.
        """
        expected, deviations = self.predict_angles(times)
        known = np.isfinite(angles) & (deviations < _MAX_DEVIATION)
        turned = np.where(known, expected + wrapped(angles - expected), np.nan)
        for rotor in np.flatnonzero(np.isfinite(angles) & ~known):
            reference = self._reference_angle(turned, int(rotor))
            turned[rotor] = reference + wrapped(angles[rotor] - reference)
        return turned

    def add_angles(self, times: Array, angles: Array) -> None:
        """Add the angles [rad] measured at times [s], (N,) each; NaN for hidden rotors."""
        seen = np.isfinite(angles)
        for older in range(_MEMORY - 1, 0, -1):
            self._times[older, seen] = self._times[older - 1, seen]
            self._angles[older, seen] = self._angles[older - 1, seen]
        self._times[0, seen], self._angles[0, seen] = times[seen], angles[seen]

    def add_lengths(self, pivots: Array, masses: Array) -> None:
        """Update the mean lengths, given pivots and masses [m], (N, 2) each; NaN if hidden."""
        lengths, bonds = self._configured
        _update_means(self.lengths, self._length_counts, lengths, np.hypot(*(masses - pivots).T))
        distances = np.hypot(*np.diff(masses, axis=0).T)
        _update_means(self.bonds, self._bond_counts, bonds, distances)

    def _reference_angle(self, turned: Array, rotor: int) -> float:
        known = np.flatnonzero(np.isfinite(turned))
        if not (self._spins and len(known)):
            measured = np.isfinite(self._times[0, rotor])
            return float(self._angles[0, rotor] if measured else self._start[rotor])
        neighbours = (known[known < rotor][-1:], known[known > rotor][:1])
        return float(np.mean(turned[np.concatenate(neighbours)]))


def _update_means(means: Array, counts: Array, configured: Array, values: Array) -> None:
    valid = np.abs(values / configured - 1) < _MAX_LENGTH_ERROR
    counts[valid] = np.minimum(counts[valid] + 1, _MAX_MEASUREMENTS)
    means[valid] += (values[valid] - means[valid]) / counts[valid]


class Pivots:
    """Mean positions of the pivots, numbered as soon as most of them have been visible."""

    def __init__(self, layout: MarkerLayout) -> None:
        chain = layout.chain
        self.known = np.zeros(chain.number_of_rotors, dtype=bool)
        """Whether the position of each pivot is known, (N,)."""
        self.positions = np.column_stack([chain.pivots, np.zeros(chain.number_of_rotors)])
        """Measured or interpolated positions [m], (N, 2), at first as configured."""
        self.candidates = 0
        """Number of dots that may be pivots."""
        self._layout = layout
        self._spots = np.zeros((0, 2))
        self._counts = np.zeros(0)

    def update(self, points: Array, colour_costs: Array) -> None:
        """Update the pivots with the dots of a picture (see `assign_dots`)."""
        black = colour_costs[:, 0] <= _MAX_BLACK_COST
        if self.known.any():
            self._average(points[:, black])
        else:
            self._collect(points[0, black])

    def _average(self, points: Array) -> None:
        if not points.shape[1]:
            return
        rotors = np.arange(len(self.positions))
        apart = np.hypot(*(points[rotors % 2] - self.positions[:, None]).transpose(2, 0, 1))
        nearest = np.argmin(apart, axis=1)
        spacing, same = self._layout.chain.spacing, self._layout.dot_radius / 2
        seen = apart[rotors, nearest] < np.where(self.known, same, _PIVOT_TOLERANCE * spacing)
        self._counts[seen] = np.minimum(self._counts[seen] + 1, _MAX_PIVOT_PICTURES)
        shift = points[rotors % 2, nearest] - self.positions
        self.positions[seen] += shift[seen] / self._counts[seen, None]
        self.known |= seen

    def _collect(self, points: Array) -> None:
        spacing = self._layout.chain.spacing
        ends = self.positions[0, 0] - spacing / 2, 2 * self.positions[-1, 0] - self.positions[0, 0]
        near = np.abs(points[:, 1]) < _PIVOT_TOLERANCE * spacing
        near &= (points[:, 0] > ends[0]) & (points[:, 0] < ends[1] + spacing)
        for point in points[near]:
            apart = np.hypot(*(self._spots - point).T) if len(self._spots) else np.zeros(0)
            same = int(np.argmin(apart)) if len(apart) else -1
            if same >= 0 and apart[same] < self._layout.label_radius:
                self._counts[same] += 1
                self._spots[same] += (point - self._spots[same]) / self._counts[same]
            else:
                self._spots = np.vstack([self._spots, point])
                self._counts = np.append(self._counts, 1.0)
        self.candidates = len(self._spots)
        rotors = len(self.positions)
        most_frequent = np.argsort(-self._counts, kind='stable')[:rotors]
        order: NDArray[np.intp] = most_frequent[np.argsort(self._spots[most_frequent, 0])]
        if len(order) < _MIN_VISIBLE * rotors:
            return
        xs = self._spots[order, 0]
        steps = np.diff(xs) / spacing
        numbers = np.cumsum(np.rint([xs[0] / spacing, *steps])).astype(np.intp)
        error = np.abs(steps - np.rint(steps)).max(initial=0.0)
        repeated = len(set(numbers.tolist())) < len(numbers)
        if error > _SPACING_TOLERANCE or repeated or numbers[0] < 0 or numbers[-1] >= rotors:
            return
        self.known[numbers] = True
        counts = np.zeros(rotors)
        counts[numbers] = self._counts[order]
        self._counts = counts
        configured = self.positions[:, 0].copy()
        shifts = np.interp(configured, configured[numbers], xs - configured[numbers])
        heights = np.interp(configured, configured[numbers], self._spots[order, 1])
        self.positions = np.column_stack([configured + shifts, heights])
        self.positions[numbers] = self._spots[order]
