# SPDX-License-Identifier: Apache-2.0
"""Simulations of driven chains: energy balance, limit of stiff springs, and tilt."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.actuation.actuators import PneumaticActuator
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
from soliton_linkage_studies.moves import DISORDERED, MoveKey, MoveTask, numbered_tasks, read_moves
from soliton_linkage_studies.settings import Section, setting

_KEYS = ('step', 'work', 'energy_balance', 'stiffness', 'tilt', 'moves')
_WORK_PERIOD = 0.002
"""Frame period of a chain with an actuator [s], a small fraction of the filling time of the
actuator."""


@dataclass(frozen=True)
class DrivingStudy:
    """Simulations that a settings file specifies."""

    step: Profile
    """Commanded pressure [Pa] over time [s]."""
    works: dict[str, partial[DrivenChain]]
    """Tasks by actuator name; in each, a pneumatic actuator drives the first edge of a chain."""
    balances: dict[str, BalanceTask]
    """Checks of the energy balance, for springs ('elastic') and for bars ('rigid')."""
    stiffnesses: list[StiffnessTask]
    tilts: dict[str, TiltTask]
    """Simulations of a tilted chain, with springs ('elastic') and with bars ('rigid')."""
    moves: dict[MoveKey, list[MoveTask]]
    """Tasks by chain name and condition name."""

    @property
    def tasks(self) -> dict[tuple[Any, ...], Callable[[], Any]]:
        """All tasks, the longest first. A key is the panel and the name or number of the task."""
        stiffest_first = dict(reversed(list(enumerate(self.stiffnesses))))
        panels: dict[str, Mapping[Any, Callable[[], Any]]] = {
            'e': numbered_tasks(self.moves),
            'c': stiffest_first,
            'b': self.balances,
            'd': self.tilts,
            'f': self.works,
        }
        return {(panel, key): tasks[key] for panel, tasks in panels.items() for key in tasks}


def read_driving_study(settings: Section, quick: bool) -> DrivingStudy:
    """Return the study of a settings file. Raises ValueError for invalid settings."""
    settings.check_keys(*_KEYS)
    balance, tilt = settings.section('energy_balance'), settings.section('tilt')
    balances = {name: BalanceTask.read(balance, name) for name in MECHANICS}
    step, moves = settings.section('step'), read_moves(settings.section('moves'), quick)
    step.check_keys('pressure', 'duration')
    pressure = step.number('pressure', 1.0, PneumaticActuator().highest_pressure)
    if quick:
        balances = {name: replace(task, duration=1.0) for name, task in balances.items()}
        moves = {key: tasks[:1] for key, tasks in moves.items()}
    return DrivingStudy(
        trapezoid(pressure, 0.0, step.number('duration', 0.01, 10.0), 0.0),
        _works(settings.section('work')),
        balances,
        StiffnessTask.read(settings.section('stiffness'), quick),
        {name: TiltTask.read(tilt, name) for name in MECHANICS},
        moves,
    )


def _works(section: Section) -> dict[str, partial[DrivenChain]]:
    section.check_keys('chain', 'pressure', 'duration', 'ramp', 'saturation_torque')
    actuator, order = PneumaticActuator(), read_command(section)
    largest = section.number('saturation_torque', 1e-9, 1e6)
    actuators = {
        'below saturation': actuator,
        'saturated': replace(actuator, saturation_torque=largest),
    }
    chain = section.chain()
    return {
        name: partial(driven_chain, chain, each, order, _WORK_PERIOD)
        for name, each in actuators.items()
    }


MECHANICS: dict[str, type[Simulation]] = {'elastic': ElasticSimulation, 'rigid': RigidSimulation}

_PERIOD = 0.01
"""Frame period for energy balance and tilt [s]."""
_BALANCE_TOLERANCE = 1e-12
"""Largest integration error of an angle per time unit [rad]; a thousandth of `IMBALANCE_LIMIT`."""
_TILT_TOLERANCE = 1e-8
"""Largest integration error of an angle per time unit [rad]; such errors are invisible in the
picture."""
_EVENT_FRAMES = 30
"""Number of frames in a cycle of events [1]. Each cycle contains one kick and one change of
gravity. Torques act in every second cycle."""
_KICK_FRAME = 10
"""Index of the frame in a cycle at which the kick occurs [1]."""
_TURN_FRAME = 20
"""Index of the frame in a cycle at which gravity changes [1], well after the kick."""
_CROSSING_FRAMES = 200
"""Number of frames of a simulated crossing [1], so that a wall moves by less than a spacing per
frame."""


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
    velocity: float = setting('initial velocity of the wall', 'm/s', -100.0, 100.0)
    gravity: float = setting('gravitational acceleration', 'm/s^2', 0.0, 1e3)
    tilt: float = setting('largest tilt', 'rad', 0.0, 3.2)
    kick: float = setting('standard deviation of the rate from a kick', 'rad/s', 0.0, 1e3)
    torque: float = setting('standard deviation of torque / inertia', 'rad/s^2', 0.0, 1e6)
    duration: float = setting('duration of the simulation', 's', 30 * _PERIOD, 1e3)
    seed: int = setting('random seed of deviations, kicks, torques and tilts', '', 0, 2**31)

    @staticmethod
    def read(section: Section, mechanics: str) -> BalanceTask:
        """Read the settings, and draw the random deviations of the chain."""
        bare = section.chain()
        shares = dict.fromkeys(DISORDERED, section.number('disorder', 0.0, 0.3))
        position = section.number('position', 0.0, bare.number_of_rotors - 1)
        values = section.values_of(BalanceTask, 'chain', 'disorder', 'position')
        drawn = drawn_deviations(bare.number_of_rotors, values['seed'], periodic=False, **shares)
        return BalanceTask(replace(bare, deviations=drawn), mechanics, position, **values)

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
        """Return the largest difference of an angle between springs and bars [rad]."""
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
    """Wall position: sum of n e_n^2 over all rotors n with the zero mode e of norm 1 [rotor
    spacings], shape (T,)."""


@dataclass(frozen=True)
class TiltTask:
    """Task to tilt a chain back and forth; it starts at rest in the left-leaning state."""

    chain: Chain
    mechanics: str
    gravity: float = setting('gravitational acceleration', 'm/s^2', 0.0, 1e3)
    tilts: tuple[float, ...] = setting('tilts in the order of time', 'rad', -3.2, 3.2)
    kept: float = setting('duration of each tilt', 's', _PERIOD, 1e3)

    @staticmethod
    def read(section: Section, mechanics: str) -> TiltTask:
        """Read the settings."""
        return TiltTask(section.chain(), mechanics, **section.values_of(TiltTask, 'chain'))

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
