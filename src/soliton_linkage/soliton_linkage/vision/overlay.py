# SPDX-License-Identifier: Apache-2.0
"""Annotated pictures: markers, the names of the rotors, and walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from soliton_linkage.colours import GREEN, ORANGE, RED, SKY, WHITE, shares
from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.angle_camera import AngleFrame
from soliton_linkage.vision.opencv import Picture, opencv

Colour = tuple[int, int, int]
"""Blue, green and red."""

_SIZE = 1 / 1800
"""Font size over the width of the picture [1/pixel]: readable at 1280 pixels."""
_SHADOW = (20, 20, 20)
"""Colour of the shadow of letters, which makes them readable on any ground."""
_REACH = 1.35
"""Length of the line across the chain at a wall, over the length of the rotors [1]."""
_OUT = 0.95
"""Distance of a rotor's name from its pivot, over the spacing [1]: beyond labels, and nearer to
its own pivot than to most others, however long rotors are."""
_DEVIATIONS = 2.0
"""Half width of a wall in standard deviations [1]."""
_OPACITY = 0.35
"""Opacity of a wall [1]."""
_SHIFT = 4
"""Bits of the fraction of a pixel in coordinates of OpenCV [1]."""


class WallMark(NamedTuple):
    """A wall on the chain."""

    rotor: float
    """Position [rotor spacings from rotor 0]."""
    deviation: float
    """Standard deviation of the position [rotor spacings], NaN if it is unknown."""
    charge: int
    """1 for a kink, -1 for an anti-kink."""


def draw_overlay(
    picture: Picture,
    frame: AngleFrame,
    names: Sequence[str],
    walls: Sequence[WallMark] = (),
) -> Picture:
    """Return a picture with its measurement drawn over it.

    Rings mark dots, lines lead from pivots to masses, and hidden rotors are orange. Numbers
    replace names that do not fit.
    """
    cv2 = opencv()
    drawn = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) if picture.ndim == 2 else picture.copy()
    pen = _Pen(cv2, drawn)
    for place in frame.frame_dots:
        pen.ring(place, _bgr(SKY))
    known = frame.pivots[np.isfinite(frame.pivots[:, 0])]
    if len(known) > 1:
        _draw_walls(pen, frame, walls)
    apart = np.hypot(*np.diff(known, axis=0).T)
    room = float(np.median(apart)) if len(apart) else 0.0
    widest = max((pen.extent(name)[0] for name in names), default=0.0)
    shown = names if widest < room else [str(number) for number in range(len(names))]
    _draw_rotors(pen, frame, shown, _OUT * room)
    text = frame.status or f'all {len(frame.angles)} rotors are seen'
    pen.write(text, np.array([8.0, len(drawn) - 8.0]), _bgr(ORANGE if frame.status else WHITE))
    return np.asarray(drawn)


class _Pen:
    """Drawing functions of OpenCV at fractions of a pixel."""

    def __init__(self, cv2: Any, picture: Picture) -> None:
        self._cv2, self.picture = cv2, picture
        self.size = max(picture.shape[1] * _SIZE, 0.3)
        self.thickness = max(round(picture.shape[1] / 1000), 1)
        self._style = self.thickness, cv2.LINE_AA, _SHIFT

    def ring(self, place: Array, colour: Colour) -> None:
        radius = round(7 * self.size * 2**_SHIFT)
        self._cv2.circle(self.picture, _fine(place), radius, colour, *self._style)

    def line(self, begin: Array, end: Array, colour: Colour) -> None:
        self._cv2.line(self.picture, _fine(begin), _fine(end), colour, *self._style)

    def fill(self, corners: Array, colour: Colour) -> None:
        outline = np.rint(corners).astype(np.int32)
        height, width = self.picture.shape[:2]
        left, top = np.clip(outline.min(axis=0), 0, (width, height))
        right, bottom = np.clip(outline.max(axis=0) + 1, 0, (width, height))
        part = self.picture[top:bottom, left:right]
        if part.size:
            filled = self._cv2.fillPoly(part.copy(), [outline - (left, top)], colour)
            part[:] = self._cv2.addWeighted(filled, _OPACITY, part, 1 - _OPACITY, 0.0)

    def write(self, text: str, place: Array, colour: Colour) -> None:
        """Write letters with a shadow, from a place on."""
        x, y = (round(float(each)) for each in place)
        font, style = self._cv2.FONT_HERSHEY_SIMPLEX, (self.thickness, self._cv2.LINE_AA)
        for aside, paint in ((1, _SHADOW), (0, colour)):
            at = x + aside, y + aside
            self._cv2.putText(self.picture, text, at, font, self.size, paint, *style)

    def extent(self, text: str) -> Array:
        """Return the width and height of letters [pixels]."""
        font = self._cv2.FONT_HERSHEY_SIMPLEX
        size, _ = self._cv2.getTextSize(text, font, self.size, self.thickness)
        return np.array(size, dtype=np.float64)

    def centred(self, text: str, place: Array, colour: Colour) -> None:
        self.write(text, place + self.extent(text) * [-0.5, 0.5], colour)


def _fine(place: Array) -> tuple[int, int]:
    x, y = (round(float(each) * 2**_SHIFT) for each in place)
    return x, y


def _draw_rotors(pen: _Pen, frame: AngleFrame, names: Sequence[str], out: float) -> None:
    """Draw rotors, with names at a distance from their pivots [pixels]."""
    for pivot, mass, name in zip(frame.pivots, frame.masses, names, strict=True):
        if not np.isfinite(pivot).all():
            continue
        if not np.isfinite(mass).all():
            pen.ring(pivot, _bgr(ORANGE))
            pen.centred(name, pivot + np.array([0.0, out]), _bgr(ORANGE))
            continue
        pen.line(pivot, mass, _bgr(GREEN))
        pen.ring(pivot, _bgr(SKY))
        pen.ring(mass, _bgr(GREEN))
        away = (pivot - mass) / np.hypot(*(pivot - mass))
        pen.centred(name, pivot + out * away, _bgr(WHITE))


def _draw_walls(pen: _Pen, frame: AngleFrame, walls: Sequence[WallMark]) -> None:
    known = np.flatnonzero(np.isfinite(frame.pivots[:, 0]))
    along = frame.pivots[known[-1]] - frame.pivots[known[0]]
    along = along / np.hypot(*along)
    across = np.array([along[1], -along[0]])
    lengths = np.hypot(*(frame.masses - frame.pivots).T)
    if not np.isfinite(lengths).any():
        return
    reach = _REACH * float(np.nanmedian(lengths)) * across
    for wall in walls:
        if not math.isfinite(wall.rotor):
            continue
        aside = _DEVIATIONS * wall.deviation if math.isfinite(wall.deviation) else 0.0
        low, middle, high = (
            np.array([np.interp(wall.rotor + step, known, axis) for axis in frame.pivots[known].T])
            for step in (-aside, 0.0, aside)
        )
        pen.fill(np.array([low - reach, high - reach, high + reach, low + reach]), _bgr(RED))
        pen.line(middle - reach, middle + reach, _bgr(RED))
        kind = 'kink' if wall.charge > 0 else 'anti-kink'
        text = f'{kind} at {wall.rotor:.2f}'
        pen.centred(text, middle + reach + 2 * pen.extent(text)[1] * across, _bgr(ORANGE))


def _bgr(colour: str) -> Colour:
    red, green, blue = (round(255 * share) for share in shares(colour))
    return blue, green, red
