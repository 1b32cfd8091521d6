# SPDX-License-Identifier: Apache-2.0
"""Readings of a recording: angles with standard deviations, impulses and tilts.

While a rotor turns, the rounding errors of its readings are independent and have the variance q^2
/ 12 for an encoder with the step q (Widrow and Kollar, Quantization Noise, 2008). While a rotor is
at rest, all its readings have the same rounding error.
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

from soliton_linkage.identification.mounting import listed
from soliton_linkage.linkage.chain import Array, wrapped
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

_FEWEST_ROTORS = 4
"""Smallest number of rotors, because bonds at the edges contain little information."""
_LEAST_PRESENT = 0.5
"""Each rotor must have a reading in at least this fraction of the frames [1]."""
_PAUSE = 1.0
"""Time that `join_recordings` leaves between two recordings [s]."""
_SHORTEST = 30
"""`divided` omits parts with fewer frames than this [1]."""
_RESET_STEP = 0.1
"""A rotor counts as stepping if its angle changes by more than this between two frames [rad]. A
reset of a simulation makes many rotors step at once. Sensitivity: 1.7 % of 1440 resets are missed;
with half this value, 1.5 % are missed, and with twice this value, 2.5 %."""
_RESET_ROTORS = 2
"""A reset is assumed only if at least this many rotors step [1]; a single encoder may slip."""
_RESET_RATIO = 4.0
"""A reset is assumed only if the norm of the changes of all angles between two frames is larger
than this times the norms one frame earlier and one frame later [1]. For moving walls at 10 to 500
frames per second, this ratio was at most 2.3. Sensitivity: 1.7 % of 1440 resets are missed; with
half this value, 1.0 % are missed, and with twice this value, 3.4 %."""
_LARGEST_RELATIVE_DEVIATION = 100.0
"""Standard deviations, divided by the typical one, are limited to values from 1 / this to
this [1]."""


class RecordedImpulse(NamedTuple):
    """Angular impulses that act on the rotors at one time."""

    time: float
    values: Array | None = None
    """Angular impulse on each rotor [N m s], (N,); None if unknown."""


class RecordedTilt(NamedTuple):
    """Change of the tilt of the chain."""

    time: float
    tilt: float
    """Tilt after the change, positive if the last rotor is lower [rad]."""


@dataclass(frozen=True)
class Readings:
    """Readings in T frames of N rotors at times [s], (T,)."""

    times: Array
    angles: Array
    """Recorded readings [rad], NaN if missing, (T, N)."""
    deviations: Array | None = None
    """Standard deviation of each reading [rad], NaN if unknown, (T, N)."""
    names: Sequence[str] = ()
    impulses: Sequence[RecordedImpulse] = ()
    gravity: Gravity = NO_GRAVITY
    tilts: Sequence[RecordedTilt] = ()
    parts: tuple[Readings, ...] = ()

    @cached_property
    def filled(self) -> Array:
        """Unwrapped readings [rad] with interpolated gaps, (T, N).

        Raises ValueError if there are too few rotors, or too few readings of a rotor.
        """
        names, rotors = self.joints, self.angles.shape[1]
        if rotors < _FEWEST_ROTORS:
            raise ValueError(
                f'{rotors} rotors are too few to identify a chain; record {_FEWEST_ROTORS} or more'
            )
        present = np.isfinite(self.angles)
        missing = np.flatnonzero(~(present.mean(axis=0) >= _LEAST_PRESENT))
        if missing.size:
            named = listed([names[n] for n in missing])
            raise ValueError(
                f'{missing.size} of {rotors} rotors are missing in half of the frames or more: '
                f'{named}; record all rotors, because bonds without them cannot close'
            )
        return interpolated(self.angles, self.times)

    @cached_property
    def unwrapped(self) -> Array:
        """Unwrapped readings [rad], NaN where missing, (T, N)."""
        return np.where(np.isfinite(self.angles), self.filled, np.nan)

    @cached_property
    def relative_deviations(self) -> Array:
        """Standard deviations divided by their median [1], (T, N); 1 if unknown."""
        deviations = self.deviations
        if deviations is None:
            return np.ones_like(self.angles)
        known = deviations[np.isfinite(deviations) & (deviations > 0)]
        if not known.size:
            return np.ones_like(self.angles)
        usual = float(np.median(known))
        relative = np.where(deviations > 0, deviations, usual) / usual
        return np.clip(relative, 1 / _LARGEST_RELATIVE_DEVIATION, _LARGEST_RELATIVE_DEVIATION)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, by default `rotor 0`, `rotor 1`, ..."""
        return tuple(self.names) or tuple(f'rotor {n}' for n in range(self.angles.shape[1]))

    @property
    def recordings(self) -> tuple[Readings, ...]:
        """The recordings that were joined, or this recording alone."""
        return self.parts or (self,)

    @property
    def interruptions(self) -> list[float]:
        """Times of impulses and of changes of the tilt [s]; a free motion ends at each of them."""
        return [*(each.time for each in self.impulses), *(each.time for each in self.tilts)]

    def tilt_at(self, time: float) -> float:
        """Return the tilt of the chain at a time [rad]."""
        before = [each.tilt for each in self.tilts if each.time <= time]
        return before[-1] if before else self.gravity.tilt

    def select(self, frames: NDArray[Any]) -> Readings:
        """Return the readings in some frames, given by their numbers or a mask."""
        deviations = None if self.deviations is None else self.deviations[frames]
        return replace(
            self, times=self.times[frames], angles=self.angles[frames], deviations=deviations
        )


def interpolated(angles: Array, times: Array | None = None) -> Array:
    """Unwrap readings, (T, N), and fill their gaps; a rotor without readings stays NaN."""
    times = np.arange(len(angles), dtype=np.float64) if times is None else times
    filled = np.full_like(angles, np.nan)
    present = np.isfinite(angles)
    for n in np.flatnonzero(present.any(axis=0)):
        seen = present[:, n]
        filled[:, n] = np.interp(times, times[seen], np.unwrap(angles[seen, n]))
    return filled


def join_recordings(recordings: Sequence[Readings]) -> Readings:
    """Join recordings, with an unknown impulse between them; raise ValueError if joints differ.

    The times of a recording are shifted unless it begins after the end of the previous one.
    """
    first, *others = recordings = [part for each in recordings for part in each.recordings]
    if not others:
        return first
    begin, impulses, tilts, times = 0.0, [*first.impulses], [*first.tilts], [first.times]
    for each in others:
        if each.joints != first.joints:
            raise ValueError(
                f'a recording of {len(each.joints)} joints, {each.joints[0]!r} to '
                f'{each.joints[-1]!r}, is not of the chain of {len(first.joints)} joints, '
                f'{first.joints[0]!r} to {first.joints[-1]!r}; record the same joints'
            )
        seam = begin + float(each.times[0])
        if seam <= times[-1][-1]:
            seam = float(times[-1][-1]) + _PAUSE / 2
            begin = seam + _PAUSE / 2 - float(each.times[0])
        times.append(each.times + begin)
        impulses.append(RecordedImpulse(seam))
        impulses += [impulse._replace(time=impulse.time + begin) for impulse in each.impulses]
        tilts.append(RecordedTilt(seam, each.gravity.tilt))
        tilts += [tilt._replace(time=tilt.time + begin) for tilt in each.tilts]
    deviations = [
        np.full_like(each.angles, np.nan) if each.deviations is None else each.deviations
        for each in recordings
    ]
    return replace(
        first,
        times=np.concatenate(times),
        angles=np.concatenate([each.angles for each in recordings]),
        deviations=None
        if all(each.deviations is None for each in recordings)
        else np.concatenate(deviations),
        impulses=impulses,
        tilts=tilts,
        parts=tuple(recordings),
    )


def is_reset(times: Sequence[float], angles: Sequence[Array]) -> bool:
    """Return whether a reset occurs between the second and the third of four frames."""
    changes = [np.nan_to_num(wrapped(step)) for step in np.diff(angles, axis=0)]
    before, here, after = (float(np.linalg.norm(each)) for each in changes)
    first, gap, last = np.diff(times)
    usual = max(before, after) * max(1.0, gap / min(first, last))
    stepping = np.count_nonzero(np.abs(changes[1]) > _RESET_STEP)
    return bool(stepping >= _RESET_ROTORS and here > _RESET_RATIO * usual)


def divided(recording: Readings, resets: Sequence[float]) -> Readings:
    """Divide a recording at the times of resets [s], omit short parts, and join the others."""
    begins = [-math.inf, *sorted(resets)]
    parts = [
        _part(recording, begin, end)
        for begin, end in pairwise([*begins, math.inf])
        if np.count_nonzero((recording.times >= begin) & (recording.times < end)) >= _SHORTEST
    ]
    return join_recordings(parts or [recording])


def _part(recording: Readings, begin: float, end: float) -> Readings:
    tilt = recording.tilt_at(begin)
    return replace(
        recording.select((recording.times >= begin) & (recording.times < end)),
        impulses=[each for each in recording.impulses if begin <= each.time < end],
        gravity=replace(recording.gravity, tilt=tilt),
        tilts=[each for each in recording.tilts if begin < each.time < end],
    )


_AVERAGED_INTERVALS = 8
"""Number of successive frame intervals that are averaged [1], because stamps may have errors."""
_DENSE_FRAMES = 0.05
"""Quantile of the averaged frame intervals [1] that is used as the interval without gaps."""


def dense_interval(times: Array) -> float:
    """Return the frame interval in the parts of a recording without gaps [s].

    `times` [s] contains at least two elements.
    """
    count = min(_AVERAGED_INTERVALS, len(times) - 1)
    return float(np.quantile((times[count:] - times[:-count]) / count, _DENSE_FRAMES))


_SMALLEST_STEP = 1e-9
"""Smallest change that counts as an encoder step [rad]; smaller ones are floating-point errors."""


def rounding_noise(readings: Array) -> float:
    """Return the standard deviation of rounding errors [rad] from the smallest encoder step."""
    steps = np.abs(np.diff(readings, axis=0))
    smallest = float(steps[steps > _SMALLEST_STEP].min(initial=np.inf))
    return smallest / math.sqrt(12) if math.isfinite(smallest) else 0.0


def repeat_counts(readings: Array) -> Array:
    """Return, for each reading, the length of the run of equal readings that contains it.

    All readings of a run have the same rounding error, so that together they count as one reading.
    """
    counts = np.ones_like(readings)
    for column, values in zip(counts.T, readings.T, strict=True):
        seen = np.flatnonzero(np.isfinite(values))
        changed = np.abs(np.diff(values[seen], prepend=np.inf)) > _SMALLEST_STEP
        runs = np.diff(np.flatnonzero(changed), append=len(seen))
        column[seen] = np.repeat(runs, runs)
    return counts


_NEAR = 100
"""Number of frames before each impulse, and also after it, that `informative_frames` selects."""
_NEAR_IMPULSES = 0.5
"""Largest fraction of the selected frames that may be near impulses [1]."""
_AVERAGED = 8
"""Number of frames over which exp(i phi) of a rotor is averaged, to find when the rotor turns."""
_TURNING = 0.05
"""A rotor counts as turning if the mean of exp(i phi) over `_AVERAGED` frames differs from the
mean over the previous `_AVERAGED` frames by more than this [1]."""
_AT_REST = 0.1
"""Largest ratio of the number of frames selected while all rotors rest to the number selected
while a rotor turns [1]. The limit holds for the total numbers and for the numbers per second."""
_FILLINGS = 5
"""Number of times that `informative_frames` limits the weights of the frames [1]. The limit is the
sum of the weights divided by the number of frames to select, so that no frame is selected twice.
Each limitation decreases the sum; therefore it is repeated."""


def informative_frames(
    times: Array, angles: Array, impulses: Sequence[float], most: int
) -> NDArray[np.intp]:
    """Return up to `most` frame numbers, mainly near `impulses` [s] and while rotors turn.

    Frames that are not near an impulse are selected in proportion to a weight: the frame interval,
    which is reduced while all rotors rest (see `_AT_REST`).
    """
    if len(times) <= most:
        return np.arange(len(times))
    kept = _near_impulses(times, impulses, int(_NEAR_IMPULSES * most))
    turning, density = _turning(angles), np.gradient(times)
    moving, resting = density[turning].sum(), density[~turning].sum()
    density[~turning] *= _AT_REST * min(moving / resting, 1.0) if moving and resting else 1.0
    density[kept] = 0.0
    others = most - int(kept.sum())
    for _ in range(_FILLINGS):
        density = np.minimum(density, density.sum() / others)
    ranks = np.floor(np.cumsum(density) * (others / density.sum()) * (1 - 1e-9))
    kept[~kept] = np.diff(ranks[~kept], prepend=-1) > 0
    return np.flatnonzero(kept)


def _near_impulses(times: Array, impulses: Sequence[float], most: int) -> NDArray[np.bool_]:
    near = np.zeros(len(times), dtype=np.bool_)
    for impulse in impulses:
        frame = int(np.searchsorted(times, impulse))
        wider = near.copy()
        wider[max(frame - _NEAR, 0) : frame + _NEAR] = True
        if wider.sum() > most:
            break
        near = wider
    return near


def _turning(angles: Array) -> NDArray[np.bool_]:
    pointers = np.nan_to_num(np.exp(1j * angles))
    sums = np.cumsum(np.vstack([np.zeros(angles.shape[1]), pointers]), axis=0)
    means = (sums[_AVERAGED:] - sums[:-_AVERAGED]) / _AVERAGED
    changes = np.abs(means[_AVERAGED:] - means[:-_AVERAGED]).max(axis=1)
    turning = np.zeros(len(angles), dtype=np.bool_)
    turning[_AVERAGED:][: len(changes)] = changes > _TURNING
    return turning
