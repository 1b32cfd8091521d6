# SPDX-License-Identifier: Apache-2.0
"""Readings of a recording: angles with their deviations, impulses and tilts; rounding, thinning.

Errors of readings that are rounded by a step q are uniform, of the variance q^2 / 12, and new in
each frame where angles cross steps, as noise is (B. Widrow, I. Kollar, Quantization Noise,
Cambridge, 2008). Where a rotor rests they are one error, however often it is read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

_FEWEST_ROTORS = 4
"""With fewer the edges' bonds are all there are [1]."""
_SEEN = 0.5
"""Least share of the frames that show a rotor [1]."""
MOST_NAMED = 4
"""Rotors that an error message names [1]."""
_PAUSE = 1.0
"""Between recordings that are joined [s]: no motion goes on across it."""
_LARGEST_SPREAD = 100.0
"""Standard deviation of a reading over that of most [1], beyond which it tells nothing more."""


class RecordedImpulse(NamedTuple):
    """A push by others than springs."""

    time: float
    """When it was commanded [s]."""
    values: Array | None = None
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
    impulses: Sequence[RecordedImpulse] = ()
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
        return [*(push.time for push in self.impulses), *(each.time for each in self.tilts)]

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
    begin, pushes, tilts, times = 0.0, [*first.impulses], [*first.tilts], [first.times]
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
        pushes.append(RecordedImpulse(seam))
        pushes += [push._replace(time=push.time + begin) for push in each.impulses]
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
        impulses=pushes,
        tilts=tilts,
        joined_of=tuple(recordings),
    )


def filled(times: Array, readings: Array, names: Sequence[str]) -> Array:
    """Readings without gaps or turns of 2 pi from frame to frame [rad], (T, N).

    Raises ValueError where rotors are missing.
    """
    if readings.shape[1] < _FEWEST_ROTORS:
        raise ValueError(
            f'{readings.shape[1]} rotors are too few to identify a chain; it takes '
            f'{_FEWEST_ROTORS} or more'
        )
    shares = np.isfinite(readings).mean(axis=0)
    missing = np.flatnonzero(~(shares >= _SEEN))
    if missing.size:
        shown = ', '.join(names[n] for n in missing[:MOST_NAMED])
        more = ', ...' if missing.size > MOST_NAMED else ''
        raise ValueError(
            f'{missing.size} of {len(names)} rotors are missing in half of the frames or more: '
            f'{shown}{more}; the chain cannot be closed across them, record all rotors'
        )
    whole = np.empty_like(readings)
    for rotor, values in enumerate(readings.T):
        seen = np.isfinite(values)
        whole[:, rotor] = np.interp(times, times[seen], np.unwrap(values[seen]))
    return whole


def _usual(deviations: Array) -> float:
    known = deviations[deviations > 0]
    return float(np.median(known[np.isfinite(known)])) if np.isfinite(known).any() else 0.0


_LEAST_STEP = 1e-9
"""Of readings that are rounded [rad]: less is that of numbers."""


def rounding_noise(readings: Array) -> float:
    """Standard deviation of rounding to the least step of readings [rad], (T, N), 0 of none."""
    steps = np.abs(np.diff(readings, axis=0))
    least = float(steps[steps > _LEAST_STEP].min(initial=np.inf))
    return least / math.sqrt(12) if math.isfinite(least) else 0.0


def repeats(readings: Array) -> Array:
    """How many readings in a row are the same as each [1], (T, N); missing ones count for none.

    All of them together say as much as one does: their variance is so many times that of one.
    """
    made = np.ones_like(readings)
    for own, values in zip(made.T, readings.T, strict=True):
        seen = np.flatnonzero(np.isfinite(values))
        changed = np.abs(np.diff(values[seen], prepend=np.inf)) > _LEAST_STEP
        counts = np.diff(np.flatnonzero(changed), append=len(seen))
        own[seen] = np.repeat(counts, counts)
    return made


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


def informative_frames(
    times: Array, angles: Array, pushes: Sequence[float], most: int
) -> NDArray[np.intp]:
    """Return the numbers of the frames that stay, no more than most, shape (K,), in order.

    All frames near pushes stay, which show the rates before and after them, and of the others more
    in a second where a wall passes than where all rotors are at rest. Of angles [rad], NaN where
    missing, (T, N), at times [s], (T,), with pushes at instants [s].
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
