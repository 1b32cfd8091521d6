# SPDX-License-Identifier: Apache-2.0
"""Walls under torques that are held from frame to frame, with rigid bars and with springs."""

import numpy as np
from orbits import uniform_orbit

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings
from soliton_linkage.steering.steering import MoveResult, Outcome, Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation

ROTORS = 10
PERIOD = 0.01
SEEN = 0.2
"""Time for which a loop observes a wall before its first move [s]."""


class RigidWall:
    """The one degree of freedom of rigid bars, I s'' = t . tau + I d."""

    def __init__(
        self, orbit: UniformOrbit, arc: float, rate: float = 0.0, disturbance: float = 0.0
    ) -> None:
        self.orbit, self.arc, self.rate, self.disturbance = orbit, arc, rate, disturbance

    @property
    def place(self) -> float:
        return self.orbit.site(self.arc)

    def frame(self) -> Array:
        return self.orbit.configuration(self.arc)

    def go_on(self, torques: Array, period: float) -> None:
        """Hold torques [N m] for a period [s]."""
        force = float(self.orbit.tangent(self.arc) @ torques)
        acceleration = force / self.orbit.chain.moment_of_inertia + self.disturbance
        self.arc += (self.rate + acceleration * period / 2) * period
        self.rate += acceleration * period


class SpringWall:
    """Chain of springs; the nearest point of the orbit gives the position of its wall."""

    def __init__(self, simulation: ElasticSimulation) -> None:
        self.simulation = simulation

    def frame(self) -> Array:
        return self.simulation.angles

    def go_on(self, torques: Array, period: float) -> None:
        assert period == self.simulation.period
        self.simulation.hold(torques)
        self.simulation.advance()


class Loop:
    """A steering around a wall; torques act so many frames after theirs."""

    def __init__(
        self,
        steering: Steering,
        wall: RigidWall | SpringWall,
        period: float = 0.01,
        noise: float = 0.0,
        delay: int = 1,
        seed: int = 0,
    ) -> None:
        self.steering, self.wall, self.period = steering, wall, period
        self.frames = 0
        self.ended: MoveResult | None = None
        self.torques = np.zeros(steering.orbit.chain.number_of_rotors)
        self._noise, self._random = noise, np.random.default_rng(seed)
        self._waiting = [np.zeros(steering.orbit.chain.number_of_rotors)] * delay

    @property
    def time(self) -> float:
        return self.frames * self.period

    def step(self) -> None:
        """One frame, and the wall's motion until the next."""
        frame = self.wall.frame()
        seen = frame + self._noise * self._random.standard_normal(len(frame))
        ended = self.steering.observe(self.time, seen)
        self.ended = self.ended if ended is None else ended
        self.torques = self.steering.torques()
        self._waiting.append(self.torques)
        self.wall.go_on(self._waiting.pop(0), self.period)
        self.frames += 1

    def go_on(self, seconds: float) -> None:
        for _ in range(round(seconds / self.period)):
            self.step()

    def miss(self, seconds: float) -> None:
        """Advance without a frame, under the last torques."""
        for _ in range(round(seconds / self.period)):
            self.wall.go_on(self.torques, self.period)
            self.frames += 1

    def until_ended(self, longest: float = 60.0) -> MoveResult:
        self.ended = None
        limit = self.time + longest
        while self.ended is None:
            assert self.time < limit
            self.step()
        return self.ended


def steering_of(orbit: Orbit, settings: SteeringSettings = DEFAULTS) -> Steering:
    return Steering(orbit, TorqueAllocation(orbit, torque_limit=0.1), settings)


def rigid_loop(
    example: tuple[float, float],
    place: float,
    settings: SteeringSettings = DEFAULTS,
    disturbance: float = 0.0,
    period: float = PERIOD,
    **options: float,
) -> tuple[Loop, RigidWall]:
    """Return a loop that has observed a rigid-bar wall for a while, and the wall."""
    orbit = uniform_orbit(example, ROTORS)
    wall = RigidWall(orbit, orbit.arc_at(place, 0), disturbance=disturbance)
    loop = Loop(steering_of(orbit, settings), wall, period, **options)
    loop.go_on(SEEN)
    return loop, wall


def move_to(loop: Loop, goal: float) -> None:
    """Move the wall to a goal, which it must reach."""
    assert loop.steering.move(goal) is None
    assert loop.until_ended().outcome is Outcome.REACHED
