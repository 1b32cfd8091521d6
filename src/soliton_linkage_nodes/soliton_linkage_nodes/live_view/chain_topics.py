# SPDX-License-Identifier: Apache-2.0
"""The chains of a graph, each in its namespace, and the newest of what is said of them."""

from __future__ import annotations

import time
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from soliton_linkage_nodes.live_view.chain_model import ChainModel
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.conversions import chain_from_msg
from soliton_linkage_nodes.messages.view_conversions import (
    NodeReport,
    reports_from_msg,
    state_numbers,
    walls_of,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.interfaces import Topic

_SEARCH_INTERVAL = 0.5
"""How often the graph is asked for chains and their services, in about a millisecond [s]."""
_MOST_REPORTS = 200
"""Diagnostics that are taken at a time: those of a second of many nodes."""
_MOST_CHAINS = 16
"""Chains that are shown; of more a page could show none well."""


class Newest:
    """The newest message of a topic, which is taken when somebody wants to see it.

    Its node is spun by no executor: calling back for each of a thousand messages a second, of
    which sixty are shown, would cost ten times as much.
    """

    def __init__(self, node: Node, topic: Topic, name: str, raw: bool = False) -> None:
        """Subscribe to a full name; what is offered as best effort is taken as that."""
        self.sequence: int | None = None
        """Number of the message that was taken last, among those of its publisher."""
        self._node, self._topic, self._name, self._raw = node, topic, name, raw
        self._depth = topic.qos.depth if topic is interfaces.DIAGNOSTICS else 1
        self._reliability = self._offered()
        self._subscription = self._subscribe()

    def take(self) -> Any:
        """The message that came since the last time, None where none did."""
        handle = self._subscription.handle
        with handle:
            taken = handle.take_message(self._topic.type, self._raw)
        if taken is None:
            return None
        message, info = taken
        self.sequence = info['publication_sequence_number']
        return message

    def adapt(self) -> int:
        """Hear all publishers, whatever they offer, and return how many there are."""
        offered = self._offered()
        if offered != self._reliability:
            self._reliability = offered
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe()
        return self._publishers

    def close(self) -> None:
        """Subscribe no longer."""
        self._node.destroy_subscription(self._subscription)

    def _offered(self) -> ReliabilityPolicy:
        offers = [i.qos_profile for i in self._node.get_publishers_info_by_topic(self._name)]
        self._publishers = len(offers)
        best_effort = any(o.reliability == ReliabilityPolicy.BEST_EFFORT for o in offers)
        return ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE

    def _subscribe(self) -> Subscription:
        qos = QoSProfile(
            depth=self._depth,
            reliability=self._reliability,
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if self._topic.latched
            else DurabilityPolicy.VOLATILE,
        )
        return self._node.create_subscription(
            self._topic.type, self._name, _ignore, qos, raw=self._raw
        )


class ChainTopics:
    """What is said of the chain of one namespace."""

    def __init__(self, node: Node, namespace: str) -> None:
        """Listen to `chain`, `joint_states` and `soliton_state` there; it ends in a slash."""
        self.namespace = namespace
        self.model = ChainModel()
        self.publishers = 0
        """How many publish `joint_states`; of several a page shows now one, now the other."""
        self._decoder = JointStateDecoder()
        self._chain = Newest(node, interfaces.CHAIN, f'{namespace}chain')
        self._joints = Newest(node, interfaces.JOINT_STATES, f'{namespace}joint_states', raw=True)
        self._states = Newest(node, interfaces.SOLITON_STATE, f'{namespace}soliton_state')

    def take(self) -> None:
        """Put into the model what has come."""
        chain = self._chain.take()
        if chain is not None:
            try:
                self.model.learn(chain_from_msg(chain))
            except ValueError as error:
                self.model.complaint = f'chain: {error}'
        state = self._states.take()
        if state is not None:
            self.model.take_state(state_numbers(state), walls_of(state))
        joints = self._joints.take()
        if joints is not None:
            self.model.count(self._joints.sequence)
            try:
                self.model.take_joints(self._decoder.decode(joints))
            except ValueError as error:
                self.model.complaint = str(error)

    def adapt(self) -> None:
        """Hear publishers that came since, whatever they offer."""
        self.publishers = self._joints.adapt()
        self._states.adapt()

    def close(self) -> None:
        """Listen no longer."""
        for topic in (self._chain, self._joints, self._states):
            topic.close()


class ChainFinder:
    """All chains that somebody publishes, and the one that is waited for."""

    def __init__(self, node: Node, awaited: str) -> None:
        """Look on a node that no executor spins; the first chain is that of a namespace."""
        self.chains: dict[str, ChainTopics] = {}
        self.reports: dict[str, tuple[float, NodeReport]] = {}
        """What each node said last, and when by the clock that never goes back [s]."""
        self.nodes: list[str] = []
        """Full names of nodes."""
        self._node = node
        self._searched = 0.0
        self._add(awaited)
        self._diagnostics = Newest(node, interfaces.DIAGNOSTICS, interfaces.DIAGNOSTICS.name)

    def take(self) -> None:
        """Take what has come of all chains, and now and then look for more."""
        for chain in list(self.chains.values()):
            chain.take()
        for _ in range(_MOST_REPORTS):
            message = self._diagnostics.take()
            if message is None:
                break
            for report in reports_from_msg(message):
                self.reports[report.node] = (time.monotonic(), report)
        if time.monotonic() - self._searched >= _SEARCH_INTERVAL:
            self._searched = time.monotonic()
            self._search()

    def forget(self, namespace: str) -> None:
        """Show a chain no longer, unless it is heard again."""
        chain = self.chains.pop(namespace, None)
        if chain is not None:
            chain.close()

    def _search(self) -> None:
        name = interfaces.JOINT_STATES.name
        for topic, types in self._node.get_topic_names_and_types():
            if topic.endswith(f'/{name}') and 'sensor_msgs/msg/JointState' in types:
                namespace = topic.removesuffix(name)
                new = namespace not in self.chains and len(self.chains) < _MOST_CHAINS
                if new and self._node.count_publishers(topic):
                    self._add(namespace)
        for chain in self.chains.values():
            chain.adapt()
        self.nodes = [
            f'{space.rstrip("/")}/{node}'
            for node, space in self._node.get_node_names_and_namespaces()
            if not node.startswith('_')
        ]

    def _add(self, namespace: str) -> None:
        self.chains[namespace] = ChainTopics(self._node, namespace)


def _ignore(_message: Any) -> None:
    pass
