# SPDX-License-Identifier: Apache-2.0
"""Where the impulses, the torques and the kicks of an edge actuator go."""

from __future__ import annotations

from rclpy.node import Node

from soliton_linkage.actuation.kick_record import Kick
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.cdr import ImpulseBuffer, TorqueBuffer, publish_buffer
from soliton_linkage_nodes.messages.command_conversions import last_kick_to_msg
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.pacing import let_others_go


class ActuatorOutlets:
    """Publishers of `rotor_impulses`, `rotor_torques` and `last_kick`, with the node's stamps."""

    def __init__(self, node: Node) -> None:
        """Publish as a node."""
        self._node = node
        self._clock = node.get_clock()
        self._impulses = interfaces.ROTOR_IMPULSES.publisher(node)
        self._torques = interfaces.ROTOR_TORQUES.publisher(node)
        self._last_kick = interfaces.LAST_KICK.publisher(node)
        self._buffers: tuple[NamedChain, ImpulseBuffer, TorqueBuffer] | None = None

    @property
    def now(self) -> int:
        """Time of the node's clock [ns]."""
        return int(self._clock.now().nanoseconds)

    @property
    def subscribers(self) -> int:
        """How many listen to the impulses."""
        return int(self._impulses.get_subscription_count())

    @property
    def heard(self) -> bool:
        """Whether anybody listens to the impulses, as simulators do, or to the torques."""
        return bool(self.subscribers or self._torques.get_subscription_count())

    @property
    def measured(self) -> bool:
        """Whether somebody measures what is delivered."""
        return bool(self._node.count_publishers(interfaces.DELIVERY.name))

    def check_heard(self, at_once: bool) -> None:
        """Raise ValueError where nobody listens to the impulses or else to the torques."""
        publisher = self._impulses if at_once else self._torques
        if not publisher.get_subscription_count():
            name = publisher.topic_name.rsplit('/', 1)[-1]
            raise ValueError(f'nothing subscribes to {name}; start the simulator first')

    def kick(self, named: NamedChain, impulses: Array) -> None:
        """Send impulses of all rotors [N m s]."""
        buffer, _ = self._buffers_of(named)
        publish_buffer(self._impulses, buffer.fill(self.now, impulses))
        let_others_go()

    def drive(self, named: NamedChain, torques: Array) -> None:
        """Send torques of all rotors [N m]."""
        _, buffer = self._buffers_of(named)
        publish_buffer(self._torques, buffer.fill(self.now, torques))

    def _buffers_of(self, named: NamedChain) -> tuple[ImpulseBuffer, TorqueBuffer]:
        if self._buffers is None or self._buffers[0] is not named:
            self._buffers = (named, ImpulseBuffer(named), TorqueBuffer(named))
        return self._buffers[1:]

    def flush(self) -> None:
        """Wait, not for long, until the torques are known."""
        interfaces.let_be_heard(self._torques)

    def tell(self, named: NamedChain, kick: Kick) -> None:
        """Tell of a kick that is over."""
        self._last_kick.publish(last_kick_to_msg(named, kick))
