# SPDX-License-Identifier: Apache-2.0
"""Carrying a wall to a place and holding it there, by torques along the zero mode.

Along its orbit a chain has one coordinate, the arc s, of inertia I = M r^2 everywhere. A
reference trajectory r(t) leads to the goal, and the force

    F = I [r'' + 2 b (r' - s') + b^2 (r - s) - d]

along the orbit keeps the wall on it: with the observed arc, rate and disturbance d, errors decay
as (1 + b t) e^(-b t). Both are taken at the instant from which the torques act, the latency
after their frame, so that the latency itself costs no stability.

Noise makes a force that goes as b^(5/2), and torques that go as q^(-1/2) where only some rotors
are actuated (`TorqueAllocation`): there b is lowered by q^(1/5), lest the torques shake the
chain.
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

_QUIETING = 1 / 5
"""Exponent e in b ~ q^e [1]: noise makes torques that go as b^(5/2) q^(-1/2), which stay alike."""
_LONGER = 8
"""How often a wall that runs is given more time to be braked in [1]."""
_MORE_TIME_TO_BRAKE = 1.5
"""Factor by which it is [1]; forces go down with it."""


class Outcome(enum.Enum):
    """How a move ended, or why it never began."""

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
    """The end of a move.

    outcome: how it ended, or why it never began.
    message: the same as a sentence, with values and limits.
    place: where the wall was then [rotor spacings], NaN where there was none.
    """

    outcome: Outcome
    message: str
    place: float


@dataclass(frozen=True)
class WallState:
    """Where a wall is and how fast.

    place: [rotor spacings].
    speed: velocity of the place [rotor spacings / s], 0 while the wall waits at an edge.
    """

    place: float
    speed: float


class _Sent(NamedTuple):
    torques: Array | None
    """[N m], shape (N,), None where there were none."""
    acceleration: float
    """That they give the arc [rad/s^2]."""


_NOTHING = _Sent(None, 0.0)
"""Of a steering that holds no wall."""


class Steering:
    """Observes a wall frame by frame, and says which torques carry it on its way.

    After each `observe` it must be asked for the `torques`, once. It is at rest until `move`.
    After the end of a move the wall is held where it is, until the next move or `release`; where
    it is lost, it is let go.
    """

    def __init__(
        self,
        orbit: Orbit,
        allocation: TorqueAllocation,
        settings: SteeringSettings = DEFAULTS,
    ) -> None:
        """Wait for the first frame."""
        self.orbit = orbit
        self.allocation = allocation
        self.settings = settings
        self.adiabatic_speed = adiabatic_rate(orbit, settings) / orbit.site_arc
        self._inertia = orbit.chain.moment_of_inertia
        self._period = math.nan
        self._quiet = 1.0
        self._observer = WallObserver(orbit, settings.observer_ratio * self._bandwidth, settings)
        sent = settings.latency + 1
        self._sent = deque([_NOTHING] * sent, maxlen=sent)
        self._trajectory: ReferenceTrajectory | None = None
        self._stopping = False
        self._resting_since: float | None = None
        self._moving = False
        self._speed_limit = math.inf
        self._restarts = 0
        self._gap_until: float | None = None
        self._last: WallEstimate | None = None

    @property
    def wall(self) -> WallState | None:
        """The wall as it was in the last frame, None where it is not known."""
        estimate = self._observer.estimate
        if estimate is None:
            return None
        place = self.orbit.site(estimate.arc)
        inside = 0 < place < self.orbit.chain.number_of_rotors - 1
        way = (1 if self.orbit.leg(estimate.arc) % 2 == 0 else -1) if inside else 0
        return WallState(place, way * estimate.rate / self.orbit.site_arc_at(estimate.arc))

    @property
    def estimate(self) -> WallEstimate | None:
        """The wall as it was in the last frame, by the arc."""
        return self._observer.estimate

    @property
    def trajectory(self) -> ReferenceTrajectory | None:
        """The way that the wall is taken, at its end that it is held at; None where it is free."""
        return self._trajectory

    @property
    def holding(self) -> bool:
        """Whether the wall is on a trajectory, or held at the end of one."""
        return self._trajectory is not None

    def forget(self) -> None:
        """Let the wall go and know of no frame, as at first: those that follow come later."""
        self.release()
        self._period, self._quiet = math.nan, 1.0
        self._gap_until = self._last = None
        self._sent.extend([_NOTHING] * len(self._sent))
        self._observer.forget()
        self._observer.bandwidth = self.settings.observer_ratio * self._bandwidth

    def observe(self, time: float, angles: Array) -> MoveResult | None:
        """Take in a frame [s], [rad]; tell how the move or the hold has ended, if it has now."""
        before = self._observer.estimate
        if before is not None and time > before.time:
            if time - before.time > self.settings.gap * self._period:
                self._gap_until = time + 2 * self.settings.seen_timeout
            self._measure_period(time - before.time)
        elsewhere = self._gap_until is not None and time <= self._gap_until
        estimate = self._observer.update(time, angles, self._sent[0].torques)
        if estimate is None:
            lost = 'no wall is seen any more in the angles'
            return None if self.holding and elsewhere else self._lost(lost)
        last, self._last = self._last, estimate
        if before is not None and estimate.time < before.time:
            return self._lost(f'the clock went back by {before.time - estimate.time:.3g} s')
        if last is not None and self._ran_too_far(last, estimate):
            return self._lost('the wall is somewhere else than it can have run to')
        if self._trajectory is None:
            return None
        off = (self._trajectory.at(time).arc - estimate.arc) / self.orbit.site_arc
        if abs(off) > self.settings.largest_error:
            if self._restarts >= self.settings.most_restarts:
                return self._lost(
                    f'the wall is {abs(off):.2g} rotor spacings off its reference, more than '
                    f'{self.settings.largest_error:g}, after it began anew {self._restarts} times'
                )
            self._restart(estimate)
            return None
        return self._judged(self._trajectory, estimate)

    def move(self, place: float, speed: float = 0.0) -> MoveResult | None:
        """Begin to carry the wall to a place [rotor spacings]; tell why not, if it cannot be.

        No faster than the speed [rotor spacings / s], nor than is gentle; 0 for that.
        """
        estimate = self._observer.estimate
        refusal = self._refusal(place, speed, estimate)
        if refusal is not None or estimate is None:
            return refusal
        limit = min(speed or math.inf, self.adiabatic_speed) * self.orbit.site_arc
        shortest = self.settings.shortest_move / (self._bandwidth / self._quiet)
        point = self._reference(estimate)
        goal = self._nearest_arc(place, point.arc + point.rate * shortest / 2)
        trajectory = self._within_reach(goal, estimate, point, limit, shortest)
        refusal = self._out_of_reach(place, estimate, trajectory)
        if refusal is None:
            self._quiet = self.allocation.least_share(estimate.arc, goal) ** _QUIETING
            shortest = self.settings.shortest_move / self._bandwidth
            self._restarts, self._speed_limit = 0, limit
            trajectory = self._within_reach(goal, estimate, point, limit, shortest)
            self._begin(trajectory, stopping=False)
        return refusal

    def stop(self) -> None:
        """Brake the wall and hold it where it comes to rest."""
        estimate = self._observer.estimate
        if estimate is None or not self._moving:
            return
        shortest = self.settings.shortest_move / self._bandwidth
        self._begin(
            trajectory_to_rest(estimate.time, self._reference(estimate), shortest), stopping=True
        )

    def release(self) -> None:
        """Let the wall go."""
        self._trajectory = None
        self._moving = False

    def torques(self) -> Array:
        """Torques for the time from the latency after the last frame on [N m], shape (N,)."""
        estimate = self._observer.estimate
        if estimate is None or self._trajectory is None:
            self._sent.append(_NOTHING)
            return np.zeros(self.orbit.chain.number_of_rotors)
        then = estimate
        if math.isfinite(self._period):
            for sent in list(self._sent)[1:]:
                then = then.after(self._period, sent.acceleration)
        point, b = self._trajectory.at(then.time), self._bandwidth
        wanted = (
            point.acceleration + 2 * b * (point.rate - then.rate) + b**2 * (point.arc - then.arc)
        )
        force = self._inertia * (wanted - then.disturbance)
        torques, given = self.allocation.torques(then.arc, force)
        torques = -torques if estimate.upside_down else torques
        self._sent.append(_Sent(torques, given / self._inertia))
        return torques

    @property
    def _bandwidth(self) -> float:
        return self._quiet * bandwidth(self.orbit, self._period, self.settings)

    def _measure_period(self, elapsed: float) -> None:
        """Take the running mean of the times between frames [s], and the gains that go with it."""
        if math.isnan(self._period):
            self._period = elapsed
        # A gap says nothing of the period.
        longer = min(elapsed, 2 * self._period) - self._period
        self._period += longer / self.settings.period_memory
        self._observer.bandwidth = self.settings.observer_ratio * self._bandwidth

    def _begin(self, trajectory: ReferenceTrajectory, stopping: bool) -> None:
        self._trajectory = trajectory
        self._stopping = stopping
        self._moving = True
        self._resting_since = None

    def _ran_too_far(self, last: WallEstimate, found: WallEstimate) -> bool:
        """Whether a wall that was found anew is farther away than twice its rate takes it."""
        way = abs(math.remainder(found.arc - last.arc, self.orbit.length))
        ran = 2 * abs(last.rate) * (found.time - last.time)
        return way > ran + self.settings.largest_error * self.orbit.site_arc

    def _restart(self, estimate: WallEstimate) -> None:
        """Begin the way anew from where the wall is, to where it is to come to rest."""
        if self._trajectory is None:
            return
        self._restarts += 1
        shortest = self.settings.shortest_move / self._bandwidth
        point = ReferencePoint(estimate.arc, estimate.rate, 0.0)
        if self._stopping:
            trajectory = trajectory_to_rest(estimate.time, point, shortest)
        else:
            place = self.orbit.site(self._trajectory.goal)
            goal = self._nearest_arc(place, point.arc + point.rate * shortest / 2)
            trajectory = self._within_reach(goal, estimate, point, self._speed_limit, shortest)
        moving = self._moving
        self._begin(trajectory, self._stopping)
        self._moving = moving

    def _within_reach(
        self,
        goal: float,
        estimate: WallEstimate,
        point: ReferencePoint,
        rate: float,
        shortest: float,
    ) -> ReferenceTrajectory:
        """A trajectory as short as the actuators have the force for, or the longest tried."""
        for _ in range(_LONGER):
            trajectory = trajectory_to(goal, estimate.time, point, rate, shortest)
            force = self.settings.force_reserve * self._inertia * trajectory.strongest
            if not point.rate or self.allocation.carries(estimate.arc, goal, force):
                break
            shortest *= _MORE_TIME_TO_BRAKE
        return trajectory

    def _reference(self, estimate: WallEstimate) -> ReferencePoint:
        """What the wall is to do now: what its trajectory says, or what it does."""
        if self._trajectory is None:
            return ReferencePoint(estimate.arc, estimate.rate, 0.0)
        return self._trajectory.at(estimate.time)

    def _nearest_arc(self, place: float, arc: float) -> float:
        """Arc length of a place that is nearest to another arc [rad]."""
        legs = range(self.orbit.number_of_legs)
        ways = [self.orbit.arc_at(place, leg) - arc for leg in legs]
        return arc + min((math.remainder(way, self.orbit.length) for way in ways), key=abs)

    def _judged(
        self, trajectory: ReferenceTrajectory, estimate: WallEstimate
    ) -> MoveResult | None:
        """Tell whether the wall has come to rest where it is to be."""
        if not self._moving or estimate.time < trajectory.end:
            return None
        allowed = self.settings.tolerance * self.orbit.site_arc
        if abs(estimate.arc - trajectory.goal) > allowed:
            self._resting_since = None
        elif self._resting_since is None:
            self._resting_since = estimate.time
        elif estimate.time - self._resting_since > self.settings.rest / self._bandwidth:
            self._restarts = 0
            outcome = Outcome.STOPPED if self._stopping else Outcome.REACHED
            return self._ended(outcome, f'the wall is held at {self._here}')
        if estimate.time - trajectory.end > self.settings.rest_timeout / self._bandwidth:
            return self._ended(
                Outcome.NOT_HELD,
                f'the wall does not come to rest within {self.settings.tolerance:g} rotor '
                f'spacings of {self.orbit.site(trajectory.goal):.3f}; it is held at {self._here}',
            )
        return None

    @property
    def _here(self) -> str:
        return 'no place' if self.wall is None else f'rotor {self.wall.place:.3f}'

    def _ended(self, outcome: Outcome, message: str) -> MoveResult:
        self._moving = False
        return MoveResult(outcome, message, math.nan if self.wall is None else self.wall.place)

    def _lost(self, message: str) -> MoveResult | None:
        held = self.holding
        self.release()
        return self._ended(Outcome.SOLITON_LOST, f'{message}; it is let go') if held else None

    def _refusal(
        self, place: float, speed: float, estimate: WallEstimate | None
    ) -> MoveResult | None:
        last = self.orbit.chain.number_of_rotors - 1
        here = math.nan if self.wall is None else self.wall.place
        if not 0 <= place <= last:
            return MoveResult(
                Outcome.OUT_OF_CHAIN,
                f'rotor = {place:g} must lie in the range 0 to {last}; name a place in the chain',
                here,
            )
        if not (math.isfinite(speed) and speed >= 0):
            return MoveResult(
                Outcome.INVALID_SPEED,
                f'speed = {speed:g} rotor spacings per second must be a finite number of 0 or '
                f'more; 0 takes {self.adiabatic_speed:.3g}, the fastest that wakes no phonons',
                here,
            )
        if estimate is None:
            return MoveResult(
                Outcome.NO_SOLITON,
                'the angles show no wall: they are near no configuration of the chain; let it '
                'come to rest, or check its parameters',
                here,
            )
        return None

    def _out_of_reach(
        self, place: float, estimate: WallEstimate, trajectory: ReferenceTrajectory
    ) -> MoveResult | None:
        force = self.settings.force_reserve * self._inertia * trajectory.strongest
        if self.allocation.carries(estimate.arc, trajectory.goal, force):
            return None
        reach = self.allocation.reach(estimate.arc, force)
        here = self.orbit.site(estimate.arc)
        able = (
            f'they do not get hold of a wall at rotor {here:.2f}'
            if math.isnan(reach.first)
            else f'from rotor {here:.2f} they carry it from {reach.first:.2f} to {reach.last:.2f}'
        )
        return MoveResult(
            Outcome.OUT_OF_REACH,
            f'rotor = {place:g} is out of reach of the actuators: {able} with torques up to '
            f'{self.allocation.torque_limit:g} N m and springs that give way by up to '
            f'{self.allocation.strain_limit:g} rad; actuate more rotors, or go more slowly',
            here,
        )
