# SPDX-License-Identifier: Apache-2.0
"""What films leave out that keep of a picture what has changed since the last, beyond a step.

Between two steps, in its dead zone, a dot may be anywhere on its way: it creeps or swings, and
the film shows it at rest. Across the way nothing of that is to be seen. Dots that go on faster,
beyond the dead zone in each picture, have errors alike along and across:

* Along the way a contrast of seven pictures, their divided difference of sixth order, has what no
  motion of slow and of usual waves has, a polynomial of fifth order: errors from picture to
  picture, of dots that move.
* Errors that last are less in that contrast, by as much as those across of dots that always move.

A dot that was repeated in n pictures, as t usually are before they move on, has the variance

    s^2 + (e^2 - s^2) / (1 + n / t)

between that of dots that stand, s^2, and of those that move, e^2: the longer it stays in its dead
zone, the less it moves.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.errors.fading import MEMORY, FadingSquare, faded

_ORDER = 6
"""Of the contrast [1]: waves of a tenth of the pictures' rate are a thousandth of it, and errors
that last for two pictures still a half."""
_SURELY = 0.4
"""Way from picture to picture that is left out by no film that can be measured [pixels]: several
times the errors of good ones, and less than a block of pixels sees as another one."""


class DeadZone:
    """Learns by how much dots are off along their way."""

    def __init__(self, rotors: int) -> None:
        """Have seen nothing."""
        self._times = np.full(_ORDER + 1, np.nan)
        self._angles = np.full((_ORDER + 1, rotors), np.nan)
        self._lengths = np.full((_ORDER + 1, rotors), np.nan)
        self._along, self._across, self._across_contrast = (FadingSquare() for _ in range(3))
        self._runs = np.zeros(rotors)
        self._log_runs = self._ended = 0.0
        self._since = MEMORY

    @property
    def there(self) -> bool:
        """Whether some dots of late were repeated while others moved."""
        return self._since < MEMORY

    def take(
        self,
        time: float,
        angles: Array,
        lengths: Array,
        turning: Array,
        pixels: Array,
        jumps: float,
    ) -> None:
        """Take angles [rad] and errors of lengths [1], over what pixels say of them, (N,) each.

        With them what pixels say of the angles [rad], how far dots go with them [pixels/rad], and
        the mean square of jumps of repeated dots [1], which is believed until others have moved.
        """
        self._times = np.append(self._times[1:], time)
        self._angles = np.vstack([self._angles[1:], angles])
        self._lengths = np.vstack([self._lengths[1:], lengths])
        if not np.isfinite(self._times).all():
            return
        steps = np.abs(np.diff(self._angles, axis=0)) * pixels
        contrast = _contrast(self._times)
        moving, always = steps.max(axis=0) > _SURELY, steps.min(axis=0) > _SURELY
        self._along.take((contrast @ self._angles / turning)[moving], jumps)
        self._across_contrast.take((contrast @ self._lengths)[always])
        self._across.take(self._lengths[_ORDER // 2, always])

    def take_repeated(self, repeated: NDArray[np.bool_], seen: NDArray[np.bool_]) -> None:
        """Take which dots were repeated in a picture and which were seen, (N,) each."""
        ended = self._runs[(self._runs > 0) & ~repeated & seen]
        self._log_runs = faded(self._log_runs) + float(np.log(ended).sum())
        self._ended = faded(self._ended) + len(ended)
        self._runs = np.where(repeated, self._runs + 1, 0.0)
        self._since = 0 if repeated.any() and (seen & ~repeated).any() else self._since + 1

    def variances(self, standing: float, jumps: float) -> Array:
        """Of errors over what pixels say [1], shape (N,), by that of dots that stand."""
        along = self._along.square(jumps)
        along *= max(1.0, self._across.square() / self._across_contrast.square())
        usual = math.exp(self._log_runs / max(self._ended, 1.0))
        return standing + max(along - standing, 0.0) / (1 + self._runs / usual)


def _contrast(times: Array) -> Array:
    """Weights, of unit length, of what no polynomial of lower order has at times, shape (T,)."""
    apart = times[:, None] - times
    np.fill_diagonal(apart, times[-1] - times[0])
    weights = 1 / np.prod(apart / (times[-1] - times[0]), axis=1)
    return np.asarray(weights / np.linalg.norm(weights))
