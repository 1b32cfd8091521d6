# SPDX-License-Identifier: Apache-2.0
"""A chain whose soliton is steered, frame by frame."""

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
    """Parameters of the steering."""

    actuated_joints: tuple[str, ...] = quantity(
        (), 'joints that carry an actuator; empty for all of them'
    )
    torque_limit: float = quantity(0.1, 'largest torque of an actuator', 'N m', 1e-9, 1e6)
    strain_limit: float = quantity(
        0.1,
        'angle by which springs may give way, where not all joints carry actuators',
        'rad',
        1e-6,
        1.0,
    )
    tolerance: float = quantity(
        0.1, 'distance from its goal at which a soliton has arrived', 'rotor spacings', 1e-3, 1.0
    )
    state_timeout: float = quantity(
        0.5, 'time without joint_states after which a soliton is lost', 's', 1e-2, 60.0
    )


PARAMETERS: dict[type, str] = {
    SolitonSteeringParameters: '',
    ManagedParameters: '',
    ChainSourceParameters: '',
    **CHAIN_PARAMETERS,
}
"""The prefix of all parameters of the node, by their dataclasses."""


class SteeredChain:
    """The steering of a named chain, and the phonons that it leaves."""

    def __init__(self, named: NamedChain, settings: SolitonSteeringParameters) -> None:
        """Steer with the given actuators; raises ValueError where the chain does not allow it."""
        self.named = named
        rotors = _rotors(named, settings.actuated_joints)
        self.limitation = ''
        """Why the deviations of the chain count for nothing, if they do."""
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
        """The soliton, None where there is none."""
        return self.steering.wall

    @property
    def place(self) -> float:
        """Of the soliton [rotor spacings], NaN where there is none."""
        return math.nan if self.wall is None else self.wall.place

    @property
    def phonon_energy(self) -> float:
        """Beside the soliton [J]."""
        return self._phonons.energy

    def begin_anew(self) -> None:
        """Know of no frame, as at first; not while a wall is held."""
        self.steering.forget()
        self._phonons = PhononEnergyEstimator(self.steering.orbit)

    def observe(self, stamp: int, frame: Frame) -> tuple[Array | None, MoveResult | None]:
        """Torques to send with a frame of a stamp [ns], and the end of a move, where there are."""
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
    """Numbers of the rotors that joints belong to."""
    for joint in joints:
        if joint not in named.numbers:
            raise ValueError(
                f'actuated_joints names {joint!r}, which is none of {named.joint_names[0]!r} to '
                f'{named.joint_names[-1]!r}; name joints of the chain, or none for all of them'
            )
    return tuple(named.numbers[joint] for joint in joints)
