# SPDX-License-Identifier: Apache-2.0
"""The straight line under the delays of messages, of which none can be too early.

A message that was sent at the instant x, by the clock of who sends, comes with the delay

    y = a + b x + d,    d >= 0,

by the clock of who hears: a is the difference of the clocks with the least delay, b their drift
and d what a message waited on its way. Of all lines below the points the one whose mean distance
is the least goes through the edge of their lower convex hull over the mean of x (S. Moon,
P. Skelly and D. Towsley, INFOCOM 1999, doi:10.1109/INFCOM.1999.749287). Here the points are the
earliest messages of equal stretches of time.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.linkage.chain import Array

_STRETCHES = 64
"""Of time whose earliest messages are kept [1]: half of it knows the line half as well, twice
takes four times as long to fit."""
_FIRST_STRETCH = 1 / 16
"""Duration of the first stretches [s]: the drift begins to be known after two of them."""
_LONGEST_STRETCH = 2.0
"""Duration of the stretches in the end [s]: all of them are two minutes. Half of it follows a
clock that warms up more closely, twice knows a steady one better."""
LARGEST_DRIFT = 0.01
"""Of a clock [1]: twice that of the ceramic resonator on an Arduino Uno."""


class DelayEnvelope:
    """Follows the line under the delays, with what is known of it at any moment."""

    def __init__(self) -> None:
        self.drift = 0.0
        """Slope of the line [1]."""
        self.offset = math.inf
        """Delay of the line at 0 [s]."""
        self._points: list[tuple[float, float]] = []
        self._stretch = _FIRST_STRETCH
        self._end = -math.inf
        self._best = (0.0, math.inf)
        self._scatter = math.nan

    def add(self, x: float, y: float) -> None:
        """Take a message that was sent at x [s], later than the one before, with a delay y [s]."""
        if x >= self._end:
            if self._points or math.isfinite(self._best[1]):
                self._close()
            self._best, self._end = (x, y), x + self._stretch
        elif y - self.drift * x < self._best[1] - self.drift * self._best[0]:
            self._best = (x, y)
        self.offset = min(self.offset, y - self.drift * x)

    def at(self, x: float) -> float:
        """Delay of the line [s]."""
        return self.offset + self.drift * x

    @property
    def scatter(self) -> float:
        """How far the earliest messages are above the line on the mean [s], NaN if not known.

        Told by their median, which is ln 2 of the mean of exponential times, as a machine that
        stalls now and then has a few that are far above.
        The line is nearer than that to the one of the least delay: by the number of stretches
        where delays are exponential, less where few messages are nearly as quick as the quickest.
        """
        return self._scatter

    def _close(self) -> None:
        """End a stretch, and draw the line anew."""
        self._points.append(self._best)
        oldest = self._points[-1][0] - _STRETCHES * _LONGEST_STRETCH
        self._points = [point for point in self._points if point[0] >= oldest]
        if len(self._points) >= _STRETCHES and self._stretch < _LONGEST_STRETCH:
            self._stretch *= 2
            pairs = zip(self._points[::2], self._points[1::2], strict=True)
            self._points = [min(pair, key=self._above) for pair in pairs]
        if len(self._points) > 1:
            xs, ys = np.array(self._points).T
            self.drift = float(np.clip(_slope_under(xs, ys), -LARGEST_DRIFT, LARGEST_DRIFT))
            above = ys - self.drift * xs
            self.offset = float(above.min())
            if len(xs) > 2:
                others = np.sort(above - self.offset)[2:]
                self._scatter = float(np.median(others)) / math.log(2)

    def _above(self, point: tuple[float, float]) -> float:
        return point[1] - self.drift * point[0]


def _slope_under(xs: Array, ys: Array) -> float:
    """Slope of the edge of the lower convex hull that is over the mean of x."""
    middle = xs.mean()
    left, right = xs < middle, xs >= middle
    run = xs[right] - xs[left, None]
    rise = ys[right] - ys[left, None]
    crossing = ys[left, None] + rise / run * (middle - xs[left, None])
    lowest = np.unravel_index(np.argmin(crossing), crossing.shape)
    return float(rise[lowest] / run[lowest])
