# SPDX-License-Identifier: Apache-2.0
"""Where a wall is while known torques push it along the orbit, frame by frame.

With u the acceleration that torques give the arc s and d the disturbance, what gravity, friction
and all that the chain is other than thought do,

    s'' = u + d,    z = s + noise,

where z is the nearest point of the orbit to a frame. Innovations e = z - s correct the prediction
by gains that forget all older frames as theta = exp(-bandwidth dt) (fading memory of degree two,
N. Morrison, Introduction to Sequential Smoothing and Prediction, 1969):

    s += (1 - theta^3) e,
    w += 3/2 (1 - theta)^2 (1 + theta) e / dt,
    d += (1 - theta)^3 e / dt^2.

The first frames count alike (expanding memory), until the gains have come down to these. As d
is among the states, a constant force leaves no error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from soliton_linkage.estimation.nearest_point import fit_near, misfit_of_all, recognise, righted
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
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

    Until it has recognised the chain, and after it has not for the `seen_timeout`, the estimate
    is None. A frame that does not show the wall near where it must be is passed over.
    """

    def __init__(
        self,
        orbit: UniformOrbit,
        bandwidth: float,
        settings: SteeringSettings = DEFAULTS,
    ) -> None:
        """Wait for the first frame; with the bandwidth of the gains [rad/s]."""
        self.orbit = orbit
        self.bandwidth = bandwidth
        self.estimate: WallEstimate | None = None
        self._settings = settings
        self._frames = 0

    def update(self, time: float, angles: Array, acceleration: float) -> WallEstimate | None:
        """Estimate at an instant [s] from its angles [rad], shape (N,), NaN where unknown.

        The acceleration [rad/s^2] is that of the torques since the last frame. Frames that come
        late or twice change nothing; a clock that goes back by more than the
        `seen_timeout` begins anew. Raises ValueError for angles that are not one a rotor.
        """
        before = self.estimate
        if before is not None and time < before.time - self._settings.seen_timeout:
            before = None
        if before is None:
            self.estimate = self._recognised(time, angles)
        elif time > before.time:
            self.estimate = self._followed(before, time, angles, acceleration)
        return self.estimate

    def _recognised(self, time: float, angles: Array) -> WallEstimate | None:
        self._frames = 0
        arc, upside_down, misfit = recognise(self.orbit, angles)
        if not misfit < self._settings.largest_misfit:
            return None
        return WallEstimate(time, arc, 0.0, 0.0, time, upside_down)

    def _followed(
        self, before: WallEstimate, time: float, angles: Array, acceleration: float
    ) -> WallEstimate | None:
        elapsed = time - before.time
        expected = before.after(elapsed, acceleration)
        shown = righted(angles, before.upside_down)
        fit = fit_near(self.orbit, shown, expected.arc)
        innovation = fit.arc - expected.arc
        settings = self._settings
        if (
            fit.information < settings.least_information
            or abs(innovation) > settings.largest_innovation * max(self.orbit.site_arc, 1.0)
            or misfit_of_all(self.orbit, shown, fit.arc) > settings.largest_misfit
        ):
            return expected if time - before.seen <= settings.seen_timeout else None
        self._frames += 1
        of_arc, of_rate, of_disturbance = _gains(self._frames, math.exp(-self.bandwidth * elapsed))
        return replace(
            expected,
            arc=expected.arc + of_arc * innovation,
            rate=expected.rate + of_rate * innovation / elapsed,
            disturbance=expected.disturbance + of_disturbance * innovation / elapsed**2,
            seen=time,
        )


def _gains(frames: int, kept: float) -> tuple[float, float, float]:
    """Gains of arc, rate and disturbance after so many frames, in units of their period."""
    n = frames
    counted = (n + 1) * (n + 2) * (n + 3)
    expanding = 3 * (3 * n * n + 3 * n + 2) / counted
    if expanding > 1 - kept**3:
        return expanding, 18 * (2 * n + 1) / counted, 60 / counted
    gone = 1 - kept
    return 1 - kept**3, 1.5 * gone**2 * (1 + kept), gone**3
