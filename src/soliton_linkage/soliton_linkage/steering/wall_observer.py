# SPDX-License-Identifier: Apache-2.0
"""Where a wall is while known torques push it along the orbit, frame by frame.

It is what the estimator of the analyser, `OrbitFilter`, makes of the frames and torques, asked for
a force that lasts: with u the acceleration that torques give the arc s and d the disturbance, what
gravity, friction and all that the chain is other than thought do,

    s'' = u + d,

so that a constant force leaves no error. One Kalman filter follows the wall, whose poles are those
that are wanted, whatever the noise is and however the wall moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from soliton_linkage.estimation.estimates import TrackingStatus
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.estimation.settings import EstimationSettings, FilterSettings, NoiseSettings
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings


@dataclass(frozen=True)
class WallEstimate:
    """Where a wall is and how it moves.

    time: instant of the estimate [s].
    arc: arc length along the orbit [rad], which counts cycles.
    rate: rate of the arc length [rad/s].
    disturbance: acceleration that no torque of ours explains [rad/s^2].
    seen: instant of the last frame that showed the wall [s].
    upside_down: whether the chain is the image phi -> pi - phi of that of the orbit.
    """

    time: float
    arc: float
    rate: float
    disturbance: float
    seen: float
    upside_down: bool

    def after(self, elapsed: float, acceleration: float) -> WallEstimate:
        """Return what it will be after a time [s] under an acceleration [rad/s^2]."""
        gained = (acceleration + self.disturbance) * elapsed
        return replace(
            self,
            time=self.time + elapsed,
            arc=self.arc + (self.rate + gained / 2) * elapsed,
            rate=self.rate + gained,
        )


class WallObserver:
    """Estimates the arc of a wall, its rate, and the disturbance.

    Until the chain is recognised, and after it was not for the `seen_timeout`, the estimate is
    None.
    """

    def __init__(
        self, orbit: Orbit, bandwidth: float, settings: SteeringSettings = DEFAULTS
    ) -> None:
        """Wait for the first frame; with the bandwidth of the filter [rad/s]."""
        self.orbit = orbit
        self.bandwidth = bandwidth
        self.estimate: WallEstimate | None = None
        self._settings = settings
        self._seen = -math.inf
        estimation = EstimationSettings(
            noise=NoiseSettings(least_noise=settings.least_noise),
            filter=FilterSettings(rate_changes=(), biases=(), impulse_ages=0, disturbance=1.0),
        )
        self._filter = OrbitFilter(orbit, settings=estimation)

    def forget(self) -> None:
        """Know of no frame, as at first, but for the offsets of encoders."""
        self.estimate, self._seen = None, -math.inf
        self._filter.restart()

    def update(
        self, time: float, angles: Array, torques: Array | None = None
    ) -> WallEstimate | None:
        """Estimate at an instant [s] from its angles [rad], shape (N,), NaN where unknown.

        Torques [N m], shape (N,), acted since the last frame. Frames that come late or twice
        change nothing; a clock that goes back by more than the `seen_timeout` begins anew. Raises
        ValueError for angles that are not one a rotor.
        """
        before = self.estimate
        if before and time < before.time - self._settings.seen_timeout:
            self.forget()
        elif before and time <= before.time:
            return before
        self._filter.bandwidth = self.bandwidth
        found = self._filter.update(time, angles, torques=torques)
        if found.status in (TrackingStatus.ACQUIRED, TrackingStatus.TRACKING):
            self._seen = time
        self.estimate = None
        if (
            found.status is not TrackingStatus.LOST
            and time - self._seen <= self._settings.seen_timeout
        ):
            disturbance = self._filter.disturbance
            self.estimate = WallEstimate(
                time, found.arc, found.rate, disturbance, self._seen, found.upside_down
            )
        return self.estimate
