# SPDX-License-Identifier: Apache-2.0
"""One wall that is followed: where it is, how fast it goes, and who it is."""

from __future__ import annotations

import math
from typing import NamedTuple

from soliton_linkage.estimation.estimates import OrbitEstimate, TrackingStatus
from soliton_linkage.estimation.lattice import LatticeCoordinates
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import FilterSettings

_MEMORY = 100
"""Frames over which what lasts is averaged [1]."""
_SETTLED = 10.0
"""Frames in which it is known what springs do to a wall [1]."""
_SIGNIFICANCE = 3.0
"""Deviations of chance from which on it is believed [1]."""


class WallMeasurement(NamedTuple):
    """A wall as one frame shows it."""

    rotor: float
    """Centre [rotor spacings]."""
    deviation: float
    """Standard deviation of the centre [rotor spacings], NaN where it is not known."""
    charge: int
    """+1 or -1."""
    of_width: tuple[float, float]
    """Width and its standard deviation [m], NaN where they cannot be told."""
    lasting: float = 0.0
    """Variance of the centre by what lasts, or by chance [rotor spacings^2]."""
    chance: float = 0.0
    """Square of what chance makes of it [rotor spacings^4]."""
    unknown: float = 0.0
    """Variance of the centre by what springs may do to a wall [rotor spacings^2]."""
    untold: float = 0.0
    """Variance of the centre by deviations that nobody told [rotor spacings^2]."""


class WallTrack:
    """A wall, of which frames show the place, or a filter elsewhere does."""

    def __init__(
        self, line: LatticeCoordinates, charge: int, scale: float, site_arc: float
    ) -> None:
        """Begin without a place; the scale is that of rates [rad/s], the arc that of a site."""
        self._line, self._scale, self._arc = line, scale, site_arc
        self.charge = charge
        self.id = 0
        """Its name from 1 on, 0 until it is sure that there is one."""
        self.rotor = self.site_rate = math.nan
        self.deviation = self.rate_deviation = math.nan
        self.frames = 0
        """Frames that showed it."""
        self.missed = 0
        """Frames running that did not."""
        self.last_seen = math.nan
        """Instant of the last frame that showed it [s]."""
        self.seen: WallMeasurement | None = None
        """As the last frame showed it."""
        self.energy = math.nan
        """When it was last free of edges and others, where that was looked at [J]."""
        self.was_free = False
        """Whether it was so in the frame before."""
        self._motion: MultipleModelFilter | None = None
        self._variance = self._lasting = self._chance = 0.0

    @property
    def is_seen(self) -> bool:
        """Whether the last frame showed it."""
        return self.missed == 0 and self.frames > 0

    @property
    def status(self) -> TrackingStatus:
        """What it rests on."""
        if not self.is_seen:
            return TrackingStatus.COASTING
        return TrackingStatus.TRACKING if self.frames > 1 else TrackingStatus.ACQUIRED

    @property
    def deviation_squared(self) -> float:
        """Variance of a place as one frame shows it [rotor spacings^2], 0 before any."""
        return self._variance

    def predicted(self, elapsed: float) -> tuple[float, float]:
        """Place a time [s] after the last frame [rotor spacings], and its variance."""
        if self._motion is None:
            rate = self.site_rate if math.isfinite(self.site_rate) else 0.0
            unsure = 0.0 if rate else self._scale / self._arc * elapsed
            return self._line.on_it(self.rotor + rate * elapsed), unsure**2
        self._motion.predict(elapsed, self._line.edge_distance(self.rotor) < self._line.edge)
        site, variance = self._motion.expected / self._arc, self._motion.expected_variance
        return self._line.on_it(site), variance / self._arc**2

    def take(self, seen: WallMeasurement, time: float, settings: FilterSettings) -> None:
        """Take in what a frame shows, after `predicted`."""
        self._note(time)
        self.seen = seen
        one = seen.deviation**2 if math.isfinite(seen.deviation) else self._line.width**2
        # By few rotors a deviation is told badly: that of several frames is better.
        share = 1 / min(self.frames, 20)
        self._variance += share * (one - self._variance)
        variance = max(self._variance, 1e-12) * self._arc**2
        if self._motion is None:
            self._motion = MultipleModelFilter(
                seen.rotor * self._arc, variance, self._scale, self._arc, settings
            )
        else:
            expected = self._motion.expected / self._arc
            site = expected + self._line.apart(seen.rotor, self._line.on_it(expected))
            self._motion.update(site * self._arc, variance)
        arc, rate, of_arc, _, of_rate = self._motion.summary
        self.rotor = self._line.on_it(arc / self._arc)
        self.site_rate = rate / self._arc
        # What lasts shifts the wall until it has moved on, however many frames show it.
        beside = self._seen_to_last(seen) + seen.untold
        of_rate += beside * (rate / settings.bias_way) ** 2
        self.deviation = math.sqrt(of_arc / self._arc**2 + beside)
        self.rate_deviation = math.sqrt(of_rate) / self._arc

    def _seen_to_last(self, seen: WallMeasurement) -> float:
        """Variance of the place by what shapes leave of frame after frame [rotor spacings^2]."""
        share = 1 / min(self.frames, _MEMORY)
        self._lasting += share * (seen.lasting - self._lasting)
        self._chance += share * (seen.chance - self._chance)
        sure = self._lasting > _SIGNIFICANCE * math.sqrt(share * self._chance)
        unknown = seen.unknown * math.exp(-self.frames / _SETTLED)
        return unknown + (self._lasting if sure else 0.0)

    def follow(self, wall: OrbitEstimate, time: float) -> None:
        """Be where the filter of the orbit has it."""
        self._note(time)
        self.rotor, self.site_rate = wall.site, wall.site_rate
        self.deviation, self.rate_deviation = wall.site_deviation, wall.site_rate_deviation
        self._motion, self._variance, self.seen = None, 0.0, None

    def miss(self) -> None:
        """Not be shown by a frame."""
        self.missed += 1

    def stop(self) -> None:
        """Forget how it moved, as it has met another."""
        self._motion, self._variance, self.frames = None, 0.0, 0
        self._lasting = self._chance = 0.0
        self.site_rate = math.nan

    def _note(self, time: float) -> None:
        self.frames += 1
        self.missed, self.last_seen = 0, time
