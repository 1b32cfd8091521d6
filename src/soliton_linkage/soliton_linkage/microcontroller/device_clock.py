# SPDX-License-Identifier: Apache-2.0
"""Offset and drift of the clock of a microcontroller, from the arrival times of its messages.

A message is sent when the clock of the sender shows x. When it arrives, the clock of the receiver
shows x + y with

    y = a + b x + d,    d >= 0.

Here a is the offset between the clocks plus the smallest delay of a message, b is the drift, and d
is the additional delay due to waiting. The estimate of a + b x is a line below all points (x, y):
of all such lines, the one with the least mean distance from the points. This line passes through
the edge of the lower convex hull at the mean of x (S. Moon, P. Skelly and D. Towsley, INFOCOM
1999, doi:10.1109/INFCOM.1999.749287). Time is divided into intervals. Only the message with the
smallest delay in each interval is used as a point.
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
"""Number of intervals in the fit of the line [1]. Sensitivity: at 0.5x, the error of the line is
twice as large; at 2x, a fit takes four times as long."""
_FIRST_INTERVAL = 1 / 16
"""Duration of the first intervals [s]. The drift is known after two intervals."""
_LONGEST_INTERVAL = 2.0
"""Duration of the later intervals [s]. All intervals in the fit together cover two minutes.
Sensitivity: at 0.5x, the line follows the drift of a warming clock faster; at 2x, the line of a
steady clock is more precise."""
LARGEST_DRIFT = 0.01
"""Largest accepted drift of a clock [1]. It is twice the drift of the ceramic resonator of an
Arduino Uno."""
_FROM_THE_FUTURE = 0.25
"""Largest time by which a measurement may seem to be later than its arrival [s]. A drift of 1 %
causes this value after 25 s without a frame. A larger value means that the clock has restarted."""
_FROM_THE_PAST = 10.0
"""Largest accepted delay from measurement to arrival [s]. The buffer of the system holds four
seconds of a line at 9600 baud. A larger delay means that the clock has stopped or does not count
microseconds."""
_SMALLEST_JUMP = 1e-3
"""Smallest jump of a clock that is detected [s]. Sensitivity: at 0.5x, an unusually early message
may look like a jump; at 2x, undetected jumps bias the drift more."""
_EARLY, _LATE = 3.0, 10.0
"""Thresholds of the distance of a message below the line and above the line, in medians of the
delay [1]: the time of the message is implausible if the distance is larger. If delays have an
exponential distribution, one delay in a thousand exceeds ten medians. Three successive delays
practically never do."""
_UNUSUAL = 8.0
"""Threshold of the difference between a sampling interval and the median interval, in medians of
this difference [1]: the interval is unusual if its difference is larger."""
_CLOCK_RESOLUTION = 1e-4
"""Smallest value of this threshold [s]. It is 25 ticks of micros() of an Arduino."""
_CONFIRMATIONS = 3
"""Number of implausible, but mutually consistent times that prove a jump or a restart [1]."""


class DelayEnvelope:
    """Line below the delays of all messages, as a function of the sending time x."""

    def __init__(self) -> None:
        self.drift = 0.0
        """Slope of the line [1]."""
        self.offset = math.inf
        """Delay on the line at x = 0 [s]."""
        self.scatter = math.nan
        """Mean height of the points above the line [s]; NaN before there are three points.

        The mean is computed as the median over ln 2, which is correct for an exponential
        distribution. The median is used because an overloaded computer causes a few very large
        delays. If delays have an exponential distribution, the error of the line is this mean
        divided by the number of intervals.
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
        """Return the delay on the line at the sending time x [s]."""
        return self.offset + self.drift * x

    def _fit(self) -> None:
        """End the present interval, add its point, and fit the line again."""
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
    """Return the slope of the lower convex hull of points (x, y) at the mean of x."""
    middle = xs.mean()
    left, right = xs < middle, xs >= middle
    run = xs[right] - xs[left, None]
    rise = ys[right] - ys[left, None]
    crossing = ys[left, None] + rise / run * (middle - xs[left, None])
    lowest = np.unravel_index(np.argmin(crossing), crossing.shape)
    return float(rise[lowest] / run[lowest])


class DeviceClock:
    """Conversion of times of the controller's clock to time stamps of the host's clock.

    Offset and drift are estimated from the arrival times. The principle is that no message arrives
    before it is sent. The offset includes the smallest delay, which the receiver cannot measure.
    Stamps increase from measurement to measurement.

    A measurement with an implausible time is rejected. Three successive implausible times that are
    consistent with each other show that the clock has jumped or restarted. The estimate of offset
    and drift then restarts.
    """

    def __init__(self) -> None:
        self.restarts = 0
        """Number of restarts of the controller's clock."""
        self.jumps = 0
        """Number of jumps of the controller's clock by less than 0.25 s."""
        self.delay = 0.0
        """Difference between the delay of the last measurement and the smallest delay [s]."""
        self._last: int | None = None
        self._stamp = -1
        self.reset()

    @property
    def drift(self) -> float:
        """Drift of the controller's clock [1].

        While this clock advances by one second, the clock of the host advances by 1 + drift.
        """
        return self._envelope.drift

    @property
    def scatter(self) -> float:
        """Uncertainty of stamps apart from the smallest delay [s]; NaN if it is unknown."""
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
        """Return the stamp of a measurement [ns].

        `time` is the time of the controller's clock at the measurement [us]. `arrival` is the time
        of the host's clock at the arrival of the message [ns]. Raises ValueError if `time` is
        implausible or equal to the time of the previous measurement.
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
        """Return the stamp [ns] of a measurement that contains no time.

        It is the arrival time [ns], increased if necessary so that stamps increase.
        """
        self._stamp = max(arrival, self._stamp + 1)
        return self._stamp

    def _advance(self, time: int, arrival: int) -> None:
        """Advance to the time of a measurement, or restart the estimate.

        Raises ValueError if the time is implausible and not yet confirmed by other implausible
        times.
        """
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
        # After a restart or a jump, the time may be smaller than before.
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
        """Return the delay of a message minus the delay on the line [s].

        `elapsed` is the controller's time since the first measurement [us], and `arrival` the
        arrival time [ns].
        """
        x = elapsed * _MICROSECOND / _SECOND
        return (arrival - self._begun) / _SECOND - x - self._envelope.at(x)

    def _plausible(self, elapsed: int, arrival: int) -> bool:
        """Return whether the time of a measurement agrees with the arrival of its message.

        `elapsed` is the controller's time since the first measurement [us], and `arrival` the
        arrival time [ns]. A message cannot arrive before it is sent. A late message is plausible
        unless the interval since the previous measurement is unusual too. This interval shows
        whether the clock has jumped, because waiting of the message does not change it.
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
        """Return the largest plausible error of a time [s] after a gap between messages [ns]."""
        usual = float(np.median(self._delays)) if self._delays else 0.0
        return max(_LATE * usual, _SMALLEST_JUMP) + LARGEST_DRIFT * abs(gap) / _SECOND

    def _confirmed(self) -> bool:
        """Return whether enough successive implausible times are consistent with each other."""
        if len(self._suspects) < _CONFIRMATIONS:
            return False
        times, arrivals = np.diff(np.array(self._suspects, dtype=np.int64), axis=0).T
        passed = times % CLOCK_RANGE / 1e6
        limits = [self._tolerance(int(gap)) for gap in arrivals]
        return bool((passed > 0).all() and (abs(arrivals / _SECOND - passed) <= limits).all())
