# SPDX-License-Identifier: Apache-2.0
"""Finds the dots in a picture: where they are and what colour they have."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.dot_fit import FittedDots, fit_dots
from soliton_linkage.vision.layout import COLOURS, DOT_SHARE
from soliton_linkage.vision.opencv import Picture, opencv

_LEAST_CONTRAST = 20.0
"""Of a dot and its label [grey levels of 256], a tenth of what they have in good light."""
_DARKER = 0.3
"""Of the least contrast by which the pixels of a dot are darker than what is about them [1]."""
_AREAS = (0.2, 4.0)
"""Least and most pixels of a spot, over those of a dot at rest [1]."""
_MOST_MISFITS, _LARGEST_MISFIT = 2.0, 0.02
"""What the model of a dot leaves at most, in terms of what it leaves of most, which is noise, and
of its contrast [1]: of one that is partly hidden it is more."""
_FARTHEST = 2.5
"""From the middle of a spot to the dot that is fitted to it at most, beside its smear [pixels]."""
_GREY = 0.25
"""Part of a colour that differs from grey, below which a dot is black [1]."""
_HUE = 0.5
"""Standard deviation of the hue that a camera sees [rad]."""
MOST_COST = 20.0
"""Of a wrong colour [1], more than that of a rotor that is hidden."""


@dataclass(frozen=True)
class Dots:
    """K dots of a picture."""

    places: Array
    """Of their centres [pixels], shape (K, 2)."""
    covariances: Array
    """Of their places [pixels^2], shape (K, 2, 2)."""
    colour_costs: Array
    """How unlike each of `COLOURS` they are: minus twice a log likelihood [1], (K, C)."""

    def __len__(self) -> int:
        return len(self.places)

    def chosen(self, which: NDArray[np.bool_]) -> Dots:
        """Some of them."""
        return replace(
            self,
            places=self.places[which],
            covariances=self.covariances[which],
            colour_costs=self.colour_costs[which],
        )


def find_dots(
    grey: Picture,
    picture: Picture,
    region: tuple[int, int, int, int],
    predicted: Array,
    outlines: Array,
    smears: Array,
) -> Dots:
    """Dots in a region: left, top, right, bottom [pixels].

    Each has the outline, (M, 2, 2) [1/pixel], as of `fit_dots`, and the smear of the predicted
    place that it is nearest to, (M, 2) each [pixels].
    """
    radius = float(np.median(np.abs(np.linalg.det(outlines)))) ** -0.5
    left, top, right, bottom = region
    longest = float(np.hypot(*smears.T).max(initial=0.0))
    spots = _spots(grey[top:bottom, left:right], radius, longest) + np.array([left, top])
    spots = spots[_are_on_labels(grey, spots, radius)]
    nearest = _nearest(spots, predicted)
    ways = smears[nearest]
    fitted = fit_dots(grey, spots, outlines[nearest], DOT_SHARE, ways)
    good = _are_dots(fitted, spots, ways)
    dots = Dots(
        fitted.places[good],
        fitted.covariances[good],
        _colour_costs(picture, fitted.places[good], radius),
    )
    return dots.chosen(_first_of_each(dots.places, radius))


def _spots(grey: Picture, radius: float, smear: float) -> Array:
    """Middles of dark spots of the size of a dot [pixels], shape (K, 2)."""
    cv2 = opencv()
    block = 2 * round(radius / DOT_SHARE) + 1
    mask = cv2.adaptiveThreshold(
        np.ascontiguousarray(grey),
        255,
        cv2.ADAPTIVE_THRESH_MEAN_C,
        cv2.THRESH_BINARY_INV,
        max(block, 3),
        _DARKER * _LEAST_CONTRAST,
    )
    _, _, figures, middles = cv2.connectedComponentsWithStats(mask, connectivity=4)
    areas = figures[:, cv2.CC_STAT_AREA]
    sides = figures[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    dot = np.pi * radius**2
    fits = (areas > _AREAS[0] * dot) & (areas < _AREAS[1] * dot + 2 * radius * smear)
    fits &= sides < 3 * radius + smear + 3
    fits[0] = False
    return np.asarray(middles[fits], dtype=np.float64)


def _are_on_labels(grey: Picture, spots: Array, radius: float) -> NDArray[np.bool_]:
    """Whether most of what is about spots is brighter, rather than labels on one side of them."""
    about = _sampled(grey, spots, _label(radius))
    brighter = about - _sampled(grey, spots, np.zeros((1, 2))) > _DARKER * _LEAST_CONTRAST
    return np.asarray(brighter.mean(axis=1) > 0.5)


def _label(radius: float) -> Array:
    """Places on the label of a dot, from its centre [pixels], shape (12, 2)."""
    turns = np.arange(12) * np.pi / 6
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.asarray(radius * (1 + 1 / DOT_SHARE) / 2 * ring)


def _nearest(spots: Array, predicted: Array) -> NDArray[np.intp]:
    apart = np.hypot(*(spots[:, None] - predicted).transpose(2, 0, 1))
    return np.asarray(np.argmin(apart, axis=1))


def _are_dots(fitted: FittedDots, spots: Array, ways: Array) -> NDArray[np.bool_]:
    moved = np.hypot(*(fitted.places - spots).T)
    good = (fitted.contrasts > _LEAST_CONTRAST) & (fitted.whites < 300)
    good &= moved < _FARTHEST + np.hypot(*ways.T) / 2
    usual = float(np.median(fitted.misfits[good])) if good.any() else 0.0
    good &= fitted.misfits < _MOST_MISFITS * usual + _LARGEST_MISFIT * fitted.contrasts
    return np.asarray(good)


def _first_of_each(places: Array, radius: float) -> NDArray[np.bool_]:
    """Which dots are not the same as one before."""
    apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    return np.asarray(~np.tril(apart < radius, -1).any(axis=1))


def _colour_costs(picture: Picture, places: Array, radius: float) -> Array:
    """How unlike the colours of a layout dots are, shape (K, C); 0 in a grey picture."""
    if picture.ndim == 2 or not len(places):
        return np.zeros((len(places), len(COLOURS)))
    middle = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]) * min(radius / 3, 1.0)
    dot = np.median(_sampled(picture, places, middle), axis=1)
    white = np.median(_sampled(picture, places, _label(radius)), axis=1)
    share = np.clip(dot / np.maximum(white, 1.0), 0.0, 1.0)[:, ::-1]
    hue = _hues(share)
    greyness = 1 - np.clip(np.ptp(share, axis=1) / _GREY, 0.0, 1.0)
    costs = np.empty((len(places), len(COLOURS)))
    costs[:, 0] = MOST_COST * (1 - greyness)
    for colour, paint in enumerate(COLOURS[1:], start=1):
        turn = np.angle(hue * np.conj(_hues(np.array(paint) / 255.0)))
        costs[:, colour] = np.minimum((turn / _HUE) ** 2, MOST_COST)
        costs[:, colour] += (MOST_COST - costs[:, colour]) * greyness
    return costs


def _sampled(picture: Picture, places: Array, offsets: Array) -> Array:
    points = np.rint(places[:, None] + offsets).astype(np.intp)
    height, width = picture.shape[:2]
    columns, rows = np.clip(points[..., 0], 0, width - 1), np.clip(points[..., 1], 0, height - 1)
    return picture[rows, columns].astype(np.float64)


def _hues(shares: Array) -> NDArray[np.complex128]:
    """Hue of red, green and blue, as a complex number on its angle."""
    red, green, blue = np.moveaxis(shares, -1, 0)
    return np.asarray(red + np.exp(2j * np.pi / 3) * green + np.exp(-2j * np.pi / 3) * blue)
