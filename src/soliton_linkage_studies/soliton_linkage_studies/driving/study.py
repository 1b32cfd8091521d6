# SPDX-License-Identifier: Apache-2.0
"""What drives a chain, as a file of settings asks for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import Profile, trapezoid
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_studies.actuators import DrivenChain, driven_chain
from soliton_linkage_studies.driving.runs import (
    MECHANICS,
    BalancedRun,
    BalanceTask,
    StiffnessTask,
    TiltedRun,
    TiltTask,
)
from soliton_linkage_studies.moves.runs import MoveKey, MoveRun, MoveTask
from soliton_linkage_studies.moves.study import MoveStudy, read_move_study, runs_by_key
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
    settings.allow(*_KEYS)
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
    section.allow('pressure', 'duration')
    pressure = section.number('pressure', 1.0, PneumaticActuator().highest_pressure)
    return trapezoid(pressure, 0.0, section.number('duration', 0.01, 10.0), 0.0)


def _works(section: Section) -> dict[str, WorkTask]:
    section.allow('chain', 'pressure', 'duration', 'ramp', 'saturation_torque')
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
