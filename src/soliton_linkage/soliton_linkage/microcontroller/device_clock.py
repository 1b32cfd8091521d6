# SPDX-License-Identifier: Apache-2.0
"""The clock of a microcontroller, as seen by the clock of the computer that hears it."""

from __future__ import annotations

from soliton_linkage.microcontroller.delay_envelope import DelayEnvelope
from soliton_linkage.microcontroller.frames import CLOCK_RANGE

_MICROSECOND = 1000
"""In nanoseconds."""
_SECOND = 10**9
"""In nanoseconds."""
_FROM_THE_FUTURE = 0.25
"""By which a measurement may be later than now [s]: a drift of 1 % in 25 s without a frame. What
is later still is of a clock that has begun anew."""
_FROM_THE_PAST = 10.0
"""By which it may be late [s]: what the system keeps of a line of 9600 baud takes four. What is
earlier still is of a clock that has stood still, or counts something else."""


class DeviceClock:
    """Instants of measurements by the clock here, of times by that of the controller.

    The offset and the drift of the controller's clock come from when the messages arrive, of
    which none can arrive before it was sent. The least delay of all is part of the offset:
    nothing at this end can tell it. Stamps grow from measurement to measurement.
    """

    def __init__(self) -> None:
        self.restarts = 0
        """How often the controller's clock has begun anew."""
        self.delay = 0.0
        """What the last measurement took to arrive, but for the least delay [s]."""
        self._last: int | None = None
        self._stamp = -1
        self.begin_anew()

    @property
    def drift(self) -> float:
        """By how much the controller's clock is slow [1]: a second of it lasts 1 + drift here."""
        return self._envelope.drift

    @property
    def scatter(self) -> float:
        """What stamps are sure to, but for the least delay [s]; NaN where it is not known yet."""
        return self._envelope.scatter

    @property
    def known(self) -> bool:
        """Whether there has been a measurement since the clock began."""
        return self._last is not None

    def begin_anew(self) -> None:
        """Forget the clock: the controller has begun anew, or is another."""
        if self._last is not None:
            self.restarts += 1
        self._last = None
        self._elapsed = 0
        self._begun = 0
        self._envelope = DelayEnvelope()

    def stamp(self, time: int, arrival: int) -> int:
        """Instant [ns] of a measurement at a time of the controller [us] that arrives at one [ns].

        Raises ValueError for a time that is the one before.
        """
        if self._last is not None:
            self._elapsed_to(time, arrival)
        if self._last is None:
            self._begun = arrival
        self._last = time
        x = self._elapsed * _MICROSECOND / _SECOND
        self._envelope.add(x, (arrival - self._begun) / _SECOND - x)
        ran = self._elapsed * _MICROSECOND + round(self._envelope.at(x) * _SECOND)
        self._stamp = max(self._begun + ran, self._stamp + 1)
        self.delay = (arrival - self._stamp) / _SECOND
        return self._stamp

    def stamp_of_arrival(self, arrival: int) -> int:
        """Instant [ns] of a measurement whose time is not told: when it arrives."""
        self._stamp = max(arrival, self._stamp + 1)
        return self._stamp

    def _elapsed_to(self, time: int, arrival: int) -> None:
        """Go on to a time, or begin anew where that would be in the future or long past."""
        assert self._last is not None
        gone = (time - self._last) % CLOCK_RANGE
        if not gone:
            raise ValueError(
                f'time = {time} us is that of the frame before; measure each frame once'
            )
        here = (arrival - self._begun) // _MICROSECOND
        latest = round((here / 1e6 + _FROM_THE_FUTURE - self._envelope.offset) * 1e6)
        latest = round(latest / (1 + self._envelope.drift))
        elapsed = self._elapsed + gone
        elapsed += max((latest - elapsed) // CLOCK_RANGE, 0) * CLOCK_RANGE
        earliest = latest - round(1e6 * (_FROM_THE_FUTURE + _FROM_THE_PAST))
        if not earliest <= elapsed <= latest:
            self.begin_anew()
        else:
            self._elapsed = elapsed
