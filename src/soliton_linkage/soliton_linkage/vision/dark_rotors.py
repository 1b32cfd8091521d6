# SPDX-License-Identifier: Apache-2.0
"""Measurement of angles without markers: separate dark rotors on a light background.

Each rotor is a dark bar. The moments of the darkness of a bar give the middle and the length of
the bar, and a fitted line gives the axis of the bar. The pivots are those ends of the bars that
lie on one common line. The camera must face the chain with rotor 0 on the left, and bonds must be
thinner than rotors. The standard deviation of an angle is computed from the pixel noise, and
multiplied by a common factor. This factor is the ratio of the observed changes of bar lengths to
the changes that pixel noise causes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.angle_camera import AngleFrame, hidden_frame
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.dot_errors import FadingMeanSquare
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage.vision.rotor_tracks import RotorTracks

_AREA_RANGE = (0.4, 1.8)
"""Smallest and largest accepted area of a rotor in the picture, relative to the median area of all
rotors [1]; two rotors that touch have a larger area."""
_MIN_ASPECT = 2.0
"""A dark spot counts as a rotor only if its ratio of length to width is at least this [1], so that
its axis is defined."""
_MAX_PIVOT_SHIFT = 0.35
"""Largest accepted shift of a pivot since the first picture, relative to the spacing [1]."""
_ITERATIONS = 3
"""Number of iterations in the fit of a direction [1]; each reduces the error at least tenfold."""
_RANK_TOLERANCE = 1e-3
"""The fit of the line through the pivots also estimates by how much the pivots lie beyond the ends
of the bars, relative to half the bar length. The fit neglects singular values below this times the
largest one [1]. Therefore, if all bars are nearly parallel to the line, the pivots remain at the
ends of the bars."""
_MIN_NOISE = 0.3
"""Lower limit of the noise of a pixel [grey levels], due to the rounding of grey levels."""
_MAX_MEASUREMENTS = 1000
"""Largest number of pictures over which the length of a rotor is averaged."""
_MIN_AREA = 12
"""Smallest accepted area of a rotor [pixels]."""


@dataclass(frozen=True)
class _Bars:
    """Middles of K dark bars, and vectors from a middle to one end [pixels], (K, 2) each."""

    middles: Array
    halves: Array
    deviations: Array
    """Standard deviations of the direction [rad] and of the half length [pixels], (K, 2)."""


class DarkRotors:
    """Measurement of the angles of a chain without markers."""

    def __init__(self, layout: MarkerLayout, camera: Camera) -> None:
        self.tracks = RotorTracks(layout)
        self._camera = camera
        self._rotors = layout.chain.number_of_rotors
        self._pivots: Array | None = None
        self._lengths, self._counts = np.zeros((2, self._rotors))
        self._length_errors = FadingMeanSquare()

    def measure(self, time: float, picture: Picture) -> AngleFrame:
        """Measure a picture whose exposure begins at `time` [s].

        Raises ValueError if the picture does not have the size of the camera.
        """
        bars = _bars(self._camera.checked_grey(picture))
        delay = self._camera.middle_delay
        if self._pivots is None and len(bars.middles) != self._rotors:
            return hidden_frame(
                self._rotors,
                delay,
                f'the picture shows {len(bars.middles)} of {self._rotors} dark rotors; uncover '
                'all of them, and light the background evenly',
            )
        pivots, arms, along = _find_pivots(bars)
        if self._pivots is None:
            self._pivots = pivots[np.argsort(pivots @ along)]
        return self._frame(time + delay, delay, bars, pivots, arms, along)

    def _frame(
        self, time: float, delay: float, bars: _Bars, pivots: Array, arms: Array, along: Array
    ) -> AngleFrame:
        assert self._pivots is not None
        apart = np.hypot(*(pivots[:, None] - self._pivots).transpose(2, 0, 1))
        spacing = np.hypot(*(self._pivots[-1] - self._pivots[0])) / max(self._rotors - 1, 1)
        rotors = np.argmin(apart, axis=1)
        near = apart[np.arange(len(rotors)), rotors] < _MAX_PIVOT_SHIFT * spacing
        up = np.array([along[1], -along[0]])
        angles, deviations = np.full((2, self._rotors), np.nan)
        masses = np.full((self._rotors, 2), np.nan)
        angles[rotors[near]] = np.arctan2(arms[near] @ along, arms[near] @ up)
        factor = self._error_factor(rotors[near], bars, near)
        deviations[rotors[near]] = factor * bars.deviations[near, 0]
        masses[rotors[near]] = pivots[near] + arms[near]
        times = np.full(self._rotors, time)
        turned = self.tracks.unwrap(times, angles)
        self.tracks.add_angles(times, turned)
        hidden = int(np.isnan(turned).sum())
        status = f'{hidden} of {self._rotors} rotors are hidden' if hidden else ''
        none = np.zeros((0, 2))
        return AngleFrame(delay, turned, deviations, masses, self._pivots.copy(), none, status)

    def _error_factor(
        self, rotors: NDArray[np.intp], bars: _Bars, which: NDArray[np.bool_]
    ) -> float:
        """Return the ratio of observed length errors to errors due to pixel noise [1]."""
        lengths = np.hypot(*bars.halves[which].T)
        known = self._counts[rotors] > 0
        errors = (lengths - self._lengths[rotors]) / bars.deviations[which, 1]
        self._length_errors.add(errors[known])
        self._counts[rotors] = np.minimum(self._counts[rotors] + 1, _MAX_MEASUREMENTS)
        self._lengths[rotors] += (lengths - self._lengths[rotors]) / self._counts[rotors]
        return float(np.sqrt(self._length_errors.value()))


def _bars(grey: Picture) -> _Bars:
    cv2 = opencv()
    level, mask = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
    thin = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, thin)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    areas = statistics[1:, cv2.CC_STAT_AREA]
    valid = areas >= _MIN_AREA
    median = float(np.median(areas[valid])) if valid.any() else 0.0
    valid &= (areas > _AREA_RANGE[0] * median) & (areas < _AREA_RANGE[1] * median)
    noise = float(np.median(np.abs(np.diff(grey[::7].astype(float), axis=1)))) / 0.954
    found = [
        bar
        for label in (np.flatnonzero(valid) + 1).tolist()
        if (bar := _bar(grey, labels, statistics[label], label, level, noise)) is not None
    ]
    if not found:
        return _Bars(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2)))
    return _Bars(*(np.array(part) for part in zip(*found, strict=True)))


def _bar(
    grey: Picture,
    labels: NDArray[np.int32],
    statistics: Array,
    label: int,
    level: float,
    noise: float,
) -> tuple[Array, Array, Array] | None:
    """Return middle, half-length vector and deviations of a dark spot; None if it is too round."""
    left, top, width, height = (int(each) for each in statistics[:4])
    rows = slice(max(top - 2, 0), top + height + 2)
    columns = slice(max(left - 2, 0), left + width + 2)
    own = opencv().dilate((labels[rows, columns] == label).astype(np.uint8), np.ones((3, 3)))
    weights = np.where(own > 0, np.maximum(level - grey[rows, columns], 0.0), 0.0)
    y, x = np.nonzero(weights)
    w = weights[y, x]
    points = np.column_stack([x + columns.start, y + rows.start]).astype(np.float64)
    total = w.sum()
    middle = w @ points / total
    away = points - middle
    moments, axes = np.linalg.eigh((away * w[:, None]).T @ away / total)
    if moments[1] < _MIN_ASPECT**2 * max(moments[0], 1e-9):
        return None
    half, width = np.sqrt(3 * moments[1]), np.sqrt(12 * moments[0])
    direction, turning = _fit_axis(away, w, axes[:, 1], half - width / 2)
    longer = (away @ axes[:, 1]) ** 2 - moments[1]
    lengthening = 1.5 * float(np.sqrt(np.sum(longer**2))) / (half * total)
    return middle, direction * half, max(noise, _MIN_NOISE) * np.array([turning, lengthening])


def _fit_axis(points: Array, weights: Array, axis: Array, reach: float) -> tuple[Array, float]:
    """Return the direction of a line through points, and its standard deviation for unit noise."""
    for _ in range(_ITERATIONS):
        normal = np.array([-axis[1], axis[0]])
        taper = np.maximum(1 - (points @ axis / reach) ** 2, 0.0)
        inner = taper * weights
        away = points - inner @ points / inner.sum()
        along, beside = away @ axis, away @ normal
        lever = inner @ along**2
        axis = axis + inner @ (along * beside) / lever * normal
        axis /= np.hypot(*axis)
    return axis, float(np.sqrt(np.sum((taper * along * beside) ** 2)) / lever)


def _find_pivots(bars: _Bars) -> tuple[Array, Array, Array]:
    """Return pivots and arms of K bars [pixels], (K, 2) each, and the direction of the chain.

    The arm of a bar is the vector from its pivot to its free end.
    """
    pivots, arms = bars.middles, bars.halves
    middle, along = _line(pivots)
    for _ in range(_ITERATIONS):
        normal = np.array([-along[1], along[0]])
        away = bars.middles - middle
        further = np.abs((away + bars.halves) @ normal) > np.abs((away - bars.halves) @ normal)
        arms = np.where(further[:, None], bars.halves, -bars.halves)
        row = np.column_stack([np.ones(len(arms)), away @ along, arms @ normal])
        solution = np.linalg.lstsq(row, (away - arms) @ normal, rcond=_RANK_TOLERANCE)[0]
        along = along + solution[1] * normal
        along /= np.hypot(*along)
        pivots = bars.middles - (1 + solution[2]) * arms
        middle = pivots.mean(axis=0) if len(pivots) else middle
    return pivots, bars.middles + arms - pivots, along


def _line(points: Array) -> tuple[Array, Array]:
    middle = points.mean(axis=0) if len(points) else np.zeros(2)
    if len(points) < 2:
        return middle, np.array([1.0, 0.0])
    along = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    return middle, along if along[0] > 0 else -along
