# SPDX-License-Identifier: Apache-2.0
"""Where a wall is while known torques push it along the orbit, frame by frame.

The estimator of the analyser, `OrbitFilter`, finds the wall and measures its arc z in each frame.
It takes the rate of a wall for constant but for pushes that it is told of. A wall that is held
has a force on it that lasts: with u the acceleration that torques give the arc s and d the
disturbance, what gravity, friction and all that the chain is other than thought do,

    s'' = u + d,    z = s + noise.

Innovations e = z - s correct the prediction by gains that forget all older frames as
theta = exp(-bandwidth dt) (fading memory of degree two, N. Morrison, Introduction to Sequential
Smoothing and Prediction, 1969):

    s += (1 - theta^3) e,
    w += 3/2 (1 - theta)^2 (1 + theta) e / dt,
    d += (1 - theta)^3 e / dt^2.

The first frames count alike (expanding memory), until the gains have come down to these. As d
is among the states, a constant force leaves no error. The estimator is told of u + d as a push.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.estimation.places.orbit_estimate import OrbitEstimate, TrackingStatus
from soliton_linkage.estimation.places.pushes import Push
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
    None. A frame that does not show the wall near where it must be is passed over.
    """

    def __init__(
        self, orbit: Orbit, bandwidth: float, settings: SteeringSettings = DEFAULTS
    ) -> None:
        """Wait for the first frame; with the bandwidth of the gains [rad/s]."""
        self.orbit = orbit
        self.bandwidth = bandwidth
        self.estimate: WallEstimate | None = None
        self._settings = settings
        self._frames = 0
        self._moments = orbit.chain.moments_of_inertia
        self._filter = OrbitFilter(orbit)

    def forget(self) -> None:
        """Know of no frame, as at first, but for the offsets of encoders."""
        self.estimate = None
        self._filter.forget()

    def update(self, time: float, angles: Array, acceleration: float) -> WallEstimate | None:
        """Estimate at an instant [s] from its angles [rad], shape (N,), NaN where unknown.

        The acceleration [rad/s^2] is that of the torques since the last frame. Frames that come
        late or twice change nothing; a clock that goes back by more than the
        `seen_timeout` begins anew. Raises ValueError for angles that are not one a rotor.
        """
        if self.estimate and time < self.estimate.time - self._settings.seen_timeout:
            self.forget()
        before = self.estimate
        if before is None:
            self._frames = 0
            found = self._filter.update(time, angles)
            self.estimate = _first(found) if _shows_wall(found) else None
        elif time > before.time:
            expected = before.after(time - before.time, acceleration)
            if acceleration:
                self._tell(before, expected.rate - before.rate)
            found = self._filter.update(time, angles)
            self.estimate = self._corrected(expected, time - before.time, found)
        return self.estimate

    def _tell(self, before: WallEstimate, gained: float) -> None:
        """Tell the estimator of a change of the rate [rad/s] since the frame before."""
        change = -gained if before.upside_down else gained
        self._filter.push(Push(change * self._moments * self.orbit.tangent(before.arc)))

    def _corrected(
        self, expected: WallEstimate, elapsed: float, found: OrbitEstimate
    ) -> WallEstimate | None:
        """What is expected of a frame, a time [s] after the last, corrected by what it shows."""
        settings = self._settings
        innovation = self._innovation(expected, found)
        if not abs(innovation) < settings.largest_innovation * max(self.orbit.site_arc, 1.0):
            lasts = expected.time - expected.seen <= settings.seen_timeout
            return expected if lasts else None
        self._frames += 1
        of_arc, of_rate, of_disturbance = _gains(self._frames, math.exp(-self.bandwidth * elapsed))
        return replace(
            expected,
            arc=expected.arc + of_arc * innovation,
            rate=expected.rate + of_rate * innovation / elapsed,
            disturbance=expected.disturbance + of_disturbance * innovation / elapsed**2,
            seen=expected.time,
        )

    def _innovation(self, expected: WallEstimate, found: OrbitEstimate) -> float:
        """Measured arc less what is expected of it [rad], NaN where a frame tells too little."""
        view = self._filter.view
        if view is None or not _shows_wall(found) or found.upside_down != expected.upside_down:
            return math.nan
        if view.information < self._settings.least_information:
            return math.nan
        return math.remainder(view.arc - expected.arc, self.orbit.length)


def _shows_wall(found: OrbitEstimate) -> bool:
    """Whether an estimate rests on its frame too, not on those before alone."""
    return found.status in (TrackingStatus.ACQUIRED, TrackingStatus.TRACKING)


def _first(found: OrbitEstimate) -> WallEstimate:
    """What the first frame tells, of which two more tell rate and disturbance."""
    return WallEstimate(found.time, found.arc, 0.0, 0.0, found.time, found.upside_down)


def _gains(frames: int, kept: float) -> tuple[float, float, float]:
    """Gains of arc, rate and disturbance after so many frames, in units of their period."""
    n = frames
    counted = (n + 1) * (n + 2) * (n + 3)
    expanding = 3 * (3 * n * n + 3 * n + 2) / counted
    if expanding > 1 - kept**3:
        return expanding, 18 * (2 * n + 1) / counted, 60 / counted
    gone = 1 - kept
    return 1 - kept**3, 1.5 * gone**2 * (1 + kept), gone**3
