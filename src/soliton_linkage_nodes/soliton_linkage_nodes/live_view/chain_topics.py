# SPDX-License-Identifier: Apache-2.0
"""The chains of a graph, each in its namespace, and the newest of what is said of them."""

from __future__ import annotations

import time

from rclpy.node import Node

from soliton_linkage_nodes.live_view.camera_topic import CameraTopic
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
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription, newest_of

REPORTS_LAST = 3.5
"""After which a node that reports once a second is silent [s]."""
_SEARCH_INTERVAL = 0.5
"""How often the graph is asked for chains and their services, in about a millisecond [s]."""
_MOST_REPORTS = 200
"""Diagnostics that are taken at a time: those of a second of many nodes."""
_MOST_CHAINS = 16
"""Chains that are shown; of more a page could show none well."""


class ChainTopics:
    """What is said of the chain of one namespace."""

    def __init__(self, node: Node, namespace: str) -> None:
        """Listen to `chain`, `joint_states` and `soliton_state` there; it ends in a slash."""
        self.namespace = namespace
        self.model = ChainModel()
        self.camera = CameraTopic(node, namespace)
        self.publishers = 0
        """How many publish `joint_states`; of several a page shows now one, now the other."""
        self._decoder = JointStateDecoder()
        self._chain = newest_of(node, interfaces.CHAIN, f'{namespace}chain')
        self._joints = newest_of(
            node, interfaces.JOINT_STATES, f'{namespace}joint_states', raw=True
        )
        self._states = newest_of(node, interfaces.SOLITON_STATE, f'{namespace}soliton_state')

    def take(self) -> None:
        """Put into the model what has come."""
        self.camera.take()
        chain = self._chain.newest()
        if chain is not None:
            try:
                self.model.learn(chain_from_msg(chain))
            except ValueError as error:
                self.model.complaint = f'chain: {error}'
        state = self._states.newest()
        if state is not None:
            self.model.take_state(state_numbers(state), walls_of(state))
        joints = self._joints.newest()
        if joints is not None:
            self.model.count(self._joints.sequence)
            try:
                self.model.take_joints(self._decoder.decode(joints))
            except ValueError as error:
                self.model.complaint = str(error)

    def adapt(self) -> None:
        """Hear publishers that came since, whatever they offer."""
        self._joints.adapt()
        self.publishers = len(self._joints.publishers)
        self._states.adapt()
        self.camera.adapt()

    def close(self) -> None:
        """Listen no longer."""
        for topic in (self._chain, self._joints, self._states, self.camera):
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
        self._awaited = awaited
        self._add(awaited)
        self._diagnostics = AdaptiveSubscription(node, interfaces.DIAGNOSTICS)

    def take(self) -> None:
        """Take what has come of all chains, and now and then look for more."""
        for chain in list(self.chains.values()):
            chain.take()
        for _ in range(_MOST_REPORTS):
            message = self._diagnostics.newest()
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
        for namespace, chain in list(self.chains.items()):
            chain.adapt()
            if not (chain.publishers or chain.model.frames or namespace == self._awaited):
                self.forget(namespace)
        self.nodes = [
            f'{space.rstrip("/")}/{node}'
            for node, space in self._node.get_node_names_and_namespaces()
            if not node.startswith('_')
        ]

    def _add(self, namespace: str) -> None:
        self.chains[namespace] = ChainTopics(self._node, namespace)
