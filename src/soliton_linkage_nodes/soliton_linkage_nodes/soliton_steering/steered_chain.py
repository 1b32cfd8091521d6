# SPDX-License-Identifier: Apache-2.0
"""Chain with a steered soliton, processed frame by frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.steering.phonon_energy_estimator import PhononEnergyEstimator
from soliton_linkage.steering.settings import SteeringSettings
from soliton_linkage.steering.steering import MoveResult, Steering, WallState
from soliton_linkage.steering.torque_allocation import TorqueAllocation
from soliton_linkage_nodes.messages.chain_source import CHAIN_PARAMETERS, ChainSourceParameters
from soliton_linkage_nodes.messages.conversions import Frame, NamedChain
from soliton_linkage_nodes.runtime.managed import ManagedParameters
from soliton_linkage_nodes.runtime.stamps import SECOND


@dataclass(frozen=True)
class SolitonSteeringParameters:
    """Parameters of the steering node."""

    actuated_joints: tuple[str, ...] = quantity(
        (), 'joints with an actuator; empty for all joints'
    )
    torque_limit: float = quantity(0.1, 'largest torque of an actuator', 'N m', 1e-9, 1e6)
    strain_limit: float = quantity(
        0.1,
        'largest deflection of a rotor against the springs, if some joints have no actuator',
        'rad',
        1e-6,
        1.0,
    )
    tolerance: float = quantity(
        0.1,
        'largest distance from the goal at the end of a successful move',
        'rotor spacings',
        1e-3,
        1.0,
    )
    state_timeout: float = quantity(
        0.5, 'time without joint_states after which a soliton is released as lost', 's', 1e-2, 60.0
    )


PARAMETERS: dict[type, str] = {
    SolitonSteeringParameters: '',
    ManagedParameters: '',
    ChainSourceParameters: '',
    **CHAIN_PARAMETERS,
}
"""Prefix of the parameters of the node, by dataclass."""


class SteeredChain:
    """Steering of a named chain, with an estimate of the phonons."""

    def __init__(self, named: NamedChain, settings: SolitonSteeringParameters) -> None:
        """Steer with the given actuators; ValueError if the chain does not allow it."""
        self.named = named
        rotors = _rotors(named, settings.actuated_joints)
        self.limitation = ''
        """Reason why the deviations of the chain are ignored, empty if they are used."""
        try:
            orbit = orbit_of(named.chain)
        except (ValueError, ArithmeticError) as error:
            orbit = orbit_of(replace(named.chain, deviations=NO_DEVIATIONS))
            self.limitation = str(error)
        allocation = TorqueAllocation(orbit, rotors, settings.torque_limit, settings.strain_limit)
        self.steering = Steering(orbit, allocation, SteeringSettings(tolerance=settings.tolerance))
        self._phonons = PhononEnergyEstimator(orbit)
        self._epoch: int | None = None

    @property
    def wall(self) -> WallState | None:
        """The soliton, None without one."""
        return self.steering.wall

    @property
    def site(self) -> float:
        """Position of the soliton [rotor spacings], NaN without one."""
        return math.nan if self.wall is None else self.wall.site

    @property
    def phonon_energy(self) -> float:
        """Energy of the phonons [J]."""
        return self._phonons.energy

    def reset(self) -> None:
        """Discard all frames; call this only while no wall is held."""
        self.steering.reset()
        self._phonons = PhononEnergyEstimator(self.steering.orbit)

    def observe(self, stamp: int, frame: Frame) -> tuple[Array | None, MoveResult | None]:
        """Return the torques for a frame with a stamp [ns], and the result if a move ended."""
        if self._epoch is None:
            self._epoch = stamp
        instant = (stamp - self._epoch) / SECOND
        held = self.steering.holding
        ended = self.steering.observe(instant, frame.angles)
        if self.steering.estimate is not None:
            self._phonons.update(instant, frame.rates, self.steering.estimate.arc)
        torques = self.steering.torques()
        return torques if held or self.steering.holding else None, ended


def _rotors(named: NamedChain, joints: tuple[str, ...]) -> tuple[int, ...]:
    """Return the rotor numbers of joints."""
    for joint in joints:
        if joint not in named.numbers:
            raise ValueError(
                f'actuated_joints names {joint!r}, which is none of {named.joint_names[0]!r} to '
                f'{named.joint_names[-1]!r}; choose from these, or leave it empty for all'
            )
    return tuple(named.numbers[joint] for joint in joints)
