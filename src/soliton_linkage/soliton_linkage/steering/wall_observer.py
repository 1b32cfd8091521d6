# SPDX-License-Identifier: Apache-2.0
"""Where a wall is while known torques push it along the orbit, frame by frame.

With u the acceleration that torques give the arc s and d what all else does, gravity, friction
and what the chain is other than thought,

    s'' = u + d,    z = s + noise,

where z is the nearest point of the orbit to a frame. Errors e = z - s correct the prediction by
gains that forget all older frames as theta = exp(-bandwidth dt) (fading memory of degree two,
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

import numpy as np

from soliton_linkage.estimation.nearest_point import fit_anywhere, fit_near
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

_STRANGEST = 0.6
_LEAST_INFORMATION = 0.3
_LONGEST_JUMP = 0.5


@dataclass(frozen=True)
class WallEstimate:
    """Where a wall is and how it moves."""

    time: float
    """Instant of the estimate [s]."""
    arc: float
    """Arc length along the orbit [rad], which counts cycles."""
    rate: float
    """Rate of the arc length [rad/s]."""
    push: float
    """Acceleration that no torque of ours explains [rad/s^2]."""
    seen: float
    """Instant of the last frame that showed the wall [s]."""
    upside_down: bool
    """Whether the chain is the image phi -> pi - phi of the cycle's."""

    def after(self, elapsed: float, acceleration: float) -> WallEstimate:
        """Return what it will be after a time [s] under an acceleration [rad/s^2]."""
        gained = (acceleration + self.push) * elapsed
        return replace(
            self,
            time=self.time + elapsed,
            arc=self.arc + (self.rate + gained / 2) * elapsed,
            rate=self.rate + gained,
        )


class WallObserver:
    """Estimates the arc of a wall, its rate, and the acceleration of unknown origin.

    Until it has recognised the chain, and after it has not for the patience [s], the estimate is
    None. A frame that does not show the wall near where it must be is passed over.
    """

    def __init__(self, orbit: UniformOrbit, bandwidth: float, patience: float = 0.2) -> None:
        """Wait for the first frame; with the bandwidth of the gains [rad/s]."""
        self.orbit = orbit
        self.bandwidth = bandwidth
        self.estimate: WallEstimate | None = None
        self._patience = patience
        self._frames = 0

    def update(self, time: float, angles: Array, acceleration: float) -> WallEstimate | None:
        """Estimate at an instant [s] from its angles [rad], shape (N,), NaN where unknown.

        The acceleration [rad/s^2] is that of the torques since the last frame. Frames that come
        late or twice change nothing; a clock that goes back by more than the patience begins
        anew. Raises ValueError for angles that are not one a rotor.
        """
        before = self.estimate
        if before is not None and time < before.time - self._patience:
            before = None
        if before is None:
            self.estimate = self._recognised(time, angles)
        elif time > before.time:
            self.estimate = self._followed(before, time, angles, acceleration)
        return self.estimate

    def _recognised(self, time: float, angles: Array) -> WallEstimate | None:
        """Search the whole cycle, and that of the chain upside down."""
        self._frames = 0
        best, least = None, _STRANGEST
        for turned in (False, True):
            shown = _shown(angles, turned)
            arc = fit_anywhere(self.orbit, shown).arc
            misfit = self._misfit(shown, arc) if math.isfinite(arc) else math.inf
            if misfit < least:
                best, least = WallEstimate(time, arc, 0.0, 0.0, time, turned), misfit
        return best

    def _followed(
        self, before: WallEstimate, time: float, angles: Array, acceleration: float
    ) -> WallEstimate | None:
        elapsed = time - before.time
        expected = before.after(elapsed, acceleration)
        shown = _shown(angles, before.upside_down)
        fit = fit_near(self.orbit, shown, expected.arc)
        error = fit.arc - expected.arc
        if (
            fit.information < _LEAST_INFORMATION
            or abs(error) > _LONGEST_JUMP * max(self.orbit.site_arc, 1.0)
            or self._misfit(shown, fit.arc) > _STRANGEST
        ):
            return expected if time - before.seen <= self._patience else None
        self._frames += 1
        of_arc, of_rate, of_push = _gains(self._frames, math.exp(-self.bandwidth * elapsed))
        return replace(
            expected,
            arc=expected.arc + of_arc * error,
            rate=expected.rate + of_rate * error / elapsed,
            push=expected.push + of_push * error / elapsed**2,
            seen=time,
        )

    def _misfit(self, angles: Array, arc: float) -> float:
        """Root mean square of what the orbit leaves of all rotors that are known [rad]."""
        left = angles - self.orbit.configuration(arc)
        left -= 2 * math.pi * np.rint(left / (2 * math.pi))
        known = left[np.isfinite(left)]
        return math.sqrt(float(known @ known) / len(known)) if len(known) else math.inf


def _shown(angles: Array, upside_down: bool) -> Array:
    return math.pi - angles if upside_down else angles


def _gains(frames: int, kept: float) -> tuple[float, float, float]:
    """Gains of arc, rate and push after so many frames, in units of the time between two."""
    n = frames
    counted = (n + 1) * (n + 2) * (n + 3)
    expanding = 3 * (3 * n * n + 3 * n + 2) / counted
    if expanding > 1 - kept**3:
        return expanding, 18 * (2 * n + 1) / counted, 60 / counted
    gone = 1 - kept
    return 1 - kept**3, 1.5 * gone**2 * (1 + kept), gone**3
