# SPDX-License-Identifier: Apache-2.0
"""Position control of a wall by torques along the zero mode.

Let s be the arc length of the wall, and I its inertia, the moment of inertia of a rotor. To follow
a reference r(t), the controller applies the force

    F = I [r'' + 2 b (r' - s') + b^2 (r - s) - d]

along the orbit, with the bandwidth b and the disturbance d. The estimates of s, s' and d are
predicted to the instant at which the torques act. Noise causes torques proportional to b^(5/2)
q^(-1/2), with the coupling q of `TorqueAllocation`. Therefore b is chosen proportional to q^(1/5),
so that these torques do not depend on q.
"""

from __future__ import annotations

import enum
import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.steering.reference_trajectory import (
    ReferencePoint,
    ReferenceTrajectory,
    adiabatic_rate,
    bandwidth,
    trajectory_to,
    trajectory_to_rest,
)
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings
from soliton_linkage.steering.torque_allocation import TorqueAllocation
from soliton_linkage.steering.wall_observer import WallEstimate, WallObserver

_BANDWIDTH_EXPONENT = 1 / 5
"""Exponent e of the bandwidth b ~ q^e [1]."""
_MAX_EXTENSIONS = 8
"""Largest number of tried durations of a trajectory that starts from a moving wall [1]."""
_EXTENSION = 1.5
"""Ratio of each tried duration to the previous one [1]; a longer trajectory needs less force."""


class Outcome(enum.Enum):
    """Result of a move, or the reason for its rejection."""

    REACHED = 'reached'
    STOPPED = 'stopped'
    PREEMPTED = 'preempted'
    OUT_OF_CHAIN = 'out of chain'
    OUT_OF_REACH = 'out of reach'
    NO_SOLITON = 'no soliton'
    SOLITON_LOST = 'soliton lost'
    NOT_HELD = 'not held'
    INVALID_SPEED = 'invalid speed'


@dataclass(frozen=True)
class MoveResult:
    """Result of a move; `site` is the final site of the wall [rotor spacings], NaN if unknown."""

    outcome: Outcome
    message: str
    site: float


@dataclass(frozen=True)
class WallState:
    """Position and velocity of a wall.

    site: site coordinate [rotor spacings].
    speed: velocity along the chain [rotor spacings / s], 0 while the wall is at an edge.
    """

    site: float
    speed: float


class _Sent(NamedTuple):
    torques: Array | None = None
    """Torques sent after one frame [N m], shape (N,); None means 0."""
    acceleration: float = 0.0
    """Acceleration of the arc length by these torques [rad/s^2]."""


class Steering:
    """Controller that estimates the motion of a wall and returns the torques that move the wall.

    Call `torques` once after each call of `observe`. The torques are 0 before the first `move`.
    After a move, the controller holds the wall until the next move, a `release`, or the loss of
    the wall.
    """

    def __init__(
        self, orbit: Orbit, allocation: TorqueAllocation, settings: SteeringSettings = DEFAULTS
    ) -> None:
        self.orbit = orbit
        self.allocation = allocation
        self.settings = settings
        self.adiabatic_speed = adiabatic_rate(orbit, settings) / orbit.site_arc
        self._inertia = orbit.chain.moment_of_inertia
        self._period = math.nan
        self._bandwidth_factor = 1.0
        self._observer = WallObserver(orbit, settings.observer_ratio * self._bandwidth, settings)
        sent = settings.latency + 1
        self._sent = deque([_Sent()] * sent, maxlen=sent)
        self.trajectory: ReferenceTrajectory | None = None
        """Trajectory of the current or last move; None if the wall is released."""
        self._stopping = False
        self._resting_since: float | None = None
        self._moving = False
        self._speed_limit = math.inf
        self._restarts = 0
        self._gap_until: float | None = None
        self._last: WallEstimate | None = None

    @property
    def wall(self) -> WallState | None:
        """Position and velocity of the wall in the last frame; None if no wall is known."""
        estimate = self._observer.estimate
        if estimate is None:
            return None
        site = self.orbit.site(estimate.arc)
        inside = 0 < site < self.orbit.chain.number_of_rotors - 1
        direction = (1 if self.orbit.leg(estimate.arc) % 2 == 0 else -1) if inside else 0
        return WallState(site, direction * estimate.rate / self.orbit.site_arc_at(estimate.arc))

    @property
    def estimate(self) -> WallEstimate | None:
        """Estimated state of the wall in the last frame; None if no wall is known."""
        return self._observer.estimate

    @property
    def holding(self) -> bool:
        """Whether the wall follows a trajectory or is held at its end."""
        return self.trajectory is not None

    def reset(self) -> None:
        """Release the wall and discard all frames."""
        self.release()
        self._period, self._bandwidth_factor = math.nan, 1.0
        self._gap_until = self._last = None
        self._sent.extend([_Sent()] * len(self._sent))
        self._observer.reset()
        self._observer.bandwidth = self.settings.observer_ratio * self._bandwidth

    def observe(self, time: float, angles: Array) -> MoveResult | None:
        """Process a frame with its time [s] and its angles [rad], shape (N,).

        Return a result if the move ends in this frame or a held wall is lost; otherwise return
        None.
        """
        before = self._observer.estimate
        if before is not None and time > before.time:
            if time - before.time > self.settings.max_gap * self._period:
                self._gap_until = time + 2 * self.settings.detection_timeout
            self._measure_period(time - before.time)
        after_gap = self._gap_until is not None and time <= self._gap_until
        estimate = self._observer.update(time, angles, self._sent[0].torques)
        if estimate is None:
            lost = 'the angles no longer show a soliton'
            return None if self.holding and after_gap else self._lost(lost)
        last, self._last = self._last, estimate
        if before is not None and estimate.time < before.time:
            return self._lost(f'the stamps decreased by {before.time - estimate.time:.3g} s')
        if last is not None and self._jumped(last, estimate):
            # Reset the observer, because it has interpreted the jump as a high speed.
            self._observer.reset()
            self._last = self._observer.update(time, angles)
            return self._lost('the soliton has moved farther than its speed allows')
        if self.trajectory is None:
            return None
        error = abs(self.trajectory.at(time).arc - estimate.arc) / self.orbit.site_arc
        if error > self.settings.max_error:
            if self._restarts >= self.settings.max_restarts:
                return self._lost(
                    f'the soliton differs from its reference by {error:.2g} rotor spacings, more '
                    f'than {self.settings.max_error:g}, after {self._restarts} restarts'
                )
            self._restart(self.trajectory, estimate)
            return None
        return self._check_arrival(self.trajectory, estimate)

    def move(self, site: float, speed: float = 0.0) -> MoveResult | None:
        """Start to move the wall to a site [rotor spacings]; return None, or the rejection.

        The speed is limited to `adiabatic_speed` and `speed` [rotor spacings / s]. If `speed` is
        0, only `adiabatic_speed` limits the speed.
        """
        estimate = self._observer.estimate
        rejection = self._rejection(site, speed, estimate)
        if rejection is not None or estimate is None:
            return rejection
        limit = min(speed or math.inf, self.adiabatic_speed) * self.orbit.site_arc
        shortest = self.settings.min_duration / (self._bandwidth / self._bandwidth_factor)
        point = self._reference(estimate)
        goal = self._nearest_arc(site, point, shortest)
        trajectory = self._within_reach(goal, estimate, point, limit, shortest)
        rejection = self._out_of_reach(site, estimate, trajectory)
        if rejection is None:
            coupling = self.allocation.min_coupling(estimate.arc, goal)
            self._bandwidth_factor = coupling**_BANDWIDTH_EXPONENT
            self._restarts, self._speed_limit = 0, limit
            trajectory = self._within_reach(goal, estimate, point, limit, self._shortest)
            self._begin(trajectory, stopping=False)
        return rejection

    def stop(self) -> None:
        """Brake the wall and hold it at the position where it comes to rest."""
        estimate = self._observer.estimate
        if estimate is None or not self._moving:
            return
        point = self._reference(estimate)
        self._begin(trajectory_to_rest(estimate.time, point, self._shortest), stopping=True)

    def release(self) -> None:
        """Release the wall: apply no further torques."""
        self.trajectory = None
        self._moving = False

    def torques(self) -> Array:
        """Return the torques to send after the last frame [N m], shape (N,)."""
        estimate = self._observer.estimate
        if estimate is None or self.trajectory is None:
            self._sent.append(_Sent())
            return np.zeros(self.orbit.chain.number_of_rotors)
        then = estimate
        if math.isfinite(self._period):
            for sent in list(self._sent)[1:]:
                then = then.after(self._period, sent.acceleration)
        point, b = self.trajectory.at(then.time), self._bandwidth
        correction = 2 * b * (point.rate - then.rate)
        acceleration = point.acceleration + correction + b**2 * (point.arc - then.arc)
        force = self._inertia * (acceleration - then.disturbance)
        torques, available = self.allocation.torques(then.arc, force)
        torques = -torques if estimate.upside_down else torques
        self._sent.append(_Sent(torques, available / self._inertia))
        return torques

    @property
    def _bandwidth(self) -> float:
        return self._bandwidth_factor * bandwidth(self.orbit, self._period, self.settings)

    @property
    def _shortest(self) -> float:
        """Shortest duration of a trajectory [s]."""
        return self.settings.min_duration / self._bandwidth

    def _measure_period(self, elapsed: float) -> None:
        if math.isnan(self._period):
            self._period = elapsed
        # A gap of many frame periods counts as two, so that the mean changes only a little.
        longer = min(elapsed, 2 * self._period) - self._period
        self._period += longer / self.settings.period_memory
        self._observer.bandwidth = self.settings.observer_ratio * self._bandwidth

    def _begin(self, trajectory: ReferenceTrajectory, stopping: bool) -> None:
        self.trajectory = trajectory
        self._stopping = stopping
        self._moving = True
        self._resting_since = None

    def _jumped(self, last: WallEstimate, found: WallEstimate) -> bool:
        """Return whether the wall has moved farther than its rate and `max_error` allow."""
        distance = abs(math.remainder(found.arc - last.arc, self.orbit.length))
        explained = 2 * abs(last.rate) * (found.time - last.time)
        return distance > explained + self.settings.max_error * self.orbit.site_arc

    def _restart(self, followed: ReferenceTrajectory, estimate: WallEstimate) -> None:
        self._restarts += 1
        self._resting_since = None
        shortest, point = self._shortest, ReferencePoint(estimate.arc, estimate.rate, 0.0)
        if self._stopping:
            self.trajectory = trajectory_to_rest(estimate.time, point, shortest)
        else:
            goal = self._nearest_arc(self.orbit.site(followed.goal), point, shortest)
            limit = self._speed_limit
            self.trajectory = self._within_reach(goal, estimate, point, limit, shortest)

    def _within_reach(
        self,
        goal: float,
        estimate: WallEstimate,
        point: ReferencePoint,
        rate: float,
        shortest: float,
    ) -> ReferenceTrajectory:
        """Return a trajectory to a goal [rad], if possible one that the actuators can follow."""
        for _ in range(_MAX_EXTENSIONS):
            trajectory = trajectory_to(goal, estimate.time, point, rate, shortest)
            force = self.settings.force_reserve * self._inertia * trajectory.max_acceleration
            if not point.rate or self.allocation.can_move(estimate.arc, goal, force):
                break
            shortest *= _EXTENSION
        return trajectory

    def _reference(self, estimate: WallEstimate) -> ReferencePoint:
        """Return the reference at the time of `estimate`; without one, return `estimate`."""
        if self.trajectory is None:
            return ReferencePoint(estimate.arc, estimate.rate, 0.0)
        return self.trajectory.at(estimate.time)

    def _nearest_arc(self, site: float, point: ReferencePoint, time: float) -> float:
        """Return the arc length [rad] of a goal at a given site.

        The wall is at this site at several arc lengths. The result is the one nearest to the arc
        length at which the wall would come to rest if it braked evenly from `point` in `time` [s].
        """
        arc = point.arc + point.rate * time / 2
        legs = range(self.orbit.number_of_legs)
        distances = [self.orbit.arc_at(site, leg) - arc for leg in legs]
        return arc + min((math.remainder(each, self.orbit.length) for each in distances), key=abs)

    def _check_arrival(
        self, trajectory: ReferenceTrajectory, estimate: WallEstimate
    ) -> MoveResult | None:
        """Return the result if the wall has settled at the goal, or has not settled in time."""
        if not self._moving or estimate.time < trajectory.end:
            return None
        allowed = self.settings.tolerance * self.orbit.site_arc
        if abs(estimate.arc - trajectory.goal) > allowed:
            self._resting_since = None
        elif self._resting_since is None:
            self._resting_since = estimate.time
        elif estimate.time - self._resting_since > self.settings.settling_time / self._bandwidth:
            self._restarts = 0
            outcome = Outcome.STOPPED if self._stopping else Outcome.REACHED
            return self._ended(outcome, f'the soliton is held at {self._here}')
        if estimate.time - trajectory.end > self.settings.settling_timeout / self._bandwidth:
            return self._ended(
                Outcome.NOT_HELD,
                f'the soliton does not settle within {self.settings.tolerance:g} rotor spacings '
                f'of rotor {self.orbit.site(trajectory.goal):.2f}; it is held at {self._here}',
            )
        return None

    @property
    def _here(self) -> str:
        return 'an unknown position' if self.wall is None else f'rotor {self.wall.site:.2f}'

    def _ended(self, outcome: Outcome, message: str) -> MoveResult:
        self._moving = False
        return MoveResult(outcome, message, math.nan if self.wall is None else self.wall.site)

    def _lost(self, message: str) -> MoveResult | None:
        held = self.holding
        self.release()
        if not held:
            return None
        return self._ended(Outcome.SOLITON_LOST, f'{message}; the wall is released')

    def _rejection(
        self, site: float, speed: float, estimate: WallEstimate | None
    ) -> MoveResult | None:
        last = self.orbit.chain.number_of_rotors - 1
        here = math.nan if self.wall is None else self.wall.site
        if not 0 <= site <= last:
            return MoveResult(
                Outcome.OUT_OF_CHAIN,
                f'rotor = {site:g} must lie in the range 0 to {last}; choose a goal in the chain',
                here,
            )
        if not (math.isfinite(speed) and speed >= 0):
            return MoveResult(
                Outcome.INVALID_SPEED,
                f'speed = {speed:g} rotor spacings per second must be a finite number of 0 or '
                f'more; 0 selects {self.adiabatic_speed:.3g}, the fastest that excites no phonons',
                here,
            )
        if estimate is None:
            return MoveResult(
                Outcome.NO_SOLITON,
                'the angles show no soliton, because they fit no zero-energy configuration of the '
                'chain; wait until the chain is at rest, or check its parameters',
                here,
            )
        return None

    def _out_of_reach(
        self, site: float, estimate: WallEstimate, trajectory: ReferenceTrajectory
    ) -> MoveResult | None:
        force = self.settings.force_reserve * self._inertia * trajectory.max_acceleration
        if self.allocation.can_move(estimate.arc, trajectory.goal, force):
            return None
        reach, here = self.allocation.reach(estimate.arc, force), self.orbit.site(estimate.arc)
        able = f'they cannot hold a soliton at rotor {here:.2f}'
        if not math.isnan(reach.first):
            between = f'between rotors {reach.first:.2f} and {reach.last:.2f}'
            able = f'they can move a soliton at rotor {here:.2f} {between}'
        return MoveResult(
            Outcome.OUT_OF_REACH,
            f'rotor = {site:g} is out of reach of the actuators: {able} with torques up to '
            f'torque_limit ({self.allocation.torque_limit:g} N m) and spring deflections up to '
            f'strain_limit ({self.allocation.strain_limit:g} rad); actuate more rotors, or lower '
            'the speed',
            here,
        )
