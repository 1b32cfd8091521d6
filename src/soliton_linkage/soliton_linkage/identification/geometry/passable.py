# SPDX-License-Identifier: Apache-2.0
"""Lengths that let a wall pass where one has passed.

Bonds of a chain may be so near the limits of `solitons.passage` that estimates of their lengths
lie beyond it, although the wall of the recording was stopped by none. Such lengths are moved
across by the least that the readings allow, as conditions in a least squares adjustment do: for
conditions that are short of zero by s, with the slopes G and lengths of the covariance C,

    dp = C G^T (G C G^T)^-1 s.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from soliton_linkage.identification.geometry.lengths import OF_A_ROTOR, Lengths
from soliton_linkage.linkage.chain import Array

_CHANCE = 3.0
"""Standard deviations from a limit up to which chance may have led across it [1]."""
_MARGIN = 1e-3
"""Of a bond from its limit, over its spacing [1]: orbits are followed to a hundredth of it."""
_ROUNDS = 5
"""Times that lengths are moved [1]: a bond's neighbours may come beyond their limit then."""


def passable(lengths: Lengths, covariance: Array) -> Lengths:
    """Nearest lengths at which no bond stops a wall, given what is known of them (P, P)."""
    for _ in range(_ROUNDS):
        room, slopes = _room(lengths)
        margins = _MARGIN * np.tile(lengths.spacings, 2)
        short = margins - room
        deviations = _deviations(slopes, covariance)
        mended = (short > 0) & (-room < _CHANCE * deviations + margins)
        if not mended.any():
            break
        known = covariance @ slopes[mended].T
        change = known @ np.linalg.lstsq(slopes[mended] @ known, short[mended], rcond=None)[0]
        lengths = lengths.changed(change)
    return lengths


def nearly_stopping(lengths: Lengths, covariance: Array) -> dict[int, float]:
    """Bonds that are within both limits, but by no more than chance, and how likely they are not.

    The probability [1] that a bond whose lengths are normal about these, with the covariance
    (P, P), to first order, is beyond the limit that it is nearer to, by its number.
    """
    room, slopes = _room(lengths)
    over = (room / _deviations(slopes, covariance)).reshape(2, -1).min(axis=0)
    near = np.flatnonzero((over > 0) & (over < _CHANCE))
    return dict(zip(near.tolist(), ndtr(-over[near]).tolist(), strict=True))


def _deviations(slopes: Array, covariance: Array) -> Array:
    """Standard deviations of what has slopes with the unknowns, shape (.,)."""
    return np.asarray(np.sqrt(np.einsum('cp,pq,cq->c', slopes, covariance, slopes)))


def _room(lengths: Lengths) -> tuple[Array, Array]:
    """How far bonds are within both limits, and the slopes of that with the unknowns, (., P).

    l - a - |r_n - r_(n+1)|, then a + l - r_n - r_(n+1) of flippers, its negative of spinners.
    """
    r, a, rest = lengths.rotor_lengths, lengths.spacings, lengths.rest_lengths
    left, right = r[:-1], r[1:]
    longer = np.where(left > right, 1.0, -1.0)
    class_room = a + rest - left - right
    side = 1.0 if np.median(class_room) > 0 else -1.0
    room = np.concatenate([rest - a - longer * (left - right), side * class_room])
    bonds = len(a)
    slopes = np.zeros((2, bonds, OF_A_ROTOR * bonds + 2))
    n = np.arange(bonds)
    places = OF_A_ROTOR * n
    slopes[0, n, places], slopes[1, n, places] = -longer * left, -side * left
    slopes[0, n, places + OF_A_ROTOR] = longer * right
    slopes[1, n, places + OF_A_ROTOR] = -side * right
    slopes[0, n, places + 2], slopes[1, n, places + 2] = -a, side * a
    slopes[0, n, places + 3], slopes[1, n, places + 3] = rest, side * rest
    return room, slopes.reshape(2 * bonds, -1)
