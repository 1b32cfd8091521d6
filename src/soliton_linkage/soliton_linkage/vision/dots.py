# SPDX-License-Identifier: Apache-2.0
"""Detection of dots in a picture, with their centres and colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.dot_fit import FittedDots, fit_dots
from soliton_linkage.vision.layout import COLOURS, DOT_SHARE
from soliton_linkage.vision.opencv import Picture, opencv

MIN_CONTRAST = 20.0
"""Smallest contrast of a fitted dot [grey levels of 256]; good light gives ten times as much."""
_THRESHOLD = 0.3 * MIN_CONTRAST
"""A spot counts as dark if it is darker than its surroundings by this [grey levels]."""
_AREAS = (0.2, 4.0)
"""Smallest and largest accepted area of a dark spot, relative to the area of a resting dot [1]."""
_MAX_RELATIVE_RESIDUAL, _MAX_RESIDUAL = 2.0, 0.02
"""A dot is rejected if its residual is larger than the first factor times the median residual of
all dots, plus the second factor times its contrast [1]."""
_MAX_SHIFT = 2.5
"""Largest distance of a fitted dot from the dark spot at which the fit started [pixels]; half of
the displacement of the dot during the exposure is added to this limit."""
_GREY_SATURATION = 0.25
"""A dot with a larger saturation than this is certainly not black [1]."""
_HUE_DEVIATION = 0.5
"""Standard deviation of a measured hue [rad]."""
MAX_COLOUR_COST = 20.0
"""Largest cost of a wrong colour [1]. It exceeds the cost of a hidden rotor, so that no rotor is
assigned a dot of a clearly wrong colour."""


@dataclass(frozen=True)
class Dots:
    """Centres of K dots in a picture [pixels], (K, 2), with covariances and colours."""

    centres: Array
    covariances: Array
    """Covariances of the centres [pixels^2], (K, 2, 2)."""
    colour_costs: Array
    """Cost (-2 log likelihood) of each of the C `COLOURS` for each dot [1], (K, C)."""


def find_dots(
    grey: Picture,
    picture: Picture,
    region: tuple[int, int, int, int],
    predicted: Array,
    outlines: Array,
    smears: Array,
    reaches: Array,
) -> Dots:
    """Return the dots in a region (left, top, right, bottom) [pixels].

    The distance of a dot from one of the M positions `predicted`, (M, 2), must be smaller than the
    corresponding element of `reaches`, (M,) [pixels]. The dot is fitted with those elements of
    `outlines`, (M, 2, 2), and `smears`, (M, 2), that belong to the nearest position (see
    `fit_dots`).
    """
    radius = float(np.median(np.abs(np.linalg.det(outlines)))) ** -0.5
    left, top, right, bottom = region
    longest = float(np.hypot(*smears.T).max(initial=0.0))
    spots = _spots(grey[top:bottom, left:right], radius, longest) + np.array([left, top])
    distances = _distances(spots, predicted)
    near = (distances < reaches).any(axis=1)
    spots, distances = spots[near], distances[near]
    surroundings = _sampled(grey, spots, _label_ring(radius))
    darker = surroundings - _sampled(grey, spots, np.zeros((1, 2))) > _THRESHOLD
    dark = darker.mean(axis=1) > 0.5
    spots, nearest = spots[dark], np.argmin(distances[dark], axis=1)
    fitted = fit_dots(grey, spots, outlines[nearest], DOT_SHARE, smears[nearest])
    good = np.flatnonzero(_accepted(fitted, spots, smears[nearest]))
    centres = fitted.centres[good]
    first = ~np.tril(_distances(centres, centres) < radius, -1).any(axis=1)
    costs = _colour_costs(picture, centres[first], radius)
    return Dots(centres[first], fitted.covariances[good[first]], costs)


def _distances(points: Array, others: Array) -> Array:
    return np.asarray(np.hypot(*(points[:, None] - others).transpose(2, 0, 1)))


def _spots(grey: Picture, radius: float, smear: float) -> Array:
    cv2 = opencv()
    block = 2 * round(radius / DOT_SHARE) + 1
    mask = cv2.adaptiveThreshold(
        np.ascontiguousarray(grey),
        255,
        cv2.ADAPTIVE_THRESH_MEAN_C,
        cv2.THRESH_BINARY_INV,
        max(block, 3),
        _THRESHOLD,
    )
    _, _, statistics, centroids = cv2.connectedComponentsWithStats(mask, connectivity=4)
    areas = statistics[:, cv2.CC_STAT_AREA]
    sides = statistics[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    dot = np.pi * radius**2
    fits = (areas > _AREAS[0] * dot) & (areas < _AREAS[1] * dot + 2 * radius * smear)
    fits &= sides < 3 * radius + smear + 3
    fits[0] = False
    return np.asarray(centroids[fits], dtype=np.float64)


def _label_ring(radius: float) -> Array:
    turns = np.arange(12) * np.pi / 6
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.asarray(radius * (1 + 1 / DOT_SHARE) / 2 * ring)


def _accepted(fitted: FittedDots, spots: Array, smears: Array) -> NDArray[np.bool_]:
    shifts = np.hypot(*(fitted.centres - spots).T)
    good = (fitted.contrasts > MIN_CONTRAST) & (fitted.whites < 300)
    good &= shifts < _MAX_SHIFT + np.hypot(*smears.T) / 2
    usual = float(np.median(fitted.residuals[good])) if good.any() else 0.0
    good &= fitted.residuals < _MAX_RELATIVE_RESIDUAL * usual + _MAX_RESIDUAL * fitted.contrasts
    return np.asarray(good)


def _colour_costs(picture: Picture, centres: Array, radius: float) -> Array:
    """Return -2 log likelihood of C colours for each of K dots, (K, C); 0 for a grey picture."""
    if picture.ndim == 2 or not len(centres):
        return np.zeros((len(centres), len(COLOURS)))
    middle = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]) * min(radius / 3, 1.0)
    dot = np.median(_sampled(picture, centres, middle), axis=1)
    white = np.median(_sampled(picture, centres, _label_ring(radius)), axis=1)
    relative = np.clip(dot / np.maximum(white, 1.0), 0.0, 1.0)[:, ::-1]
    hue = _hues(relative)
    greyness = 1 - np.clip(np.ptp(relative, axis=1) / _GREY_SATURATION, 0.0, 1.0)
    costs = np.empty((len(centres), len(COLOURS)))
    costs[:, 0] = MAX_COLOUR_COST * (1 - greyness)
    for colour, paint in enumerate(COLOURS[1:], start=1):
        error = np.angle(hue * np.conj(_hues(np.array(paint) / 255.0)))
        costs[:, colour] = np.minimum((error / _HUE_DEVIATION) ** 2, MAX_COLOUR_COST)
        costs[:, colour] += (MAX_COLOUR_COST - costs[:, colour]) * greyness
    return costs


def _sampled(picture: Picture, centres: Array, offsets: Array) -> Array:
    points = np.rint(centres[:, None] + offsets).astype(np.intp)
    height, width = picture.shape[:2]
    columns, rows = np.clip(points[..., 0], 0, width - 1), np.clip(points[..., 1], 0, height - 1)
    return picture[rows, columns].astype(np.float64)


def _hues(colours: Array) -> NDArray[np.complex128]:
    red, green, blue = np.moveaxis(colours, -1, 0)
    return np.asarray(red + np.exp(2j * np.pi / 3) * green + np.exp(-2j * np.pi / 3) * blue)
