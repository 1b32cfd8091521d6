# SPDX-License-Identifier: Apache-2.0
"""Which frames of a long recording tell most of a chain.

All frames near pushes, which tell rates before and after them; of the others more to a second
where a wall passes than where all rotors are at rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

_NEAR = 100
"""Frames before a push, and after it, all of which stay [1]: as many as a free motion has."""
_OF_PUSHES = 0.5
"""Largest part of the frames that stay for being near pushes [1]: the rest shows the chain."""
_AVERAGED = 8
"""Frames over which angles are averaged to see rotors turn [1], so that noise is a third."""
_TURNING = 0.05
"""Change from one average to the next of a rotor that turns [rad]: noise of 0.03 rad, the largest
that chains were identified with, makes it of 40 rotors once in thirty times."""
_AT_REST = 0.1
"""Frames of rotors at rest that stay over those that turn [1], in a time: what offsets and bonds
they tell, a tenth of them tells nearly as well."""
_FILLINGS = 5
"""Times that what single frames have too much of is given to the others [1]."""


def telling(times: Array, angles: Array, pushes: Sequence[float], most: int) -> NDArray[np.intp]:
    """Numbers of the frames that stay, no more than most, shape (K,), in order.

    Of angles [rad], NaN where missing, (T, N), at times [s], (T,), with pushes at instants [s].
    """
    if len(times) <= most:
        return np.arange(len(times))
    stays = _near(times, pushes, int(_OF_PUSHES * most))
    shares = np.where(_turning(angles), 1.0, _AT_REST) * np.gradient(times)
    shares[stays] = 0.0
    others = most - int(stays.sum())
    for _ in range(_FILLINGS):
        shares = np.minimum(shares, shares.sum() / others)
    ranks = np.floor(np.cumsum(shares) * (others / shares.sum()) * (1 - 1e-9))
    stays[~stays] = np.diff(ranks[~stays], prepend=-1) > 0
    return np.flatnonzero(stays)


def _near(times: Array, pushes: Sequence[float], most: int) -> NDArray[np.bool_]:
    """Frames near the first pushes, no more than most, shape (T,)."""
    near = np.zeros(len(times), dtype=np.bool_)
    for push in pushes:
        arrived = int(np.searchsorted(times, push))
        wider = near.copy()
        wider[max(arrived - _NEAR, 0) : arrived + _NEAR] = True
        if wider.sum() > most:
            break
        near = wider
    return near


def _turning(angles: Array) -> NDArray[np.bool_]:
    """Frames in which a rotor turns, whatever whole turns encoders leave out, shape (T,)."""
    pointers = np.nan_to_num(np.exp(1j * angles))
    sums = np.cumsum(np.vstack([np.zeros(angles.shape[1]), pointers]), axis=0)
    means = (sums[_AVERAGED:] - sums[:-_AVERAGED]) / _AVERAGED
    changes = np.abs(means[_AVERAGED:] - means[:-_AVERAGED]).max(axis=1)
    turning = np.zeros(len(angles), dtype=np.bool_)
    turning[_AVERAGED:][: len(changes)] = changes > _TURNING
    return turning
