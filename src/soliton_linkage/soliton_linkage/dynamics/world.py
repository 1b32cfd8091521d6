# SPDX-License-Identifier: Apache-2.0
"""Parameters of a simulation (mechanics, solver, initial state); `World` creates simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import State, leaning, with_pair, with_soliton
from soliton_linkage.dynamics.integrators import INTEGRATORS
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.linkage.quantities import quantity

_MECHANICS = ('elastic', 'rigid')
_LEANS = {'left_leaning': -1, 'right_leaning': 1}
"""Sign of the staggered angles in each uniform state."""
_SOLITON, _PAIR = 'soliton', 'pair'


@dataclass(frozen=True)
class WorldParameters:
    """Parameters of the simulation, except the parameters of the chain and of gravity."""

    mechanics: str = quantity(
        'elastic', 'whether rotors are joined by springs or by rigid bars', choices=_MECHANICS
    )
    integrator: str = quantity(
        'symplectic',
        'solver for chains of springs: symplectic, or a solver of scipy',
        choices=tuple(INTEGRATORS),
    )
    tolerance: float = quantity(
        1e-11, 'error allowed in each angle at each step of the solver', 'rad', 1e-13, 1e-2
    )
    fixed_rotors: tuple[str, ...] = quantity(
        (), 'names or numbers of joints that do not turn; with an empty list all joints turn'
    )
    initial_state: str = quantity(
        'left_leaning',
        'initial state: one of the uniform states, a soliton, or a pair of kink and anti-kink',
        choices=(*_LEANS, _SOLITON, _PAIR),
    )
    initial_position: float = quantity(
        1.0, 'initial position of the soliton, from 0.5 to N - 1.5', 'rotor spacings', 0.5, 1e5
    )
    initial_distance: float = quantity(
        12.0,
        'initial site of the kink minus that of the anti-kink, if initial_state is a pair; the '
        'kink is at initial_position',
        'rotor spacings',
        -1e5,
        1e5,
    )
    initial_velocity: float = quantity(0.0, 'initial velocity of the soliton', 'm/s', -1e6, 1e6)


class World:
    """Factory of simulations of one chain; methods raise ValueError for unsuitable states."""

    def __init__(
        self, chain: Chain, joint_names: Sequence[str], parameters: WorldParameters, period: float
    ) -> None:
        self._chain = chain
        self._parameters = parameters
        self._period = period
        self._fixed = joint_numbers('fixed_rotors', parameters.fixed_rotors, joint_names)

    def begin(self, state: State, gravity: Gravity) -> Simulation:
        """Return a simulation that starts in a given state."""
        given = self._parameters
        start = (state.angles, state.rates, self._period, given.tolerance, gravity, self._fixed)
        if given.mechanics == 'rigid':
            return RigidSimulation(self._chain, *start)
        return ElasticSimulation(self._chain, *start, integrator=given.integrator)

    def initial_state(self) -> State:
        """Return the initial state that the parameters specify."""
        given = self._parameters
        if given.initial_state == _SOLITON:
            return with_soliton(self._chain, given.initial_position, given.initial_velocity)
        if given.initial_state == _PAIR:
            site = given.initial_position
            return with_pair(self._chain, site, site - given.initial_distance)
        return leaning(self._chain, _LEANS[given.initial_state])


def joint_numbers(
    parameter: str, joints: Sequence[str], joint_names: Sequence[str]
) -> tuple[int, ...]:
    """Return sorted numbers of joints that are given by name or number; ValueError if unknown."""
    numbers = {str(rotor): rotor for rotor in range(len(joint_names))}
    numbers |= {name: rotor for rotor, name in enumerate(joint_names)}
    for joint in joints:
        if joint not in numbers:
            raise ValueError(
                f'{parameter} names joint {joint!r}, which is none of {joint_names[0]!r} to '
                f'{joint_names[-1]!r} or 0 to {len(joint_names) - 1}'
            )
    return tuple(sorted({numbers[joint] for joint in joints}))
