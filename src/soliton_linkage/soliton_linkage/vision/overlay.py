# SPDX-License-Identifier: Apache-2.0
"""Pictures on which markers, names of rotors, and walls (kinks and anti-kinks) are drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from soliton_linkage.colours import GREEN, ORANGE, RED, SKY, WHITE, shares
from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.angle_camera import AngleFrame
from soliton_linkage.vision.opencv import Picture, opencv

_FONT_SIZE = 1 / 1800
"""Font scale of OpenCV, divided by the width of the picture [1/pixel]. Letters are readable in
pictures with a width of 1280 pixels."""
_SHADOW = (20, 20, 20)
"""Colour (blue, green, red) of the shadow of letters, for contrast on any background."""
_WALL_LENGTH = 1.35
"""Half length of the line that marks a wall, relative to the rotor length [1]."""
_NAME_DISTANCE = 0.95
"""Distance of a rotor's name from the pivot, relative to the spacing [1]. The name is on the side
of the pivot that is opposite to the mass, and below the pivot if the mass is hidden. At this
distance, it does not cover the label of the pivot."""
_WALL_DEVIATIONS = 2.0
"""Half width of the band around a wall [standard deviations]."""
_OPACITY = 0.35
"""Opacity of the band around a wall [1]."""
_SHIFT = 4
"""Number of fractional bits of the coordinates that are passed to OpenCV."""


class WallMark(NamedTuple):
    """A wall that is drawn."""

    rotor: float
    """Position, measured from rotor 0 [rotor spacings]."""
    deviation: float
    """Standard deviation of the position [rotor spacings]; NaN if it is unknown."""
    charge: int
    """Topological charge: +1 for a kink, -1 for an anti-kink."""


def draw_overlay(
    picture: Picture, frame: AngleFrame, names: Sequence[str], walls: Sequence[WallMark] = ()
) -> Picture:
    """Return a copy of a picture on which markers, rotors, their names, and walls are drawn."""
    cv2 = opencv()
    drawn = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) if picture.ndim == 2 else picture.copy()
    pen = _Pen(cv2, drawn)
    for centre in frame.frame_dots:
        pen.ring(centre, SKY)
    known = frame.pivots[np.isfinite(frame.pivots[:, 0])]
    if len(known) > 1:
        _draw_walls(pen, frame, walls)
    spacings = np.hypot(*np.diff(known, axis=0).T)
    spacing = float(np.median(spacings)) if len(spacings) else 0.0
    widest = max((pen.extent(name)[0] for name in names), default=0.0)
    shown = names if widest < spacing else [str(number) for number in range(len(names))]
    _draw_rotors(pen, frame, shown, _NAME_DISTANCE * spacing)
    text = frame.status or f'all {len(frame.angles)} rotors are visible'
    pen.write(text, np.array([8.0, len(drawn) - 8.0]), ORANGE if frame.status else WHITE)
    return np.asarray(drawn)


class _Pen:
    def __init__(self, cv2: Any, picture: Picture) -> None:
        self._cv2, self.picture = cv2, picture
        self.size = max(picture.shape[1] * _FONT_SIZE, 0.3)
        self.thickness = max(round(picture.shape[1] / 1000), 1)
        self._style = self.thickness, cv2.LINE_AA, _SHIFT

    def ring(self, centre: Array, colour: str) -> None:
        radius = round(7 * self.size * 2**_SHIFT)
        self._cv2.circle(self.picture, _subpixels(centre), radius, _bgr(colour), *self._style)

    def line(self, begin: Array, end: Array, colour: str) -> None:
        ends = _subpixels(begin), _subpixels(end)
        self._cv2.line(self.picture, *ends, _bgr(colour), *self._style)

    def fill(self, corners: Array, colour: str) -> None:
        outline = np.rint(corners).astype(np.int32)
        height, width = self.picture.shape[:2]
        left, top = np.clip(outline.min(axis=0), 0, (width, height))
        right, bottom = np.clip(outline.max(axis=0) + 1, 0, (width, height))
        part = self.picture[top:bottom, left:right]
        if part.size:
            filled = self._cv2.fillPoly(part.copy(), [outline - (left, top)], _bgr(colour))
            part[:] = self._cv2.addWeighted(filled, _OPACITY, part, 1 - _OPACITY, 0.0)

    def write(self, text: str, corner: Array, colour: str) -> None:
        x, y = (round(float(each)) for each in corner)
        font, style = self._cv2.FONT_HERSHEY_SIMPLEX, (self.thickness, self._cv2.LINE_AA)
        for shift, paint in ((1, _SHADOW), (0, _bgr(colour))):
            at = x + shift, y + shift
            self._cv2.putText(self.picture, text, at, font, self.size, paint, *style)

    def extent(self, text: str) -> Array:
        font = self._cv2.FONT_HERSHEY_SIMPLEX
        size, _ = self._cv2.getTextSize(text, font, self.size, self.thickness)
        return np.array(size, dtype=np.float64)

    def write_centred(self, text: str, centre: Array, colour: str) -> None:
        self.write(text, centre + self.extent(text) * [-0.5, 0.5], colour)


def _subpixels(point: Array) -> tuple[int, int]:
    x, y = (round(float(each) * 2**_SHIFT) for each in point)
    return x, y


def _draw_rotors(pen: _Pen, frame: AngleFrame, names: Sequence[str], distance: float) -> None:
    for pivot, mass, name in zip(frame.pivots, frame.masses, names, strict=True):
        if not np.isfinite(pivot).all():
            continue
        if not np.isfinite(mass).all():
            pen.ring(pivot, ORANGE)
            pen.write_centred(name, pivot + np.array([0.0, distance]), ORANGE)
            continue
        pen.line(pivot, mass, GREEN)
        pen.ring(pivot, SKY)
        pen.ring(mass, GREEN)
        away = (pivot - mass) / np.hypot(*(pivot - mass))
        pen.write_centred(name, pivot + distance * away, WHITE)


def _draw_walls(pen: _Pen, frame: AngleFrame, walls: Sequence[WallMark]) -> None:
    known = np.flatnonzero(np.isfinite(frame.pivots[:, 0]))
    along = frame.pivots[known[-1]] - frame.pivots[known[0]]
    along = along / np.hypot(*along)
    across = np.array([along[1], -along[0]])
    lengths = np.hypot(*(frame.masses - frame.pivots).T)
    if not np.isfinite(lengths).any():
        return
    reach = _WALL_LENGTH * float(np.nanmedian(lengths)) * across
    for wall in walls:
        if not math.isfinite(wall.rotor):
            continue
        half = _WALL_DEVIATIONS * wall.deviation if math.isfinite(wall.deviation) else 0.0
        low, middle, high = (
            np.array([np.interp(wall.rotor + step, known, axis) for axis in frame.pivots[known].T])
            for step in (-half, 0.0, half)
        )
        pen.fill(np.array([low - reach, high - reach, high + reach, low + reach]), RED)
        pen.line(middle - reach, middle + reach, RED)
        kind = 'kink' if wall.charge > 0 else 'anti-kink'
        text = f'{kind} at {wall.rotor:.2f}'
        above = middle + reach + 2 * pen.extent(text)[1] * across
        pen.write_centred(text, above, ORANGE)


def _bgr(colour: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * share) for share in shares(colour))
    return blue, green, red
