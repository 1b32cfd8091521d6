# SPDX-License-Identifier: Apache-2.0
"""Observer of a wall on which known torques act.

The observer is the filter of the analyser, `OrbitFilter`, with a disturbance state. u is the
acceleration of the arc s by the known torques. d is the disturbance: gravity, friction and
unmodelled deviations of the chain. With

    s'' = u + d,

a constant force causes no steady error. The bandwidth determines the poles of the Kalman filter,
independent of the noise and of the motion of the wall.
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
    """Estimated state of a wall.

    time: instant of the estimate [s].
    arc: arc length along the orbit [rad], unwrapped over cycles.
    rate: rate of the arc length [rad/s].
    disturbance: acceleration that is not due to the known torques [rad/s^2].
    seen: instant of the last frame that showed the wall [s].
    upside_down: whether the chain is the mirror image phi -> pi - phi of the chain of the orbit.
    """

    time: float
    arc: float
    rate: float
    disturbance: float
    seen: float
    upside_down: bool

    def after(self, elapsed: float, acceleration: float) -> WallEstimate:
        """Return the state after a time [s] of constant acceleration [rad/s^2]."""
        gained = (acceleration + self.disturbance) * elapsed
        return replace(
            self,
            time=self.time + elapsed,
            arc=self.arc + (self.rate + gained / 2) * elapsed,
            rate=self.rate + gained,
        )


class WallObserver:
    """Estimator of the arc of a wall, its rate, and the disturbance.

    The estimate is None before the first detection of the wall, and after `detection_timeout`
    without a detection.
    """

    def __init__(
        self, orbit: Orbit, bandwidth: float, settings: SteeringSettings = DEFAULTS
    ) -> None:
        """Start without frames; `bandwidth` sets the poles of the filter [rad/s]."""
        self.orbit = orbit
        self.bandwidth = bandwidth
        self.estimate: WallEstimate | None = None
        self._settings = settings
        self._seen = -math.inf
        estimation = EstimationSettings(
            noise=NoiseSettings(least_noise=settings.min_noise),
            filter=FilterSettings(rate_changes=(), biases=(), impulse_ages=0, disturbance=1.0),
        )
        self._filter = OrbitFilter(orbit, settings=estimation)

    def reset(self) -> None:
        """Discard all frames, but keep the estimated offsets of the encoders."""
        self.estimate, self._seen = None, -math.inf
        self._filter.restart()

    def update(
        self, time: float, angles: Array, torques: Array | None = None
    ) -> WallEstimate | None:
        """Return the estimate at an instant [s] from its angles [rad], shape (N,), NaN if unknown.

        `torques` [N m], shape (N,), are those since the previous frame. Late and repeated frames
        are ignored. If the time decreases by more than `detection_timeout`, the observer restarts.
        Raises ValueError unless there is one angle for each rotor.
        """
        before = self.estimate
        if before and time < before.time - self._settings.detection_timeout:
            self.reset()
        elif before and time <= before.time:
            return before
        self._filter.bandwidth = self.bandwidth
        found = self._filter.update(time, angles, torques=torques)
        if found.status in (TrackingStatus.ACQUIRED, TrackingStatus.TRACKING):
            self._seen = time
        self.estimate = None
        if (
            found.status is not TrackingStatus.LOST
            and time - self._seen <= self._settings.detection_timeout
        ):
            disturbance = self._filter.disturbance
            self.estimate = WallEstimate(
                time, found.arc, found.rate, disturbance, self._seen, found.upside_down
            )
        return self.estimate
