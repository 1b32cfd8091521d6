# SPDX-License-Identifier: Apache-2.0
"""Recorded angles and rates of a chain, from a simulation, a bag or a live stream."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array


@dataclass(frozen=True)
class Recording:
    """T frames of N rotors.

    Raises ValueError for wrong shapes, and for times that do not increase.
    """

    times: Array
    """Times of the frames [s], increasing, shape (T,)."""
    angles: Array
    """Angles phi [rad], shape (T, N)."""
    rates: Array
    """Angular velocities [rad/s], shape (T, N), or (0, N) if they are unknown."""

    def __post_init__(self) -> None:
        frames = len(self.times)
        if self.angles.ndim != 2 or len(self.angles) != frames:
            raise ValueError(
                f'angles of shape {self.angles.shape} do not fit {frames} times; '
                'give one row per frame'
            )
        if self.rates.shape not in (self.angles.shape, (0, self.angles.shape[1])):
            raise ValueError(
                f'rates of shape {self.rates.shape} do not fit angles of shape '
                f'{self.angles.shape}; give the same shape, or none'
            )
        if not np.isfinite(self.times).all():
            frame = int(np.flatnonzero(~np.isfinite(self.times))[0])
            raise ValueError(
                f'time of frame {frame} = {self.times[frame]} s must be a finite number'
            )
        late = np.flatnonzero(np.diff(self.times) <= 0)
        if late.size:
            frame = int(late[0]) + 1
            raise ValueError(
                f'time of frame {frame} = {self.times[frame]} s is not later than '
                f'{self.times[frame - 1]} s; sort the frames and drop repeated ones'
            )
