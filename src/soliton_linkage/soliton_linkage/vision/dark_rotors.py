# SPDX-License-Identifier: Apache-2.0
"""Angles without markers: dark rotors that do not touch each other, on a light ground.

A rotor's axis is that of the second moments of its darkness, and it ends half its length from its
middle. The ends that stand in a row are the pivots; from there the axis leads to the mass. The
camera looks squarely at the chain, rotor 0 on the left. Bonds are thinner than the rotors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.angle_frame import AngleFrame, check_picture, no_rotors
from soliton_linkage.vision.dots import Picture
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage.vision.lens.camera import Camera
from soliton_linkage.vision.opencv import opencv
from soliton_linkage.vision.rotor_tracks import RotorTracks

_LEAST_SHARE = 0.4
"""Area of a rotor over that of most, at least [1]: parts of hidden ones are none."""
_LARGEST_SHARE = 1.8
"""And at most [1]: two that touch are none."""
_LEAST_LENGTH = 2.0
"""Of a rotor over its width [1]: else its axis is not its own."""
_BESIDE = 0.35
"""Of the spacing by which a pivot is along the chain from where it was before, at most [1]."""
_FEWEST_PIXELS = 12
"""That a rotor covers [1]."""


@dataclass(frozen=True)
class _Bars:
    """K dark bars: middles and halves of their lengths as vectors [pixels], and deviations."""

    middles: Array
    halves: Array
    deviations: Array
    """Of their directions [rad], shape (K,)."""


class DarkRotors:
    """Sees the angles of a chain without markers."""

    def __init__(self, layout: MarkerLayout, camera: Camera) -> None:
        """Have seen nothing yet."""
        self.tracks = RotorTracks(layout)
        self._camera = camera
        self._rotors = layout.chain.number_of_rotors
        self._pivots: Array | None = None

    def look(self, time: float, picture: Picture) -> AngleFrame:
        """Angles in a picture that was begun at a time [s], as of an `AngleCamera`.

        Raises ValueError where it has not the size of the camera's pictures.
        """
        check_picture(self._camera, picture)
        cv2 = opencv()
        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        bars = _bars(grey)
        delay = self._camera.exposure / 2 + self._camera.row_time * self._camera.height / 2
        if self._pivots is None and len(bars.middles) != self._rotors:
            return no_rotors(
                self._rotors,
                delay,
                f'{len(bars.middles)} dark rotors are seen for {self._rotors}; uncover all of '
                'them, and light the ground behind them evenly',
            )
        pivots, arms, along = _upright(bars)
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
        near = apart[np.arange(len(rotors)), rotors] < _BESIDE * spacing
        up = np.array([along[1], -along[0]])
        angles, deviations = np.full(self._rotors, np.nan), np.full(self._rotors, np.nan)
        masses = np.full((self._rotors, 2), np.nan)
        angles[rotors[near]] = np.arctan2(arms[near] @ along, arms[near] @ up)
        deviations[rotors[near]] = bars.deviations[near]
        masses[rotors[near]] = pivots[near] + arms[near]
        times = np.full(self._rotors, time)
        turned = self.tracks.unwrapped(times, angles)
        self.tracks.take(times, turned)
        hidden = int(np.isnan(turned).sum())
        status = f'{hidden} of {self._rotors} rotors are hidden' if hidden else ''
        own, none = self._pivots.copy(), np.zeros((0, 2))
        return AngleFrame(delay, turned, deviations, masses, own, none, status)


def _bars(grey: Picture) -> _Bars:
    """Dark bars in a picture, without what is thinner."""
    cv2 = opencv()
    level, mask = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
    thin = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, thin)
    _, labels, figures, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    areas = figures[1:, cv2.CC_STAT_AREA]
    of_size = areas >= _FEWEST_PIXELS
    usual = float(np.median(areas[of_size])) if of_size.any() else 0.0
    of_size &= (areas > _LEAST_SHARE * usual) & (areas < _LARGEST_SHARE * usual)
    white = float(np.median(grey[grey > level])) if (grey > level).any() else 255.0
    noise = float(np.median(np.abs(np.diff(grey[::7].astype(float), axis=1)))) / 0.954
    found = [
        bar
        for number in np.flatnonzero(of_size)
        if (bar := _bar(grey, labels, figures[number + 1], int(number) + 1, white, noise))
        is not None
    ]
    parts = [np.array(part) for part in zip(*found, strict=True)] if found else []
    return _Bars(*parts) if parts else _Bars(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))


def _bar(
    grey: Picture,
    labels: NDArray[np.int32],
    figure: Array,
    number: int,
    white: float,
    noise: float,
) -> tuple[Array, Array, float] | None:
    """Middle and half length [pixels] and deviation of the direction [rad] of a dark bar."""
    left, top, width, height = (int(each) for each in figure[:4])
    rows = slice(max(top - 2, 0), top + height + 2)
    columns = slice(max(left - 2, 0), left + width + 2)
    own = opencv().dilate((labels[rows, columns] == number).astype(np.uint8), np.ones((3, 3)))
    weights = np.where(own > 0, np.maximum(white - grey[rows, columns], 0.0), 0.0)
    y, x = np.nonzero(weights)
    w = weights[y, x]
    points = np.column_stack([x + columns.start, y + rows.start]).astype(np.float64)
    total = w.sum()
    middle = w @ points / total
    away = points - middle
    moments, axes = np.linalg.eigh((away * w[:, None]).T @ away / total)
    if moments[1] < _LEAST_LENGTH**2 * max(moments[0], 1e-9):
        return None
    long, short = away @ axes[:, 1], away @ axes[:, 0]
    spread = float(np.sqrt(np.sum((long * short) ** 2))) * max(noise, 0.3)
    deviation = spread / (total * (moments[1] - moments[0]))
    return middle, axes[:, 1] * np.sqrt(3 * moments[1]), deviation


def _upright(bars: _Bars) -> tuple[Array, Array, Array]:
    """Pivots and arms from there to the masses [pixels], (K, 2) each, and which way is along."""
    middle, along = _line(bars.middles)
    for _ in range(3):
        normal = np.array([-along[1], along[0]])
        ahead = np.abs((bars.middles + bars.halves - middle) @ normal)
        behind = np.abs((bars.middles - bars.halves - middle) @ normal)
        arms = np.where((ahead > behind)[:, None], bars.halves, -bars.halves)
        pivots = bars.middles - arms
        middle, along = _line(pivots)
    return pivots, 2 * arms, along


def _line(points: Array) -> tuple[Array, Array]:
    """Middle and direction, to the right, of a line through points [pixels]."""
    middle = points.mean(axis=0) if len(points) else np.zeros(2)
    if len(points) < 2:
        return middle, np.array([1.0, 0.0])
    along = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    return middle, along if along[0] > 0 else -along
