# SPDX-License-Identifier: Apache-2.0
"""What a recording of a chain holds: readings of its angles, and what pushed it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.screening import filled
from soliton_linkage.linkage.chain import Array

_LARGEST_SPREAD = 100.0
"""Standard deviation of a reading over that of most [1], beyond which it tells nothing more."""


class RecordedPush(NamedTuple):
    """A push by others than springs."""

    time: float
    """When it was commanded [s]."""
    impulses: Array | None = None
    """Angular impulses [N m s], shape (N,), None for a push of which only the time is known."""


@dataclass(frozen=True)
class Readings:
    """Angles of T frames of N rotors."""

    times: Array
    """[s], shape (T,)."""
    angles: Array
    """As they were read [rad], NaN where they are missing, shape (T, N)."""
    deviations: Array | None = None
    """Standard deviation of each reading, where they are told [rad], NaN elsewhere, (T, N)."""
    names: Sequence[str] = ()
    """Of the joints, for complaints."""
    pushes: Sequence[RecordedPush] = ()

    @cached_property
    def whole(self) -> Array:
        """Angles without gaps or turns of 2 pi from frame to frame [rad], shape (T, N).

        Raises ValueError where rotors are missing.
        """
        return filled(self.times, self.angles, self.joints)

    @cached_property
    def seen(self) -> Array:
        """Angles without turns of 2 pi from frame to frame [rad], NaN where missing, (T, N)."""
        return np.where(np.isfinite(self.angles), self.whole, np.nan)

    @cached_property
    def spreads(self) -> Array:
        """Standard deviation of each reading over that of most [1], 1 where it is not told."""
        told = self.deviations
        if told is None or not (usual := _usual(told)) > 0:
            return np.ones_like(self.angles)
        spreads = np.where(told > 0, told, usual) / usual
        return np.clip(spreads, 1 / _LARGEST_SPREAD, _LARGEST_SPREAD)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(self.names) or tuple(f'rotor {n}' for n in range(self.angles.shape[1]))

    def between(self, begin: float, end: float) -> Readings:
        """Those of a span of times [s]."""
        some = (self.times >= begin) & (self.times <= end)
        told = None if self.deviations is None else self.deviations[some]
        return replace(self, times=self.times[some], angles=self.angles[some], deviations=told)

    def every(self, most: int) -> Readings:
        """Every one of them, every second, every third, ..., no more than most."""
        some = slice(None, None, math.ceil(len(self.times) / most))
        told = None if self.deviations is None else self.deviations[some]
        return replace(self, times=self.times[some], angles=self.seen[some], deviations=told)


def _usual(deviations: Array) -> float:
    known = deviations[deviations > 0]
    return float(np.median(known[np.isfinite(known)])) if np.isfinite(known).any() else 0.0
