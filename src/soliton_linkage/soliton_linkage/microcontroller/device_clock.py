# SPDX-License-Identifier: Apache-2.0
"""Offset and drift of the clock of a microcontroller, from the arrival times of its messages.

A message is sent when the clock of the sender shows x. When it arrives, the clock of the receiver
shows x + y with

    y = a + b x + d,    d >= 0.

Here a is the offset between the clocks plus the smallest delay, b the drift, and d the waiting
time. The estimate of a + b x is the line below all points (x, y) with the least mean distance from
these points. It contains the edge of the lower convex hull at the mean of x (S. Moon, P. Skelly
and D. Towsley, INFOCOM 1999, doi:10.1109/INFCOM.1999.749287). The points are the messages with the
smallest delay in successive intervals.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.microcontroller.frames import CLOCK_RANGE

_MICROSECOND = 1000
"""In nanoseconds."""
_SECOND = 10**9
"""In nanoseconds."""
_INTERVALS = 64
"""Number of intervals in the fit [1]. Sensitivity: at 0.5x, the error of the line is twice as
large; at 2x, a fit takes four times as long."""
_FIRST_INTERVAL = 1 / 16
"""Duration of the first intervals [s]; after two intervals the drift is known."""
_LONGEST_INTERVAL = 2.0
"""Duration of the later intervals [s]; together they cover two minutes. Sensitivity: at 0.5x, the
line follows the drift of a warming clock faster; at 2x, a steady clock is known more precisely."""
LARGEST_DRIFT = 0.01
"""Largest drift of a clock [1]: twice the drift of the ceramic resonator of an Arduino Uno."""
_FROM_THE_FUTURE = 0.25
"""Largest apparent time of a measurement in the future [s], the effect of a drift of 1 % in 25 s
without a frame. A larger value means that the clock has restarted."""
_FROM_THE_PAST = 10.0
"""Largest delay [s]; the system's buffer holds four seconds of a line at 9600 baud. A larger delay
means that the clock has stopped or does not count microseconds."""
_SMALLEST_JUMP = 1e-3
"""Smallest jump of a clock that is detected [s]. Sensitivity: at 0.5x, an unusually early message
may look like a jump; at 2x, smaller jumps bias the drift."""
_EARLY, _LATE = 3.0, 10.0
"""Smallest implausible deviations below and above the line, in medians of the delay [1]. One delay
in a thousand exceeds ten medians of an exponential distribution; three successive delays never
do."""
_UNUSUAL = 8.0
"""Deviation of an unusual sampling interval, in median deviations [1]."""
_CLOCK_RESOLUTION = 1e-4
"""Smallest deviation of an unusual sampling interval [s]: 25 ticks of an Arduino's micros()."""
_CONFIRMATIONS = 3
"""Number of consistent implausible times that prove a jump or a restart [1]."""


class DelayEnvelope:
    """Line below the delays of all messages."""

    def __init__(self) -> None:
        self.drift = 0.0
        """Slope of the line [1]."""
        self.offset = math.inf
        """Delay of the line at 0 [s]."""
        self.scatter = math.nan
        """Mean height of the earliest messages above the line [s], NaN if unknown.

        It is computed as median / ln 2, the mean of an exponential distribution, because an
        overloaded computer causes a few very large delays. For exponential delays, the error of
        the line is this value divided by the number of intervals.
        """
        self._points: list[tuple[float, float]] = []
        self._interval = _FIRST_INTERVAL
        self._end = -math.inf
        self._best = (0.0, math.inf)

    def add(self, x: float, y: float) -> None:
        """Add the next message, with sending time x and delay y [s]."""
        if x >= self._end:
            if self._points or math.isfinite(self._best[1]):
                self._fit()
            self._best, self._end = (x, y), x + self._interval
        elif self._above((x, y)) < self._above(self._best):
            self._best = (x, y)
        self.offset = min(self.offset, y - self.drift * x)

    def at(self, x: float) -> float:
        """Return the delay of the line [s]."""
        return self.offset + self.drift * x

    def _fit(self) -> None:
        """Close an interval and fit the line again."""
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
    """Return the slope of the edge of the lower convex hull above the mean of x."""
    middle = xs.mean()
    left, right = xs < middle, xs >= middle
    run = xs[right] - xs[left, None]
    rise = ys[right] - ys[left, None]
    crossing = ys[left, None] + rise / run * (middle - xs[left, None])
    lowest = np.unravel_index(np.argmin(crossing), crossing.shape)
    return float(rise[lowest] / run[lowest])


class DeviceClock:
    """Conversion of times of the controller's clock to time stamps of the host's clock.

    Offset and drift are estimated from the arrival times, because no message arrives before it was
    sent. The offset includes the smallest delay, which the receiver cannot measure. Stamps
    increase from measurement to measurement.

    A measurement with an implausible time is rejected. Three successive implausible times that are
    consistent with each other show that the clock has jumped or restarted; then the estimate
    restarts.
    """

    def __init__(self) -> None:
        self.restarts = 0
        """Number of restarts of the controller's clock."""
        self.jumps = 0
        """Number of jumps of the controller's clock, each by less than 0.25 s."""
        self.delay = 0.0
        """Delay of the last measurement minus the smallest delay [s]."""
        self._last: int | None = None
        self._stamp = -1
        self.reset()

    @property
    def drift(self) -> float:
        """Drift of the clock of the controller [1]: its second takes 1 + drift host seconds."""
        return self._envelope.drift

    @property
    def scatter(self) -> float:
        """Uncertainty of stamps, except for the smallest delay [s], NaN if unknown."""
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
        self._delays: deque[float] = deque(maxlen=32)
        self._intervals: deque[float] = deque(maxlen=16)
        self._suspects: deque[tuple[int, int]] = deque(maxlen=_CONFIRMATIONS)

    def stamp(self, time: int, arrival: int) -> int:
        """Return the stamp [ns] of a measurement, given controller time [us] and arrival [ns].

        Raises ValueError if the time is implausible or equal to the previous time.
        """
        if self._last is not None:
            self._advance(time, arrival)
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
        """Return the stamp [ns] of a measurement without a time, from its arrival."""
        self._stamp = max(arrival, self._stamp + 1)
        return self._stamp

    def _advance(self, time: int, arrival: int) -> None:
        """Advance to a time; raise ValueError if it is implausible and not confirmed."""
        assert self._last is not None
        passed = (time - self._last) % CLOCK_RANGE
        if not passed:
            raise ValueError(f'time = {time} us repeats the last frame; measure each frame once')
        here = (arrival - self._begun) // _MICROSECOND
        latest = round((here / 1e6 + _FROM_THE_FUTURE - self._envelope.offset) * 1e6)
        latest = round(latest / (1 + self._envelope.drift))
        elapsed = self._elapsed + passed
        elapsed += max((latest - elapsed) // CLOCK_RANGE, 0) * CLOCK_RANGE
        earliest = latest - round(1e6 * (_FROM_THE_FUTURE + _FROM_THE_PAST))
        if earliest <= elapsed <= latest and self._plausible(elapsed, arrival):
            self._intervals.append((elapsed - self._elapsed) / 1e6)
            self._elapsed = elapsed
            self._suspects.clear()
            return
        # The time may have decreased.
        signed = (passed + CLOCK_RANGE // 2) % CLOCK_RANGE - CLOCK_RANGE // 2
        late = self._late(self._elapsed + signed, arrival)
        self._suspects.append((time, arrival))
        if not self._confirmed():
            raise ValueError(
                f'time = {time} us differs from its arrival by {abs(late):.3g} s; '
                'check the wiring, and send a checksum with each line'
            )
        if abs(late) < _FROM_THE_FUTURE:
            self.jumps += 1
            self._discard()
        else:
            self.reset()

    def _late(self, elapsed: int, arrival: int) -> float:
        """Return the delay above the line [s], given the time since the first measurement [us]."""
        x = elapsed * _MICROSECOND / _SECOND
        return (arrival - self._begun) / _SECOND - x - self._envelope.at(x)

    def _plausible(self, elapsed: int, arrival: int) -> bool:
        """Return whether a time since the first measurement [us] agrees with its arrival [ns].

        A message cannot arrive early. A late message is plausible unless its sampling interval is
        unusual too, because waiting does not change the sampling interval.
        """
        if math.isnan(self.scatter):
            return True
        late, tolerance = self._late(elapsed, arrival), self._tolerance(arrival - self._arrival)
        if late < 0:
            return -late <= max(tolerance * _EARLY / _LATE, _SMALLEST_JUMP)
        usual = float(np.median(self._intervals))
        spread = float(np.median(np.abs(np.array(self._intervals) - usual)))
        interval = (elapsed - self._elapsed) / 1e6
        unusual = abs(interval - usual * max(round(interval / usual), 1))
        return late <= tolerance or unusual <= max(_UNUSUAL * spread, _CLOCK_RESOLUTION)

    def _tolerance(self, gap: int) -> float:
        """Return the largest plausible deviation of a time [s] after a gap [ns]."""
        usual = float(np.median(self._delays)) if self._delays else 0.0
        return max(_LATE * usual, _SMALLEST_JUMP) + LARGEST_DRIFT * abs(gap) / _SECOND

    def _confirmed(self) -> bool:
        """Return whether the implausible times are consistent with each other."""
        if len(self._suspects) < _CONFIRMATIONS:
            return False
        times, arrivals = np.diff(np.array(self._suspects, dtype=np.int64), axis=0).T
        passed = times % CLOCK_RANGE / 1e6
        limits = [self._tolerance(int(gap)) for gap in arrivals]
        return bool((passed > 0).all() and (abs(arrivals / _SECOND - passed) <= limits).all())
