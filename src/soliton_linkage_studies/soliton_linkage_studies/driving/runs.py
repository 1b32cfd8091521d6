# SPDX-License-Identifier: Apache-2.0
"""Simulations of driven chains: energy balance, limit of stiff springs, and tilt."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.actuation.edge_command import EdgeCommand
from soliton_linkage.actuation.profile import Profile, trapezoid
from soliton_linkage.dynamics.elastic import ElasticSimulation, simulate
from soliton_linkage.dynamics.initial_states import leaning, with_soliton
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linear.rigidity import mode_centre, zero_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.solitons.track import find_crossings, follow
from soliton_linkage_studies.experiments import kick_rates
from soliton_linkage_studies.figures.actuator import DrivenChain, driven_chain, read_command
from soliton_linkage_studies.moves import (
    DISORDERED,
    MoveKey,
    MoveRun,
    MoveTask,
    numbered_tasks,
    read_moves,
    runs_by_key,
)
from soliton_linkage_studies.settings import Section

_KEYS = ('step', 'work', 'energy_balance', 'stiffness', 'tilt', 'moves')
_WORK_PERIOD = 0.002
"""Frame period of a chain with an actuator [s], a small fraction of the filling time."""
_SHORT = 1.0
"""Duration of the energy balance with `--quick` [s]."""


@dataclass(frozen=True)
class WorkTask:
    """Task to drive a chain at its first edge with a pneumatic actuator."""

    chain: Chain
    actuator: PneumaticActuator
    order: EdgeCommand

    def __call__(self) -> DrivenChain:
        """Run the simulation."""
        return driven_chain(self.chain, self.actuator, self.order, _WORK_PERIOD)


@dataclass(frozen=True)
class DrivingStudy:
    """Simulations that a settings file specifies."""

    step: Profile
    """Commanded pressure [Pa] over time [s]."""
    works: dict[str, WorkTask]
    """Tasks by actuator name."""
    balances: dict[str, BalanceTask]
    """One task for springs ('elastic') and one for bars ('rigid')."""
    stiffnesses: list[StiffnessTask]
    tilts: dict[str, TiltTask]
    """One task for springs ('elastic') and one for bars ('rigid')."""
    moves: dict[MoveKey, list[MoveTask]]
    """Tasks by chain name and condition name."""

    @property
    def tasks(self) -> dict[tuple[Any, ...], Callable[[], Any]]:
        """All tasks, each with a unique key; the longest tasks come first."""
        stiffest_first = reversed(list(enumerate(self.stiffnesses)))
        return {
            **{('moves', *key): task for key, task in numbered_tasks(self.moves).items()},
            **{('apart', number): task for number, task in stiffest_first},
            **{('balances', name): task for name, task in self.balances.items()},
            **{('tilts', name): task for name, task in self.tilts.items()},
            **{('works', name): task for name, task in self.works.items()},
        }


@dataclass(frozen=True)
class Results:
    """Results of the tasks of a `DrivingStudy`, with the same keys as these."""

    works: dict[str, DrivenChain]
    balances: dict[str, BalancedRun]
    apart: list[float]
    """Largest angle difference between springs and bars [rad], in ascending order of stiffness."""
    tilts: dict[str, TiltedRun]
    moves: dict[MoveKey, list[MoveRun]]

    @staticmethod
    def of(done: Mapping[tuple[Any, ...], Any]) -> Results:
        """Sort results into fields by their keys, which are as in `DrivingStudy.tasks`."""

        def part(name: str) -> dict[Any, Any]:
            return {key[1:]: result for key, result in done.items() if key[0] == name}

        def named(name: str) -> dict[str, Any]:
            return {key: result for (key,), result in part(name).items()}

        apart = [distance for _, distance in sorted(part('apart').items())]
        moves = runs_by_key(part('moves'))
        return Results(named('works'), named('balances'), apart, named('tilts'), moves)


def read_driving_study(settings: Section, quick: bool) -> DrivingStudy:
    """Return the study of a settings file. Raises ValueError for invalid settings."""
    settings.check_keys(*_KEYS)
    balances = {
        name: BalanceTask.read(settings.section('energy_balance'), name) for name in MECHANICS
    }
    moves = read_moves(settings.section('moves'), quick)
    if quick:
        balances = {name: replace(task, duration=_SHORT) for name, task in balances.items()}
        moves = {key: tasks[:1] for key, tasks in moves.items()}
    return DrivingStudy(
        _step(settings.section('step')),
        _works(settings.section('work')),
        balances,
        StiffnessTask.read(settings.section('stiffness'), quick),
        {name: TiltTask.read(settings.section('tilt'), name) for name in MECHANICS},
        moves,
    )


def _step(section: Section) -> Profile:
    section.check_keys('pressure', 'duration')
    pressure = section.number('pressure', 1.0, PneumaticActuator().highest_pressure)
    return trapezoid(pressure, 0.0, section.number('duration', 0.01, 10.0), 0.0)


def _works(section: Section) -> dict[str, WorkTask]:
    section.check_keys('chain', 'pressure', 'duration', 'ramp', 'saturation_torque')
    actuator, order = PneumaticActuator(), read_command(section)
    largest = section.number('saturation_torque', 1e-9, 1e6)
    actuators = {
        'below saturation': actuator,
        'saturated': replace(actuator, saturation_torque=largest),
    }
    chain = section.chain()
    return {name: WorkTask(chain, each, order) for name, each in actuators.items()}


MECHANICS: dict[str, type[Simulation]] = {'elastic': ElasticSimulation, 'rigid': RigidSimulation}

_BALANCE_KEYS = (
    'chain',
    'disorder',
    'position',
    'velocity',
    'gravity',
    'tilt',
    'kick',
    'torque',
    'duration',
    'seed',
)
_PERIOD = 0.01
"""Frame period for energy balance and tilt [s]."""
_BALANCE_TOLERANCE = 1e-12
"""Largest integration error of an angle per time unit [rad]; a thousandth of `IMBALANCE_LIMIT`."""
_TILT_TOLERANCE = 1e-8
"""Largest integration error of an angle per time unit [rad]; it is invisible in the picture."""
_EVENT_FRAMES = 30
"""Number of frames in a span [1]. Each span contains one kick and one change of gravity; torques
act in every second span."""
_KICK_FRAME = 10
"""Index of the frame in a span at which the kick occurs [1]."""
_TURN_FRAME = 20
"""Index of the frame in a span at which gravity changes [1], far from the kick."""
_CROSSING_FRAMES = 200
"""Number of frames of a simulated crossing [1]; a wall moves by less than a spacing per frame."""


@dataclass(frozen=True)
class BalancedRun:
    """Energy balance of a simulation in each of T frames."""

    times: Array
    """Times of the frames [s], shape (T,)."""
    imbalances: Array
    """Absolute value of `Simulation.energy_drift` [1], shape (T,)."""
    kicks: Array
    """Times of the impulses [s], shape (kicks,)."""
    turns: Array
    """Times of the gravity changes [s], shape (turns,)."""
    pushed: NDArray[np.bool_]
    """Whether torques acted in the frame period before each frame, shape (T,)."""


@dataclass(frozen=True)
class BalanceTask:
    """Task to check the energy balance of a damped chain under random kicks, torques and tilts."""

    chain: Chain
    mechanics: str
    position: float
    """Initial position of the wall [rotor spacings]."""
    velocity: float
    """Initial velocity of the wall [m/s]."""
    gravity: float
    """Gravitational acceleration [m/s^2]."""
    tilt: float
    """Largest tilt [rad]."""
    kick: float
    """Standard deviation of the random rate that a kick adds to each rotor [rad/s]."""
    torque: float
    """Standard deviation of the angular acceleration that the random torques cause [rad/s^2]."""
    duration: float
    """Duration of the simulation [s]."""
    seed: int

    @staticmethod
    def read(section: Section, mechanics: str) -> BalanceTask:
        """Read the settings; draw random deviations of the chain."""
        section.check_keys(*_BALANCE_KEYS)
        bare = section.chain()
        share = section.number('disorder', 0.0, 0.3)
        seed = section.whole_number('seed', 0, 2**31)
        shares = dict.fromkeys(DISORDERED, share)
        drawn = drawn_deviations(bare.number_of_rotors, seed, periodic=False, **shares)
        return BalanceTask(
            replace(bare, deviations=drawn),
            mechanics,
            section.number('position', 0.0, bare.number_of_rotors - 1),
            section.number('velocity', -100.0, 100.0),
            section.number('gravity', 0.0, 1e3),
            section.number('tilt', 0.0, 3.2),
            section.number('kick', 0.0, 1e3),
            section.number('torque', 0.0, 1e6),
            section.number('duration', 30 * _PERIOD, 1e3),
            seed,
        )

    def __call__(self) -> BalancedRun:
        """Run the simulation."""
        chain = self.chain
        state = with_soliton(chain, self.position, self.velocity)
        simulation = MECHANICS[self.mechanics](
            chain, state.angles, state.rates, _PERIOD, _BALANCE_TOLERANCE, Gravity(self.gravity)
        )
        random = np.random.default_rng(self.seed)
        imbalances, kicks, turns, pushed = [], [], [], []
        for frame in range(round(self.duration / _PERIOD)):
            normal = chain.moments_of_inertia * random.standard_normal(chain.number_of_rotors)
            if frame % _EVENT_FRAMES == _KICK_FRAME:
                simulation.kick(self.kick * normal)
                kicks.append(simulation.time)
            if frame % _EVENT_FRAMES == _TURN_FRAME:
                tilt = random.uniform(-self.tilt, self.tilt)
                simulation.set_gravity(Gravity(self.gravity, tilt))
                turns.append(simulation.time)
            pushed.append(frame // _EVENT_FRAMES % 2 == 1)
            simulation.hold(pushed[-1] * self.torque * normal)
            simulation.advance()
            imbalances.append(abs(simulation.energy_drift))
        times = np.linspace(_PERIOD, simulation.time, len(imbalances))
        return BalancedRun(
            times, np.array(imbalances), np.array(kicks), np.array(turns), np.array(pushed)
        )


@dataclass(frozen=True)
class StiffnessTask:
    """Task to compare springs with rigid bars during the first crossing of the wall."""

    chain: Chain
    """Chain whose springs have the tested stiffness."""
    rates: tuple[float, ...]
    """Angular velocities of the right-leaning chain after the kick [rad/s]."""
    duration: float
    """Time limit for the crossing [s]."""

    @staticmethod
    def read(section: Section, quick: bool) -> list[StiffnessTask]:
        """Return one task per stiffness in the settings, in ascending order of stiffness."""
        section.check_keys('chain', 'kick', 'duration', 'factors')
        chain = section.chain()
        kick = section.number('kick', 1e-6, 100.0)
        rates = tuple(kick_rates(chain, chain.uniform_state(1), kick).tolist())
        duration = section.number('duration', 1e-6, 1e6)
        factors = section.numbers('factors', 1.0, 1e9)
        if len(factors) < 4:
            raise section.error('factors', 'must be 4 or more numbers; add larger numbers')
        return [
            StiffnessTask(replace(chain, stiffness=chain.stiffness * factor), rates, duration)
            for factor in sorted(factors)[: -1 if quick else None]
        ]

    def __call__(self) -> float:
        """Return the largest angle difference between springs and bars in the crossing [rad]."""
        chain, rates = self.chain, np.array(self.rates)
        rest = chain.uniform_state(1)
        period = self.duration / _CROSSING_FRAMES
        bars = RigidSimulation(chain, rest, rates, period).record(self.duration)
        crossings = find_crossings(chain, follow(chain, bars))
        if not crossings:
            raise ValueError(
                f'stiffness.duration = {self.duration:g} s is too short for the wall to cross; '
                'increase it, or increase the kick'
            )
        springs = simulate(chain, rest, rates, self.duration, period)
        crossing = springs.times <= crossings[0].end
        return float(np.abs(springs.angles - bars.angles)[crossing].max())


@dataclass(frozen=True)
class TiltedRun:
    """Motion of a wall in a tilted chain, in each of T frames."""

    times: Array
    """Times of the frames [s], shape (T,)."""
    tilts: Array
    """Tilt between each frame and the next one [rad], shape (T,)."""
    positions: Array
    """Wall position: the centre of the zero mode [rotor spacings], shape (T,)."""


@dataclass(frozen=True)
class TiltTask:
    """Task to tilt a chain back and forth, from rest in the left-leaning state."""

    chain: Chain
    mechanics: str
    gravity: float
    """Gravitational acceleration [m/s^2]."""
    tilts: tuple[float, ...]
    """Tilts in the order of time [rad]."""
    kept: float
    """Duration of each tilt [s]."""

    @staticmethod
    def read(section: Section, mechanics: str) -> TiltTask:
        """Read the settings."""
        section.check_keys('chain', 'gravity', 'tilts', 'kept')
        return TiltTask(
            section.chain(),
            mechanics,
            section.number('gravity', 0.0, 1e3),
            section.numbers('tilts', -3.2, 3.2),
            section.number('kept', _PERIOD, 1e3),
        )

    def __call__(self) -> TiltedRun:
        """Run the simulation."""
        chain = self.chain
        simulation = MECHANICS[self.mechanics](
            chain, leaning(chain, -1).angles, None, _PERIOD, _TILT_TOLERANCE
        )
        frames = []
        for tilt in self.tilts:
            simulation.set_gravity(Gravity(self.gravity, tilt))
            for _ in range(round(self.kept / _PERIOD)):
                position = mode_centre(zero_mode(chain, simulation.angles))
                frames.append((simulation.time, tilt, position))
                simulation.advance()
        return TiltedRun(*np.array(frames).T)
