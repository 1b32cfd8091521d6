# SPDX-License-Identifier: Apache-2.0
"""Parameters of the edge actuator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, make_dataclass

from rclpy.node import Node

from soliton_linkage.actuation.actuators import ACTUATORS
from soliton_linkage.actuation.edge_command import CommandKind
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.messages.chain_source import CHAIN_SOURCE_PARAMETERS
from soliton_linkage_nodes.runtime.managed import ManagedParameters
from soliton_linkage_nodes.runtime.parameters import declare


@dataclass(frozen=True)
class EdgeActuatorParameters:
    """Parameters of the node, without the parameters of the chain and of the actuators."""

    actuator: str = quantity('pneumatic', 'kind of the actuators at the edges')
    nudge_edge: str = quantity(
        'nearest',
        'edge of nudges; nearest is the edge nearer to the zero mode',
        choices=tuple(edge.value for edge in Edge),
        adjustable=True,
    )
    nudge_as: str = quantity(
        'kick',
        'effect of a nudge: an instantaneous kick, or a pressure with the same impulse',
        choices=(CommandKind.KICK.value, CommandKind.PRESSURE.value),
        adjustable=True,
    )
    nudge_duration: float = quantity(
        0.1, 'duration of the pressure of a nudge', 's', 1e-3, 60.0, adjustable=True
    )
    state_timeout: float = quantity(
        0.2, 'age of joint_states above which commands are rejected', 's', 1e-3, 60.0
    )
    command_timeout: float = quantity(
        0.5,
        'time for which torques of joints are held without a new command, and largest age of a '
        'command; 0 for no limit',
        's',
        0.0,
        86_400.0,
    )
    longest_command: float = quantity(
        600.0, 'largest duration of a command, and future time of its stamp', 's', 1e-3, 86_400.0
    )
    speed_limit: float = quantity(100.0, 'largest speed of a kick', 'rad/s', 0.0, 1e6)
    torque_limit: float = quantity(
        0.1,
        'largest torque of a pulse along the unit zero mode, and of a joint without its own limit',
        'N m',
        0.0,
        1e6,
    )
    joints: tuple[str, ...] = quantity((), 'joints with an actuator; empty for all joints')


PARAMETERS: dict[type, str] = {
    EdgeActuatorParameters: '',
    ManagedParameters: '',
    **dict.fromkeys(ACTUATORS.values(), ''),
    **CHAIN_SOURCE_PARAMETERS,
}
"""Dataclasses with the node's parameters, and the prefix of the parameter names of each class."""


def declare_torque_limits(node: Node, settings: EdgeActuatorParameters) -> Mapping[str, float]:
    """Declare a parameter `torque_limits.<joint>` for each of `joints`; return the limits [N m].

    Raises ValueError if a name is invalid or occurs twice.
    """
    own = settings.torque_limit
    fields = [
        (name, float, quantity(own, f'largest torque of {name}', 'N m', 0.0, 1e6))
        for name in settings.joints
    ]
    try:
        limits = make_dataclass('TorqueLimits', fields, frozen=True)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f'parameter joints of {node.get_name()} = {list(settings.joints)} must be names of '
            f'joints, each once: {error}'
        ) from error
    return asdict(declare(node, limits, 'torque_limits.'))
