# SPDX-License-Identifier: Apache-2.0
"""Dots in a picture: places and colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.dot_fit import FittedDots, fit_dots
from soliton_linkage.vision.layout import COLOURS, DOT_SHARE
from soliton_linkage.vision.opencv import Picture, opencv

_LEAST_CONTRAST = 20.0
"""Least contrast of a dot [grey levels of 256]: a tenth of that in good light."""
_DARKER = 0.3
"""Darkness of the pixels of a dot, over the least contrast [1]."""
_AREAS = (0.2, 4.0)
"""Least and largest area of a spot, over that of a dot at rest [1]."""
_MOST_MISFITS, _LARGEST_MISFIT = 2.0, 0.02
"""Largest misfits of a dot, over the usual one and over its contrast [1]: partly hidden dots have
larger ones."""
_FARTHEST = 2.5
"""Largest distance of a fitted dot from its spot, beside its smear [pixels]."""
_GREY = 0.25
"""Largest saturation of a black dot [1]."""
_HUE = 0.5
"""Standard deviation of a measured hue [rad]."""
MOST_COST = 20.0
"""Cost of a wrong colour [1], more than that of a hidden rotor."""


@dataclass(frozen=True)
class Dots:
    """K dots of a picture."""

    places: Array
    """Centres [pixels], shape (K, 2)."""
    covariances: Array
    """Covariances of the centres [pixels^2], shape (K, 2, 2)."""
    colour_costs: Array
    """Minus twice the log likelihood of each of `COLOURS` [1], (K, C)."""


def find_dots(
    grey: Picture,
    picture: Picture,
    region: tuple[int, int, int, int],
    predicted: Array,
    outlines: Array,
    smears: Array,
) -> Dots:
    """Return the dots in a region: left, top, right, bottom [pixels].

    Each has the outline, (M, 2, 2) [1/pixel], see `fit_dots`, and the smear of the nearest
    predicted place, (M, 2) each [pixels].
    """
    radius = float(np.median(np.abs(np.linalg.det(outlines)))) ** -0.5
    left, top, right, bottom = region
    longest = float(np.hypot(*smears.T).max(initial=0.0))
    spots = _spots(grey[top:bottom, left:right], radius, longest) + np.array([left, top])
    about = _sampled(grey, spots, _label(radius))
    brighter = about - _sampled(grey, spots, np.zeros((1, 2))) > _DARKER * _LEAST_CONTRAST
    spots = spots[brighter.mean(axis=1) > 0.5]
    nearest = np.argmin(_distances(spots, predicted), axis=1)
    ways = smears[nearest]
    fitted = fit_dots(grey, spots, outlines[nearest], DOT_SHARE, ways)
    good = np.flatnonzero(_are_dots(fitted, spots, ways))
    places = fitted.places[good]
    first = ~np.tril(_distances(places, places) < radius, -1).any(axis=1)
    costs = _colour_costs(picture, places[first], radius)
    return Dots(places[first], fitted.covariances[good[first]], costs)


def _distances(places: Array, others: Array) -> Array:
    """Return the distance of each place from each other one, shape (K, M)."""
    return np.asarray(np.hypot(*(places[:, None] - others).transpose(2, 0, 1)))


def _spots(grey: Picture, radius: float, smear: float) -> Array:
    """Return the middles of dark spots of the size of a dot [pixels], shape (K, 2)."""
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


def _label(radius: float) -> Array:
    """Return points on the label of a dot, from its centre [pixels], shape (12, 2)."""
    turns = np.arange(12) * np.pi / 6
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.asarray(radius * (1 + 1 / DOT_SHARE) / 2 * ring)


def _are_dots(fitted: FittedDots, spots: Array, ways: Array) -> NDArray[np.bool_]:
    moved = np.hypot(*(fitted.places - spots).T)
    good = (fitted.contrasts > _LEAST_CONTRAST) & (fitted.whites < 300)
    good &= moved < _FARTHEST + np.hypot(*ways.T) / 2
    usual = float(np.median(fitted.misfits[good])) if good.any() else 0.0
    good &= fitted.misfits < _MOST_MISFITS * usual + _LARGEST_MISFIT * fitted.contrasts
    return np.asarray(good)


def _colour_costs(picture: Picture, places: Array, radius: float) -> Array:
    """Return the costs of the colours of dots, shape (K, C); 0 in a grey picture."""
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
    """Return the hue of red, green and blue as the argument of a complex number."""
    red, green, blue = np.moveaxis(shares, -1, 0)
    return np.asarray(red + np.exp(2j * np.pi / 3) * green + np.exp(-2j * np.pi / 3) * blue)
