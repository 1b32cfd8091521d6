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
from soliton_linkage_nodes.messages.chain_source import CHAIN_PARAMETERS, ChainSourceParameters
from soliton_linkage_nodes.runtime.managed import ManagedParameters
from soliton_linkage_nodes.runtime.parameters import declare


@dataclass(frozen=True)
class EdgeActuatorParameters:
    """Parameters of the node besides those of the actuators at the edges."""

    actuator: str = quantity('pneumatic', 'kind of the actuators at the edges')
    nudge_edge: str = quantity(
        'nearest',
        'edge that nudges are for; nearest is the one that the zero mode is nearer to',
        choices=tuple(edge.value for edge in Edge),
        adjustable=True,
    )
    nudge_as: str = quantity(
        'kick',
        'what a nudge is: a kick at once, or a pressure of nudge_duration with the same impulse',
        choices=(CommandKind.KICK.value, CommandKind.PRESSURE.value),
        adjustable=True,
    )
    nudge_duration: float = quantity(
        0.1, 'how long the pressure of a nudge lasts', 's', 1e-3, 60.0, adjustable=True
    )
    state_timeout: float = quantity(
        0.2, 'age beyond which joint_states are too old to act on', 's', 1e-3, 60.0
    )
    command_timeout: float = quantity(
        0.5,
        'how long torques of joints are held without a new command, and age beyond which '
        'commands are refused, 0 for never',
        's',
        0.0,
        86_400.0,
    )
    longest_command: float = quantity(
        600.0,
        'how long a command may last, and how far ahead one may lie; half of it refuses shorter '
        'ones, twice takes longer ones, and nothing else changes',
        's',
        1e-3,
        86_400.0,
    )
    speed_limit: float = quantity(100.0, 'largest speed of a kick', 'rad/s', 0.0, 1e6)
    torque_limit: float = quantity(
        0.1,
        'largest torque of a pulse along the unit zero mode, and of a joint without a limit of '
        'its own',
        'N m',
        0.0,
        1e6,
    )
    joints: tuple[str, ...] = quantity((), 'joints that carry an actuator; empty for all of them')


PARAMETERS: dict[type, str] = {
    EdgeActuatorParameters: '',
    ManagedParameters: '',
    **dict.fromkeys(ACTUATORS.values(), ''),
    ChainSourceParameters: '',
    **CHAIN_PARAMETERS,
}
"""The prefix of all parameters of the node, by their dataclasses."""


def declare_torque_limits(node: Node, settings: EdgeActuatorParameters) -> Mapping[str, float]:
    """Declare `torque_limits.<joint>` of each of `joints` and return them by joint [N m].

    Raises ValueError where the joints are not names, each once.
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
