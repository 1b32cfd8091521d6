# SPDX-License-Identifier: Apache-2.0
"""Observer of a wall on which known torques act: an `OrbitFilter` that estimates a disturbance d.

The model is s'' = F / I + d for the arc length s, with the moment of inertia I of a rotor. The
known torques have the component F along the orbit, and the acceleration d is due to all other
forces. Because d is estimated, a constant unknown force causes no steady error of the estimate.
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
    arc: arc length along the orbit [rad]; it does not jump at the end of a cycle.
    rate: rate of the arc length [rad/s].
    disturbance: acceleration of the arc length that is not due to the known torques [rad/s^2].
    seen: instant of the last frame in which the wall was detected [s].
    upside_down: whether the chain is assembled upside down, so that pi - phi follow the orbit.
    """

    time: float
    arc: float
    rate: float
    disturbance: float
    seen: float
    upside_down: bool

    def after(self, elapsed: float, acceleration: float) -> WallEstimate:
        """Return the state `elapsed` [s] later, given the acceleration by torques [rad/s^2]."""
        gained = (acceleration + self.disturbance) * elapsed
        arc = self.arc + (self.rate + gained / 2) * elapsed
        return replace(self, time=self.time + elapsed, arc=arc, rate=self.rate + gained)


class WallObserver:
    """Estimator of the arc length of a wall along the orbit, of its rate, and of the disturbance.

    `bandwidth` [rad/s] determines the poles of the filter. `estimate` is None before the first
    detection of the wall, and after `detection_timeout` without a detection. The filter also
    estimates the constant offsets of the encoders, which measure the angles.
    """

    def __init__(
        self, orbit: Orbit, bandwidth: float, settings: SteeringSettings = DEFAULTS
    ) -> None:
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
        """Process a frame and return the new estimate, or None if no wall is known.

        `angles` [rad], (N,), are NaN if unknown. `torques` [N m], (N,), acted since the previous
        frame; None means 0. A frame that is not later than the previous estimate is ignored, but a
        frame that is earlier by more than `detection_timeout` restarts the observer. Raises
        ValueError for a wrong shape.
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
        recent = time - self._seen <= self._settings.detection_timeout
        if recent and found.status is not TrackingStatus.LOST:
            motion = found.arc, found.rate, self._filter.disturbance
            self.estimate = WallEstimate(time, *motion, self._seen, found.upside_down)
        return self.estimate
