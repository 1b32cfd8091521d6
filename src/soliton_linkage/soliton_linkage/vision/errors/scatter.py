# SPDX-License-Identifier: Apache-2.0
"""By how much places of dots scatter more, or less, than their pixels say.

Noise of pixels is not all: compression takes it from pixels that are alike, and puts errors in its
place that many pixels have in common. A mass stays on a circle about its pivot: what its distance
from there changes by is an error of its place, as large as that along the circle. What moves has
larger errors in compressed pictures than what stands. Dots that are repeated stay on their circle,
but jump along it as they are seen anew, by what they were off; and where some are repeated while
others move, the film has a `DeadZone`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.errors.dead_zone import DeadZone
from soliton_linkage.vision.errors.fading import FadingSquare

_MOVING = 0.1
"""Way since the picture before beyond which a dot moves [pixels]: those that stand seem to go a
tenth of that."""


@dataclass(frozen=True)
class Sightings:
    """What a picture shows of the dots of N masses, NaN of hidden ones, shape (N,) each."""

    time: float
    """Of the angles [s]."""
    angles: Array
    """Actual angles [rad]."""
    turning: Array
    """Standard deviations of the angles, as pixels say [rad]."""
    lengths: Array
    """Errors of distances from the pivots, over what pixels say of them [1]."""
    pixels: Array
    """That a dot goes with its angle [pixels/rad]."""
    ways: Array
    """That dots have gone since the picture before [pixels]."""
    repeated: NDArray[np.bool_]
    """Which have the pixels of the picture before."""


class Scatter:
    """Learns it from the pictures so far."""

    def __init__(self, rotors: int) -> None:
        """Believe the pixels."""
        self._standing, self._moving, self._jumps = (FadingSquare() for _ in range(3))
        self._dead_zone = DeadZone(rotors)
        self._runs, self._before = np.zeros(rotors), np.full(rotors, np.nan)

    def look(self, shown: Sightings) -> Array:
        """True standard deviations of what a picture shows over what pixels say, shape (N,)."""
        moving = shown.ways > _MOVING
        self._standing.take(shown.lengths[~shown.repeated & ~moving])
        self._moving.take(shown.lengths[~shown.repeated & moving])
        self._take_jumps(shown)
        jumps = self._jumps.square()
        self._dead_zone.take_repeated(shown.repeated, np.isfinite(shown.angles))
        self._dead_zone.take(
            shown.time, shown.angles, shown.lengths, shown.turning, shown.pixels, jumps
        )
        standing = self._standing.square()
        if self._dead_zone.there:
            return np.sqrt(self._dead_zone.variances(standing, jumps))
        of_new = np.where(moving, self._moving.square(), standing)
        return np.sqrt(np.where(shown.repeated, jumps, of_new))

    def _take_jumps(self, shown: Sightings) -> None:
        """Take by what dots that were repeated jump as they are seen anew."""
        jumps = (shown.angles - self._before) / shown.turning
        ended = (self._runs > 0) & ~shown.repeated & np.isfinite(jumps)
        self._jumps.take_for(jumps[ended], self._runs[ended])
        self._runs = np.where(shown.repeated, self._runs + 1, 0.0)
        self._before = shown.angles
