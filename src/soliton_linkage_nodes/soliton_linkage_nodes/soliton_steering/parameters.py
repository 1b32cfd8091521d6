# SPDX-License-Identifier: Apache-2.0
"""Parameters of the steering."""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.messages.chain_source import CHAIN_PARAMETERS, ChainSourceParameters
from soliton_linkage_nodes.runtime.managed import ManagedParameters


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
