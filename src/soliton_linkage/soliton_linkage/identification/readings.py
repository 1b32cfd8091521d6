# SPDX-License-Identifier: Apache-2.0
"""What a recording of a chain holds: readings of its angles, and what pushed it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.identification.screening import filled
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

_PAUSE = 1.0
"""Between recordings that are joined [s]: no motion goes on across it."""
_LARGEST_SPREAD = 100.0
"""Standard deviation of a reading over that of most [1], beyond which it tells nothing more."""


class RecordedPush(NamedTuple):
    """A push by others than springs."""

    time: float
    """When it was commanded [s]."""
    impulses: Array | None = None
    """Angular impulses [N m s], shape (N,), None for a push of which only the time is known."""


class RecordedTilt(NamedTuple):
    """A tilt of the chain from an instant on."""

    time: float
    """[s]."""
    tilt: float
    """Above 0 where the last rotor is the lower end [rad]."""


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
    gravity: Gravity = NO_GRAVITY
    """As it is at first."""
    tilts: Sequence[RecordedTilt] = ()
    """Of which each follows the one before."""
    joined_of: tuple[Readings, ...] = ()
    """Recordings that these were made of, if of several."""

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

    @property
    def recordings(self) -> tuple[Readings, ...]:
        """These, or those of which they were made."""
        return self.joined_of or (self,)

    @property
    def breaks(self) -> list[float]:
        """Times at which free motion ends, by a push or another tilt [s]."""
        return [*(push.time for push in self.pushes), *(each.time for each in self.tilts)]

    def tilt_at(self, time: float) -> float:
        """Tilt of the chain at an instant [rad]."""
        before = [each.tilt for each in self.tilts if each.time <= time]
        return before[-1] if before else self.gravity.tilt

    def of_frames(self, some: NDArray[Any]) -> Readings:
        """Those of some frames, by their numbers or as a mask."""
        told = None if self.deviations is None else self.deviations[some]
        return replace(self, times=self.times[some], angles=self.angles[some], deviations=told)


def joined(recordings: Sequence[Readings]) -> Readings:
    """Recordings of one chain in a row, with the same encoders, a pause between each two.

    Raises ValueError where they are not of the same joints.
    """
    first, *others = recordings
    if not others:
        return first
    begin, pushes, tilts, times = 0.0, [*first.pushes], [*first.tilts], [first.times]
    for before, each in pairwise(recordings):
        if each.joints != first.joints:
            raise ValueError(
                f'a recording of {len(each.joints)} joints, {each.joints[0]!r} to '
                f'{each.joints[-1]!r}, is not of the chain of {len(first.joints)} joints, '
                f'{first.joints[0]!r} to {first.joints[-1]!r}; record the same joints'
            )
        seam = begin + float(before.times[-1]) + _PAUSE / 2
        begin = seam + _PAUSE / 2 - float(each.times[0])
        times.append(each.times + begin)
        pushes.append(RecordedPush(seam))
        pushes += [push._replace(time=push.time + begin) for push in each.pushes]
        tilts.append(RecordedTilt(seam, each.gravity.tilt))
        tilts += [RecordedTilt(tilt.time + begin, tilt.tilt) for tilt in each.tilts]
    told = [each.deviations for each in recordings]
    unknown = [np.full_like(each.angles, np.nan) for each in recordings]
    return replace(
        first,
        times=np.concatenate(times),
        angles=np.concatenate([each.angles for each in recordings]),
        deviations=None
        if all(each is None for each in told)
        else np.concatenate([b if a is None else a for a, b in zip(told, unknown, strict=True)]),
        pushes=pushes,
        tilts=tilts,
        joined_of=tuple(recordings),
    )


def _usual(deviations: Array) -> float:
    known = deviations[deviations > 0]
    return float(np.median(known[np.isfinite(known)])) if np.isfinite(known).any() else 0.0
