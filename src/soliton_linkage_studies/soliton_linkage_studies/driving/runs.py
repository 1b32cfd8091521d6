# SPDX-License-Identifier: Apache-2.0
"""Chains that are driven in simulations: their energy balance, their bars, and their tilt."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.profile import Profile, trapezoid
from soliton_linkage.dynamics.elastic import ElasticSimulation, simulate
from soliton_linkage.dynamics.initial_states import leaning, with_soliton
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.dynamics.work import work_of_kick, work_of_torques
from soliton_linkage.linear.rigidity import Edge, mode_centre, zero_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.solitons.track import find_crossings, follow
from soliton_linkage_studies.experiments import kick_rates
from soliton_linkage_studies.figures.actuator import DrivenChain, driven_chain
from soliton_linkage_studies.moves import (
    MoveKey,
    MoveRun,
    MoveStudy,
    MoveTask,
    read_move_study,
    runs_by_key,
)
from soliton_linkage_studies.settings import Section, chain_from

_KEYS = ('step', 'work', 'energy_balance', 'stiffness', 'tilt', 'moves')
_WORK_PERIOD = 0.002
"""Of the frames in which an actuator drives a chain [s]: tens of a filling time."""
_SHORT = 1.0
"""How long a quick study balances energies [s]: three times all that acts at random."""


@dataclass(frozen=True)
class WorkTask:
    """A chain that an actuator drives by a pressure at its first edge."""

    chain: Chain
    actuator: PneumaticActuator
    order: EdgeCommand

    def __call__(self) -> DrivenChain:
        """Simulate it."""
        return driven_chain(self.chain, self.actuator, self.order, _WORK_PERIOD)


@dataclass(frozen=True)
class DrivingStudy:
    """What a file of settings asks for."""

    step: Profile
    """Commanded pressure [Pa] over time [s]."""
    works: dict[str, WorkTask]
    """By actuator."""
    balances: dict[str, BalanceTask]
    """By mechanics."""
    stiffnesses: list[StiffnessTask]
    tilts: dict[str, TiltTask]
    """By mechanics."""
    moves: dict[MoveKey, list[MoveTask]]
    """By the names of chain and condition."""

    @property
    def tasks(self) -> dict[tuple[Any, ...], Callable[[], Any]]:
        """All that is to be simulated, the longest first, by keys of their own."""
        stiffest_first = reversed(list(enumerate(self.stiffnesses)))
        return {
            **{('moves', *key): task for key, task in MoveStudy(self.moves).numbered.items()},
            **{('apart', number): task for number, task in stiffest_first},
            **{('balances', name): task for name, task in self.balances.items()},
            **{('tilts', name): task for name, task in self.tilts.items()},
            **{('works', name): task for name, task in self.works.items()},
        }


@dataclass(frozen=True)
class Results:
    """What came of a study, by the same keys and in the same order."""

    works: dict[str, DrivenChain]
    balances: dict[str, BalancedRun]
    apart: list[float]
    """Largest distance of springs from bars [rad], softest first."""
    tilts: dict[str, TiltedRun]
    moves: dict[MoveKey, list[MoveRun]]

    @staticmethod
    def of(done: Mapping[tuple[Any, ...], Any]) -> Results:
        """Results of `DrivingStudy.tasks` by their keys."""

        def part(name: str) -> dict[Any, Any]:
            return {key[1:]: result for key, result in done.items() if key[0] == name}

        def named(name: str) -> dict[str, Any]:
            return {key: result for (key,), result in part(name).items()}

        apart = sorted(part('apart').items())
        return Results(
            named('works'),
            named('balances'),
            [distance for _, distance in apart],
            named('tilts'),
            runs_by_key(part('moves')),
        )


def read_driving_study(settings: Section, quick: bool) -> DrivingStudy:
    """DrivingStudy of a file of settings; raises ValueError for what cannot be."""
    settings.check_keys(*_KEYS)
    balances = {
        name: BalanceTask.read(settings.section('energy_balance'), name) for name in MECHANICS
    }
    moves = read_move_study(settings.section('moves'), quick).tasks
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
    actuator = PneumaticActuator()
    pressure = section.number('pressure', 1.0, actuator.highest_pressure)
    duration = section.number('duration', 0.01, 10.0)
    ramp = section.number('ramp', 0.0, 10.0)
    order = EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, pressure, duration, ramp, ramp)
    saturating = replace(
        actuator, saturation_torque=section.number('saturation_torque', 1e-9, 1e6)
    )
    chain = chain_from(section.section('chain'))
    return {
        'below saturation': WorkTask(chain, actuator, order),
        'saturated': WorkTask(chain, saturating, order),
    }


MECHANICS: dict[str, type[Simulation]] = {'elastic': ElasticSimulation, 'rigid': RigidSimulation}

_BALANCE_KEYS = (
    'chain',
    'disorder',
    'place',
    'velocity',
    'gravity',
    'tilt',
    'kick',
    'torque',
    'duration',
    'seed',
)
_DISORDERED = ('spacing', 'rotor_length', 'mass', 'stiffness', 'rest_length')
_PERIOD = 0.01
"""Of the frames of chains that are balanced and tilted [s], a fraction of their time unit."""
_BALANCE_TOLERANCE = 1e-12
"""Error of the angles in a time unit [rad]: a thousandth of the imbalance that is allowed."""
_TILT_TOLERANCE = 1e-8
"""Error of the angles in a time unit [rad], far below what places of walls are told to."""
_EVENT_FRAMES = 30
"""From kick to kick, and from turn to turn; torques act in every other of these spans."""
_KICK_FRAME = 10
"""Of a span, in which there is a kick: neither when torques begin nor when gravity turns."""
_TURN_FRAME = 20
"""Of a span, in which gravity turns: as far from the kicks on both sides."""
_CROSSING_FRAMES = 200
"""In which springs and bars are compared: none of them moves a wall by a spacing."""


@dataclass(frozen=True)
class BalancedRun:
    """The energy balance of a run, frame by frame."""

    times: Array
    """Instants of the frames [s], shape (T,)."""
    imbalances: Array
    """Energy missing or too much, over the largest so far [1], shape (T,)."""
    kicks: Array
    """When there were impulses [s], shape (kicks,)."""
    turns: Array
    """When gravity turned [s], shape (turns,)."""
    pushed: NDArray[np.bool_]
    """Whether torques acted on the way to each frame, shape (T,)."""


@dataclass(frozen=True)
class BalanceTask:
    """A wall that is kicked, pushed, tilted and damped at random while its energy is balanced."""

    chain: Chain
    mechanics: str
    place: float
    """Of the wall at the start [rotor spacings]."""
    velocity: float
    """Of the wall at the start [m/s]."""
    gravity: float
    """[m/s^2]."""
    tilt: float
    """The largest [rad]."""
    kick: float
    """Standard deviation of an impulse over the moment of inertia [rad/s]."""
    torque: float
    """Standard deviation of a torque over the moment of inertia [rad/s^2]."""
    duration: float
    """[s]."""
    seed: int

    @staticmethod
    def read(section: Section, mechanics: str) -> BalanceTask:
        """Read the settings, and draw the disorder of the chain."""
        section.check_keys(*_BALANCE_KEYS)
        bare = chain_from(section.section('chain'))
        share = section.number('disorder', 0.0, 0.3)
        seed = section.whole_number('seed', 0, 2**31)
        shares = dict.fromkeys(_DISORDERED, share)
        drawn = drawn_deviations(bare.number_of_rotors, seed, periodic=False, **shares)
        return BalanceTask(
            replace(bare, deviations=drawn),
            mechanics,
            section.number('place', 0.0, bare.number_of_rotors - 1),
            section.number('velocity', -100.0, 100.0),
            section.number('gravity', 0.0, 1e3),
            section.number('tilt', 0.0, 3.2),
            section.number('kick', 0.0, 1e3),
            section.number('torque', 0.0, 1e6),
            section.number('duration', 30 * _PERIOD, 1e3),
            seed,
        )

    def __call__(self) -> BalancedRun:
        """Simulate it."""
        chain = self.chain
        state = with_soliton(chain, self.place, self.velocity)
        simulation = MECHANICS[self.mechanics](
            chain, state.angles, state.rates, _PERIOD, _BALANCE_TOLERANCE, Gravity(self.gravity)
        )
        balance = EnergyBalance(simulation)
        random = np.random.default_rng(self.seed)
        imbalances, kicks, turns, pushed = [], [], [], []
        for frame in range(round(self.duration / _PERIOD)):
            normal = chain.moments_of_inertia * random.standard_normal(chain.number_of_rotors)
            if frame % _EVENT_FRAMES == _KICK_FRAME:
                balance.kick(self.kick * normal)
                kicks.append(simulation.time)
            if frame % _EVENT_FRAMES == _TURN_FRAME:
                balance.turn(Gravity(self.gravity, random.uniform(-self.tilt, self.tilt)))
                turns.append(simulation.time)
            pushed.append(frame // _EVENT_FRAMES % 2 == 1)
            balance.advance(pushed[-1] * self.torque * normal)
            imbalances.append(balance.imbalance)
        times = np.linspace(_PERIOD, simulation.time, len(imbalances))
        return BalancedRun(
            times, np.array(imbalances), np.array(kicks), np.array(turns), np.array(pushed)
        )


@dataclass(frozen=True)
class StiffnessTask:
    """The first crossing of a wall among springs, beside the same among bars."""

    chain: Chain
    """With the stiffness of the springs."""
    rates: tuple[float, ...]
    """After the kick of the right-leaning chain at rest [rad/s], of each rotor."""
    duration: float
    """Within which the wall must have crossed [s]."""

    @staticmethod
    def read(section: Section, quick: bool) -> list[StiffnessTask]:
        """Read the settings; a task for each stiffness, softest first."""
        section.check_keys('chain', 'kick', 'duration', 'factors')
        chain = chain_from(section.section('chain'))
        kick = section.number('kick', 1e-6, 100.0)
        rates = tuple(kick_rates(chain, chain.uniform_state(1), kick).tolist())
        duration = section.number('duration', 1e-6, 1e6)
        factors = section.numbers('factors', 1.0, 1e9)
        if len(factors) < 4:
            raise section.error('factors', 'must be 4 numbers or more; add larger ones')
        return [
            StiffnessTask(replace(chain, stiffness=chain.stiffness * factor), rates, duration)
            for factor in sorted(factors)[: -1 if quick else None]
        ]

    def __call__(self) -> float:
        """Largest distance of an angle from that among bars until the wall has crossed [rad]."""
        chain, rates = self.chain, np.array(self.rates)
        rest = chain.uniform_state(1)
        period = self.duration / _CROSSING_FRAMES
        bars = RigidSimulation(chain, rest, rates, period).record(self.duration)
        crossings = find_crossings(chain, follow(chain, bars))
        if not crossings:
            raise ValueError(
                f'stiffness.duration = {self.duration:g} s is too short for the wall to cross; '
                'make it longer, or kick harder'
            )
        springs = simulate(chain, rest, rates, self.duration, period)
        crossing = springs.times <= crossings[0].end
        return float(np.abs(springs.angles - bars.angles)[crossing].max())


@dataclass(frozen=True)
class TiltedRun:
    """A wall that falls to and fro, frame by frame."""

    times: Array
    """Instants of the frames [s], shape (T,)."""
    tilts: Array
    """In force from each frame to the next [rad], shape (T,)."""
    places: Array
    """Centre of the zero mode [rotor spacings], shape (T,)."""


@dataclass(frozen=True)
class TiltTask:
    """A chain that is at rest, leans left, and is tilted to and fro under gravity."""

    chain: Chain
    mechanics: str
    gravity: float
    """[m/s^2]."""
    tilts: tuple[float, ...]
    """One after the other [rad]."""
    kept: float
    """How long each lasts [s]."""

    @staticmethod
    def read(section: Section, mechanics: str) -> TiltTask:
        """Read the settings."""
        section.check_keys('chain', 'gravity', 'tilts', 'kept')
        return TiltTask(
            chain_from(section.section('chain')),
            mechanics,
            section.number('gravity', 0.0, 1e3),
            section.numbers('tilts', -3.2, 3.2),
            section.number('kept', _PERIOD, 1e3),
        )

    def __call__(self) -> TiltedRun:
        """Simulate it."""
        chain = self.chain
        simulation = MECHANICS[self.mechanics](
            chain, leaning(chain, -1).angles, None, _PERIOD, _TILT_TOLERANCE
        )
        frames = []
        for tilt in self.tilts:
            simulation.set_gravity(Gravity(self.gravity, tilt))
            for _ in range(round(self.kept / _PERIOD)):
                place = mode_centre(zero_mode(chain, simulation.angles))
                frames.append((simulation.time, tilt, place))
                simulation.advance()
        return TiltedRun(*np.array(frames).T)


class EnergyBalance:
    """Acts on a simulation, and holds the work of all that acts against the energy of its frames.

    E(t) = E(0) + sum of W - D,    E = kinetic + elastic + gravitational energy,

    where gravity that turns at an instant does as work what the masses then are higher in it, and
    damping takes D. Rigid bars hold no energy.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Begin with the energy of the current frame."""
        self.simulation = simulation
        self._start = simulation.energy
        self._given = 0.0
        self._largest = abs(self._start)
        self._dissipated_before = simulation.dissipated

    @property
    def imbalance(self) -> float:
        """Energy that is missing or too much, over the largest in any frame so far [1]."""
        energy = self.simulation.energy
        taken = self.simulation.dissipated - self._dissipated_before
        missing = self._start + self._given - taken - energy
        largest = max(self._largest, abs(energy))
        return abs(missing) / largest if largest else 0.0

    def kick(self, impulses: Array) -> None:
        """Apply angular impulses [N m s], shape (N,); bars bear what is not along the mode."""
        before = self.simulation.rates
        self.simulation.kick(impulses)
        self._given += work_of_kick(impulses, before, self.simulation.rates)

    def turn(self, gravity: Gravity) -> None:
        """Change gravity at the instant of the current frame."""
        before = self.simulation.energy
        self.simulation.set_gravity(gravity)
        self._given += self.simulation.energy - before

    def advance(self, torques: Array) -> None:
        """Go on by a period under torques [N m], shape (N,)."""
        before = self.simulation.angles
        self.simulation.hold(torques)
        self.simulation.advance()
        self._given += work_of_torques(torques, self.simulation.angles - before)
        self._largest = max(self._largest, abs(self.simulation.energy))
