# SPDX-License-Identifier: Apache-2.0
"""What is commanded over a time: straight lines between instants, and jumps at them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from soliton_linkage.linkage.chain import Array

RESOLUTION = 1e-9
"""What is nearer than that to its end is over [s]: stamps come in nanoseconds."""


@dataclass(frozen=True)
class Segment:
    """A straight line from an instant [s] to a later one, with its values at both ends."""

    start: float
    end: float
    first: Array
    last: Array

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.end - self.start


@dataclass(frozen=True)
class Profile:
    """Values at instants, linear between them, 0 before the first and held after the last.

    Two points with the same instant are a jump. Raises ValueError unless the instants are
    finite and in order and each has a finite value.
    """

    times: Array
    """Instants [s], shape (points,)."""
    values: Array
    """Value at each instant, shape (points, ...)."""

    def __post_init__(self) -> None:
        """Refuse what is no profile."""
        if self.times.ndim != 1 or not 1 <= len(self.times) == len(self.values):
            raise ValueError(
                f'a profile of {len(self.times)} instants and {len(self.values)} values must '
                'have one or more, as many of one as of the other'
            )
        if not (np.isfinite(self.times).all() and np.isfinite(self.values).all()):
            raise ValueError('a profile must have finite instants and values')
        if np.any(np.diff(self.times) < 0):
            raise ValueError('the instants of a profile must be in order')

    @property
    def end(self) -> float:
        """Last instant [s]."""
        return float(self.times[-1])

    @property
    def lasting(self) -> bool:
        """Whether there is something left to hold after the end."""
        return bool(np.any(self.values[-1]))

    def after(self, time: float) -> Array:
        """Value right after an instant, shape (...)."""
        place = int(np.searchsorted(self.times, time, side='right'))
        if place == 0:
            return np.zeros(self.values.shape[1:])
        return self._between(place - 1, place, time)

    def before(self, time: float) -> Array:
        """Value right before an instant, shape (...)."""
        place = int(np.searchsorted(self.times, time, side='left'))
        if place == 0:
            return np.zeros(self.values.shape[1:])
        return self._between(place - 1, place, time)

    def pieces(self, start: float, end: float) -> Iterator[Segment]:
        """Straight lines that make up the profile from an instant to a later one [s]."""
        inside = np.unique(self.times[(self.times > start) & (self.times < end)])
        for left, right in pairwise([start, *inside.tolist(), end]):
            yield Segment(left, right, self.after(left), self.before(right))

    def integral(self, start: float, end: float) -> Array:
        """Integral from an instant to a later one [value times s], exact, shape (...)."""
        lines = self.pieces(start, end)
        areas = [line.duration * (line.first + line.last) / 2 for line in lines]
        return np.asarray(np.sum(areas, axis=0))

    def mean(self, start: float, end: float) -> Array:
        """Mean from an instant to a later one, exact, shape (...)."""
        lines = list(self.pieces(start, end))
        length = sum(line.duration for line in lines)
        means = [line.duration / length * ((line.first + line.last) / 2) for line in lines]
        return np.asarray(np.sum(means, axis=0))

    def _between(self, left: int, right: int, time: float) -> Array:
        if right == len(self.times):
            return np.asarray(self.values[-1])
        first, last = self.values[left], self.values[right]
        share = (time - self.times[left]) / (self.times[right] - self.times[left])
        return np.asarray(first + share * (last - first))


AT_REST = Profile(np.zeros(1), np.zeros(1))
"""The command to be at rest, 0 for ever."""


def trapezoid(value: float, ramp_up: float, duration: float, ramp_down: float) -> Profile:
    """Profile that rises from 0 to a value, keeps it for a duration and falls to 0 [s].

    A duration of infinity keeps it for ever.

    >>> pulse = trapezoid(2.0, ramp_up=0.1, duration=0.3, ramp_down=0.1)
    >>> round(float(pulse.integral(0.0, 1.0)), 9)
    0.8
    """
    rise = [(0.0, 0.0), (ramp_up, value)]
    end = ramp_up + duration
    fall = [] if math.isinf(duration) else [(end, value), (end + ramp_down, 0.0)]
    points = np.array(rise + fall)
    return Profile(points[:, 0], points[:, 1])
