# SPDX-License-Identifier: Apache-2.0
"""Walls carried along simulated chains of springs, and what became of them.

The place of a wall is that of the nearest point of the orbit of the chain without deviations,
to the angles without their noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.estimation.nearest_point import fit_anywhere, fit_near
from soliton_linkage.linear.normal_modes import phonon_energy
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.passage import blocked_bonds
from soliton_linkage.steering.steering import Ended, Outcome, Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation

MoveKey = tuple[str, str]
"""Names of a chain and of the condition that it is in."""

_TOLERANCE = 1e-8
"""Error of the angles in a time unit [rad], far below the noise and the errors of a move."""
_SEEN_BEFORE = 0.2
"""How long the steering sees a wall at rest before it is given a goal [s]."""
_LONGEST = 120.0
"""After which a move that has not ended counts as not held [s]."""
_SAMPLE_EVERY = 20
"""Frames from sample to sample: 80 ms at 250 Hz, which a picture resolves."""
_DRAWS = 100
"""Draws of a disorder, of which one is to let the wall pass."""


@dataclass(frozen=True)
class Condition:
    """What a chain and its encoders are like."""

    noise: float
    """Standard deviation of an angle [rad]."""
    decay: float
    """Rate at which the motion of a rotor alone dies [1/s]."""
    disorder: float
    """Standard deviation of lengths, masses and stiffnesses, as a fraction."""


@dataclass(frozen=True)
class MoveTask:
    """A move to be made."""

    chain: Chain
    condition: Condition
    start: float
    """Place that the wall is taken from [rotor spacings]."""
    goal: float
    """Place that it is taken to [rotor spacings]."""
    seed: int
    frame_rate: float
    """[Hz]."""
    held: float
    """How long it is watched after its arrival [s]."""
    torque_limit: float
    """Of an actuator [N m]."""

    def __call__(self) -> MoveRun:
        """Make the move."""
        return made(self)


@dataclass(frozen=True)
class MoveRun:
    """A move that was made, sampled every few frames from its beginning."""

    outcome: Outcome
    duration: float
    """From the goal to the arrival [s]."""
    times: Array
    """Since the goal was given [s], shape (T,)."""
    places: Array
    """Of the wall [rotor spacings], shape (T,)."""
    aims: Array
    """Where its reference trajectory has the wall [rotor spacings], (T,), NaN without one."""
    phonon_energies: Array
    """[J], shape (T,)."""
    error: float
    """Largest distance from the goal after the arrival [rotor spacings], NaN where it failed."""
    energy_left: float
    """Energy of the phonons at the end [J]."""
    peak_energy: float
    """Largest kinetic energy on the way [J]."""


def made(task: MoveTask) -> MoveRun:
    """Make a move, in frames that torques follow one frame later."""
    orbit = UniformOrbit(task.chain)
    chain, start = _started(task, orbit)
    simulation = ElasticSimulation(chain, start, period=1 / task.frame_rate, tolerance=_TOLERANCE)
    steering = Steering(orbit, TorqueAllocation(orbit, torque_limit=task.torque_limit))
    random = np.random.default_rng(task.seed)
    samples: list[tuple[float, float, float, float]] = []
    ended: Ended | None = None
    arc, arrival, peak = math.nan, math.nan, 0.0
    begin = round(_SEEN_BEFORE * task.frame_rate)
    torques = np.zeros(chain.number_of_rotors)
    for frame in range(round(_LONGEST * task.frame_rate)):
        seen = simulation.angles + task.condition.noise * random.standard_normal(len(torques))
        ended = steering.observe(simulation.time, seen) or ended
        if frame == begin:
            ended = steering.move(task.goal)
            arc = fit_anywhere(orbit, simulation.angles).arc
        since = (frame - begin) / task.frame_rate
        if ended is not None and math.isnan(arrival):
            arrival = since
        if frame >= begin and (frame - begin) % _SAMPLE_EVERY == 0:
            arc = fit_near(orbit, simulation.angles, arc).arc
            left = phonon_energy(chain, simulation.angles, simulation.rates)
            trajectory = steering.trajectory
            point = orbit.place(trajectory.at(simulation.time).arc) if trajectory else math.nan
            samples.append((since, orbit.place(arc), point, left))
        if since > arrival + task.held:
            break
        simulation.hold(torques)
        torques = steering.torques()
        simulation.advance()
        peak = max(peak, float(chain.kinetic_energy(simulation.rates)))
    times, places, aims, energies = np.array(samples).T
    reached = ended is not None and ended.outcome is Outcome.REACHED
    error = float(np.abs(places[times >= arrival] - task.goal).max()) if reached else math.nan
    outcome = Outcome.NOT_HELD if ended is None else ended.outcome
    return MoveRun(
        outcome, arrival, times, places, aims, energies, error, float(energies[-1]), peak
    )


def _started(task: MoveTask, orbit: UniformOrbit) -> tuple[Chain, Array]:
    """Chain with the damping and disorder of the task, at rest with its wall at the start.

    In place of deviations that may stop a wall, or do not let it be there, others are drawn.
    """
    damping = task.condition.decay * task.chain.moment_of_inertia
    chain = replace(task.chain, damping=damping)
    leg = task.seed % orbit.number_of_legs
    wall = orbit.configuration(orbit.arc_at(task.start, leg))
    if not task.condition.disorder:
        return chain, wall
    share = task.condition.disorder
    for draw in range(_DRAWS):
        drawn = drawn_deviations(
            chain.number_of_rotors,
            _DRAWS * task.seed + draw,
            spacing=share,
            rotor_length=share,
            mass=share,
            stiffness=share,
            rest_length=share,
        )
        disordered = replace(chain, deviations=drawn)
        if blocked_bonds(disordered).any():
            continue
        try:
            return disordered, unstretched(disordered, wall)
        except ValueError:
            continue
    raise ValueError(
        f'no chain of {task.chain.motion.value}s with a disorder of {task.condition.disorder:g} '
        f'lets a wall pass that begins at {task.start:.2f}, in {_DRAWS} draws; lower the '
        'disorder'
    )
