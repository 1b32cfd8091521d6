# SPDX-License-Identifier: Apache-2.0
"""Noiseless frames of chains of springs, and where the walls in them truly are.

The place of a wall is that of the nearest point of its static path to the noiseless frame, as it
is on the mean of one period of the slowest phonon, or of the passage of a rotor where that is
shorter: phonons that only shake the wall do not count, what it does more slowly does. Its rate is
the slope of a line through the places of three times as long, or, as springs let slow walls go
more slowly at some places between two rotors than at others, of a cubic. Pushes part a record:
no mean reaches across them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs

from soliton_linkage.linear.bands import gap
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.accuracy.cells.cells import AccuracyCell

_SLOW = 0.25
"""Rotors that a slow wall passes in a period of the slowest phonon, at most [1]."""


@dataclass(frozen=True)
class WallScene:
    """Noiseless frames and the walls in them."""

    angles: Array
    """Actual angles [rad], shape (T, N)."""
    kinetic: Array
    """Kinetic energy [J], shape (T,)."""
    places: Array
    """Of the walls [rotor spacings], shape (T, K)."""
    instants: Array
    """The same without a mean over time."""
    place_rates: Array
    """Rates of the places [rotor spacings / s], shape (T, K)."""
    charges: tuple[int, ...]
    legs: Array
    """Of the orbit, where a wall is alone, else -1, shape (T,)."""
    judged: NDArray[np.bool_]
    """Whether a wall is far enough from the edges and from others, shape (T, K)."""
    pushes: tuple[int, ...] = ()
    """Frames at which the wall was pushed, first of the new motion."""
    impulses: tuple[Array, ...] = ()
    """Angular impulses of the pushes [N m s], shape (N,) each."""


def frames_beside(speed: float, cell: AccuracyCell) -> int:
    """Half the frames of a mean, of a wall with a speed [rotor spacings / s]."""
    time = 1 / max(abs(speed), gap(cell.chain) / (2 * math.pi))
    return max(round(time / (cell.period * cell.chain.time_unit) / 2), 1)


def is_slow(speed: float, chain: Chain) -> bool:
    """Whether a wall of a speed [rotor spacings / s] takes four periods from rotor to rotor.

    They are those of the slowest phonon, or more of them.
    """
    return abs(speed) < _SLOW * gap(chain) / (2 * math.pi)


def smoothed(
    values: Array, beside: int, breaks: list[int] | None = None, bent: bool = False
) -> tuple[Array, Array]:
    """Means over so many values beside each, and slopes over thrice as many, between breaks.

    Slopes are those of lines, or of cubics through bent ways.
    """
    means, slopes = np.empty_like(values), np.empty_like(values)
    ends = [0, *(breaks or []), len(values)]
    for begin, end in pairwise(ends):
        if end > begin:
            piece = values[begin:end]
            about = min(beside, len(piece) - 1)
            wide = min(3 * beside, len(piece) - 1)
            means[begin:end] = _convolved(piece, np.full(2 * about + 1, 1 / (2 * about + 1)))
            order = min(3 if bent else 1, max(2 * wide - 1, 0))
            slopes[begin:end] = _convolved(
                piece, savgol_coeffs(2 * wide + 1, order, deriv=1, use='dot')
            )
    return means, slopes


def _convolved(values: Array, weights: Array) -> Array:
    """Weighted sums about each value, of odd reflections at the ends."""
    beside = len(weights) // 2
    if not beside:
        return np.asarray(weights[0] * values)
    before = 2 * values[0] - values[beside:0:-1]
    after = 2 * values[-1] - values[-2 : -beside - 2 : -1]
    padded = np.concatenate([before, values, after])
    return np.convolve(padded, weights[::-1], 'valid')
