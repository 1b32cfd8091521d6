# SPDX-License-Identifier: Apache-2.0
"""Offset and drift of the clock of a microcontroller, from the arrival times of its messages.

A message is sent at the time x of the sender's clock, and arrives at the time x + y of the
receiver's clock, with

    y = a + b x + d,    d >= 0,

where a is the sum of the clock offset and the smallest delay, b is the drift, and d is the
additional delay of this message. The line a + b x is fitted below the points (x, y): it contains
the edge of their lower convex hull at the mean of x (Moon, Skelly and Towsley, INFOCOM 1999,
doi:10.1109/INFCOM.1999.749287). From each time interval, only the message with the smallest delay
is used.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.microcontroller.frames import CLOCK_RANGE

_MICROSECOND = 1000
"""Duration of a microsecond [ns]."""
_SECOND = 10**9
"""Duration of a second [ns]."""
_INTERVALS = 64
"""Number of intervals in the fit [1]. When this number is reached, pairs of intervals are merged
into intervals of double duration, up to `_LONGEST_INTERVAL`. Sensitivity: at half this number, the
errors of the line double; at twice this number, a fit takes four times as long."""
_FIRST_INTERVAL = 1 / 16
"""Duration of the first intervals [s]; the drift is known after two of them."""
_LONGEST_INTERVAL = 2.0
"""Longest duration of merged intervals [s], so that the line is fitted to the last 128 s.
Sensitivity: at half this duration, the line follows changes of the drift faster."""
LARGEST_DRIFT = 0.01
"""Largest accepted drift of a clock [1]; the resonator of an Arduino Uno has half this drift."""
_FROM_THE_FUTURE = 0.25
"""The time of a measurement is implausible if it is later than its arrival by more than this [s],
both on the receiver's clock. A clock that has restarted usually gives such times: a decrease of
its time is interpreted as an overflow of its counter, so that 71.6 minutes (`CLOCK_RANGE`) are
added. A change of the clock that is proved (see `_CONFIRMATIONS`) counts as a jump if it is
smaller than this [s], otherwise as a restart."""
_FROM_THE_PAST = 10.0
"""Largest plausible delay [s]. Larger delays are implausible; they occur, for example, if the
controller's clock has stopped for some time."""
_SMALLEST_JUMP = 1e-3
"""Smallest jump of a clock that is detected [s]; at twice this value, undetected jumps bias the
drift more."""
_EARLY, _LATE = 3.0, 10.0
"""Let h be the median height of recent delays above the fitted line, and s the lower octile of
these heights. A delay is plausible if it is at most the first number times s below the line, or at
most the second number times h above it [1]. Before there are `_REMEMBERED` delays, h replaces
s."""
_UNUSUAL = 8.0
"""Without checksums, an interval between measurements is unusual if its difference from the
nearest multiple of the median interval is larger than this times the median of such
differences [1]."""
_ABOVE_OTHERS = 2.0
"""With checksums, an interval is unusual if its difference from the nearest multiple of the median
interval is larger than this times the largest such difference of the other intervals [1]."""
_CLOCK_RESOLUTION = 1e-4
"""An interval is unusual only if its difference from the nearest multiple of the median interval
is larger than this [s], which is 25 ticks of micros() of an Arduino."""
_REMEMBERED = 128
"""Number of recent messages whose delays and intervals are compared [1]. Sensitivity: at a
quarter of this number, a rare interval seems unusual; at four times this number, a jump by less
than an interval is corrected later."""
_SHORT = _REMEMBERED // 8
"""Number of compared delays that are shorter than their lower octile [1]. Sensitivity on a busy
computer: at half this number, the limit for early messages (see `_EARLY`) is so close to the line
that some correct messages exceed it; at twice this number, some jumps of 50 ms are missed."""
_WRONG_TIMES = _REMEMBERED // 16
"""Largest expected number of wrong times among the compared messages without a checksum [1]."""
_CONFIRMATIONS = 3
"""Number of successive implausible times that prove a jump or a restart of the clock if they are
consistent with each other."""
_FRESH = 0.75
"""Smallest ratio of two durations for which `_CONFIRMATIONS` implausible times prove a jump or a
restart [1]: the duration from the first to the last arrival, and the duration from the first to
the last measurement. If the ratio is smaller, the messages have waited for a stalled receiver and
arrive together. The ratio does not matter if all these messages are early, because waiting does
not make messages early."""


class DelayEnvelope:
    """Line below the delays of all messages, fitted as a function of the sending time x."""

    def __init__(self) -> None:
        self.drift = 0.0
        """Slope of the line [1]."""
        self.offset = math.inf
        """Delay on the line at x = 0 [s]."""
        self.scatter = math.nan
        """Mean additional delay d of the messages in the fit [s], which are one per interval.

        It is computed from the median, for exponentially distributed d. NaN before there are three
        such messages.
        """
        self._points: list[tuple[float, float]] = []
        self._interval = _FIRST_INTERVAL
        self._end = -math.inf
        self._best = (0.0, math.inf)

    def add(self, x: float, y: float) -> None:
        """Add the next message, with its sending time x [s] and its delay y [s]."""
        if x >= self._end:
            if self._points or math.isfinite(self._best[1]):
                self._fit()
            self._best, self._end = (x, y), x + self._interval
        elif self._above((x, y)) < self._above(self._best):
            self._best = (x, y)
        self.offset = min(self.offset, y - self.drift * x)

    def at(self, x: float) -> float:
        """Return the delay [s] that the fitted line has at the sending time x [s]."""
        return self.offset + self.drift * x

    def _fit(self) -> None:
        self._points.append(self._best)
        oldest = self._points[-1][0] - _INTERVALS * _LONGEST_INTERVAL
        self._points = [point for point in self._points if point[0] >= oldest]
        if len(self._points) >= _INTERVALS and self._interval < _LONGEST_INTERVAL:
            self._interval *= 2
            pairs = zip(self._points[::2], self._points[1::2], strict=True)
            self._points = [min(pair, key=self._above) for pair in pairs]
        if len(self._points) > 1:
            xs, ys = np.array(self._points).T
            self.drift = float(np.clip(_slope_under(xs, ys), -LARGEST_DRIFT, LARGEST_DRIFT))
            above = ys - self.drift * xs
            self.offset = float(above.min())
            if len(xs) > 2:
                self.scatter = float(np.median(np.sort(above - self.offset)[2:])) / math.log(2)

    def _above(self, point: tuple[float, float]) -> float:
        return point[1] - self.drift * point[0]


def _slope_under(xs: Array, ys: Array) -> float:
    middle = xs.mean()
    left, right = xs < middle, xs >= middle
    run = xs[right] - xs[left, None]
    rise = ys[right] - ys[left, None]
    crossing = ys[left, None] + rise / run * (middle - xs[left, None])
    lowest = np.unravel_index(np.argmin(crossing), crossing.shape)
    return float(rise[lowest] / run[lowest])


class DeviceClock:
    """Conversion of times of the controller's clock to increasing stamps of the host's clock.

    Three successive implausible times that are consistent with each other restart the estimate of
    offset and drift. Other implausible times are rejected. The estimate also restarts if all
    recent delays are much longer than the smallest delay since its start. This smallest delay is
    then due to a wrong time or to a jump of the clock.
    """

    def __init__(self) -> None:
        self.restarts = 0
        """Number of restarts of the controller's clock, including jumps by 0.25 s or more."""
        self.jumps = 0
        """Number of jumps of the controller's clock by less than 0.25 s, forwards or backwards."""
        self.delay = 0.0
        """Delay of the last measurement minus the fitted smallest delay [s]."""
        self._last: int | None = None
        self._stamp = -1
        self.reset()

    @property
    def drift(self) -> float:
        """Drift [1]: in 1 s of the controller's clock, the host's clock advances by 1 + drift."""
        return self._envelope.drift

    @property
    def scatter(self) -> float:
        """Uncertainty of the stamps [s], apart from the unknown smallest delay; NaN if unknown."""
        return self._envelope.scatter

    def reset(self) -> None:
        """Discard the estimate, because the controller has restarted or has been replaced."""
        if self._last is not None:
            self.restarts += 1
        self._discard()

    def _discard(self) -> None:
        self._last = None
        self._elapsed, self._begun, self._arrival = 0, 0, 0
        self._envelope = DelayEnvelope()
        self._delays: deque[float] = deque(maxlen=_REMEMBERED)
        self._intervals: deque[float] = deque(maxlen=_REMEMBERED)
        self._suspects: deque[tuple[int, int, bool]] = deque(maxlen=_CONFIRMATIONS)

    def stamp(self, time: int, arrival: int, checked: bool = False) -> int:
        """Return the stamp [ns] of a measurement at `time` [us] that arrives at `arrival` [ns].

        `checked` states that `time` was transmitted without an error. Raises ValueError if `time`
        is implausible or equal to the time of the previous measurement.
        """
        if self._last is not None:
            self._advance(time, arrival, checked)
        if self._last is None:
            self._begun = arrival
        self._last, self._arrival = time, arrival
        x = self._elapsed * _MICROSECOND / _SECOND
        self._envelope.add(x, (arrival - self._begun) / _SECOND - x)
        running = self._elapsed * _MICROSECOND + round(self._envelope.at(x) * _SECOND)
        self._stamp = max(self._begun + running, self._stamp + 1)
        self.delay = (arrival - self._stamp) / _SECOND
        self._delays.append(self.delay)
        return self._stamp

    def stamp_of_arrival(self, arrival: int) -> int:
        """Return the arrival time, increased if necessary so that stamps increase [ns]."""
        self._stamp = max(arrival, self._stamp + 1)
        return self._stamp

    def _advance(self, time: int, arrival: int, checked: bool) -> None:
        assert self._last is not None
        passed = (time - self._last) % CLOCK_RANGE
        if not passed:
            raise ValueError(f'time = {time} us repeats the last frame; measure each frame once')
        # After a restart or a jump, the time may be smaller than before.
        signed = (passed + CLOCK_RANGE // 2) % CLOCK_RANGE - CLOCK_RANGE // 2
        late = self._late(self._elapsed + signed, arrival)
        here = (arrival - self._begun) // _MICROSECOND
        latest = round((here / 1e6 + _FROM_THE_FUTURE - self._envelope.offset) * 1e6)
        latest = round(latest / (1 + self._envelope.drift))
        elapsed = self._elapsed + passed
        elapsed += max((latest - elapsed) // CLOCK_RANGE, 0) * CLOCK_RANGE
        earliest = latest - round(1e6 * (_FROM_THE_FUTURE + _FROM_THE_PAST))
        accepted = earliest <= elapsed <= latest
        if accepted and self._is_near_line(elapsed, arrival):
            self._suspects.clear()
        else:
            late_only = accepted and self._is_only_late(elapsed, arrival, checked)
            # A checksum proves that the time of a late message is right, unless the clock jumped.
            accepted = late_only or (accepted and checked and self._late(elapsed, arrival) > 0)
            if self._suspects or not late_only:
                self._suspects.append((time, arrival, late < 0))
        if self._confirmed() or self._all_late(checked):
            if abs(late) < _FROM_THE_FUTURE:
                self.jumps += 1
                self._discard()
            else:
                self.reset()
        elif accepted:
            self._intervals.append((elapsed - self._elapsed) / 1e6)
            self._elapsed = elapsed
        else:
            raise ValueError(
                f'time = {time} us differs from its arrival by {abs(late):.3g} s; '
                'measure at equal intervals, check the wiring, and end each line of text with a '
                'checksum'
            )

    def _late(self, elapsed: int, arrival: int) -> float:
        x = elapsed * _MICROSECOND / _SECOND
        return (arrival - self._begun) / _SECOND - x - self._envelope.at(x)

    def _is_near_line(self, elapsed: int, arrival: int) -> bool:
        if math.isnan(self.scatter):
            return True
        late, gap = self._late(elapsed, arrival), arrival - self._arrival
        return -self._tolerance(gap, early=True) <= late <= self._tolerance(gap)

    def _is_only_late(self, elapsed: int, arrival: int, checked: bool) -> bool:
        """Return whether a message is late although its measurement was at the usual time.

        The usual times follow the previous measurement by multiples of the median interval.
        `elapsed` is the time of the measurement since the estimate started [us].
        """
        intervals = np.array([(elapsed - self._elapsed) / 1e6, *self._intervals])
        usual = float(np.median(intervals))
        unusual, *others = np.abs(intervals - usual * np.maximum(np.round(intervals / usual), 1))
        limit = _ABOVE_OTHERS * max(others) if checked else _UNUSUAL * float(np.median(others))
        return self._late(elapsed, arrival) > 0 and unusual <= max(limit, _CLOCK_RESOLUTION)

    def _all_late(self, checked: bool) -> bool:
        """Return whether all recent delays are long, except for a few that wrong times cause."""
        if len(self._delays) < _REMEMBERED:
            return False
        least = sorted(self._delays)[0 if checked else _WRONG_TIMES]
        return least > max(_EARLY * (float(np.median(self._delays)) - least), _SMALLEST_JUMP)

    def _tolerance(self, gap: int, early: bool = False) -> float:
        usual = float(np.median(self._delays)) if self._delays else 0.0
        if early and len(self._delays) == _REMEMBERED:
            usual = sorted(self._delays)[_SHORT]
        largest = max((_EARLY if early else _LATE) * usual, _SMALLEST_JUMP)
        return largest + LARGEST_DRIFT * abs(gap) / _SECOND

    def _confirmed(self) -> bool:
        if len(self._suspects) < _CONFIRMATIONS:
            return False
        suspects = np.array(self._suspects, dtype=np.int64)
        times, arrivals, _ = np.diff(suspects, axis=0).T
        passed = times % CLOCK_RANGE / 1e6
        if not suspects[:, 2].all() and arrivals.sum() / _SECOND < _FRESH * passed.sum():
            # The messages have waited and arrive together. Waiting does not make them early.
            return False
        limits = [self._tolerance(int(gap)) for gap in arrivals]
        return bool((passed > 0).all() and (abs(arrivals / _SECOND - passed) <= limits).all())
