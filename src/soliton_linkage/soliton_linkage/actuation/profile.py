# SPDX-License-Identifier: Apache-2.0
"""Piecewise linear profiles of commanded values, with jumps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from soliton_linkage.linkage.chain import Array

RESOLUTION = 1e-9
"""Resolution of the stamps [s]; a profile has ended if less than this time remains."""


class Segment(NamedTuple):
    """Linear segment of a profile from `start` to `end` [s], with the values at both instants."""

    start: float
    end: float
    first: Array
    last: Array

    @property
    def duration(self) -> float:
        """Duration of the segment [s]."""
        return self.end - self.start


@dataclass(frozen=True)
class Profile:
    """Piecewise linear function of time.

    The value is 0 before the first point and constant after the last point. Two points at one
    instant define a jump. Raises ValueError for decreasing instants and for invalid arrays.
    """

    times: Array
    """Instants [s], shape (points,)."""
    values: Array
    """Value at each instant, shape (points, ...)."""

    def __post_init__(self) -> None:
        if self.times.ndim != 1 or not 1 <= len(self.times) == len(self.values):
            raise ValueError(
                f'a profile of {len(self.times)} instants and {len(self.values)} values must '
                'have the same number of both, 1 or more'
            )
        if not (np.isfinite(self.times).all() and np.isfinite(self.values).all()):
            raise ValueError('the instants and values of a profile must be finite numbers')
        if np.any(np.diff(self.times) < 0):
            raise ValueError('the instants of a profile must not decrease; sort the points')

    @property
    def end(self) -> float:
        """Last instant [s]."""
        return float(self.times[-1])

    @property
    def held(self) -> bool:
        """Whether the constant value after the last point differs from 0."""
        return bool(np.any(self.values[-1]))

    def after(self, time: float) -> Array:
        """Return the right-hand limit of the value at an instant [s], shape (...)."""
        return self._between(int(np.searchsorted(self.times, time, side='right')), time)

    def before(self, time: float) -> Array:
        """Return the left-hand limit of the value at an instant [s], shape (...)."""
        return self._between(int(np.searchsorted(self.times, time, side='left')), time)

    def segments(self, start: float, end: float) -> Iterator[Segment]:
        """Yield the linear segments of the profile between two instants [s]."""
        first = np.searchsorted(self.times, start, side='right')
        inside = np.unique(self.times[first : np.searchsorted(self.times, end)])
        for left, right in pairwise([start, *inside.tolist(), end]):
            yield Segment(left, right, self.after(left), self.before(right))

    def integral(self, start: float, end: float) -> Array:
        """Return the exact integral of the value between two instants [s], shape (...)."""
        lines = self.segments(start, end)
        areas = [line.duration * (line.first + line.last) / 2 for line in lines]
        return np.asarray(np.sum(areas, axis=0))

    def mean(self, start: float, end: float) -> Array:
        """Return the exact mean of the value between two instants [s], shape (...)."""
        lines = list(self.segments(start, end))
        length = sum(line.duration for line in lines)
        means = [line.duration / length * ((line.first + line.last) / 2) for line in lines]
        return np.asarray(np.sum(means, axis=0))

    def _between(self, following: int, time: float) -> Array:
        if following == 0:
            return np.zeros(self.values.shape[1:])
        if following == len(self.times):
            return np.asarray(self.values[-1])
        begin, end = self.times[following - 1 : following + 1]
        first, last = self.values[following - 1 : following + 1]
        return np.asarray(first + (time - begin) / (end - begin) * (last - first))


AT_REST = Profile(np.zeros(1), np.zeros(1))
"""Profile that is always 0."""


def trapezoid(value: float, ramp_up: float, duration: float, ramp_down: float) -> Profile:
    """Return a profile that rises from 0 to a value, keeps this value, and falls back to 0.

    The arguments after `value` are the durations of these phases [s]; `duration` may be infinite.

    >>> pulse = trapezoid(2.0, ramp_up=0.1, duration=0.3, ramp_down=0.1)
    >>> round(float(pulse.integral(0.0, 1.0)), 9)
    0.8
    """
    rise = [(0.0, 0.0), (ramp_up, value)]
    end = ramp_up + duration
    fall = [] if math.isinf(duration) else [(end, value), (end + ramp_down, 0.0)]
    points = np.array(rise + fall)
    return Profile(points[:, 0], points[:, 1])
