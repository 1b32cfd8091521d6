# SPDX-License-Identifier: Apache-2.0
"""The chains of a graph, each in its namespace, and the newest messages about them."""

from __future__ import annotations

import math
import time
from dataclasses import replace

from rclpy.node import Node

from soliton_linkage_msgs.msg import LastKick
from soliton_linkage_nodes.live_view.chain_model import ChainModel
from soliton_linkage_nodes.live_view.frame_layout import pack_camera
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.conversions import chain_from_msg
from soliton_linkage_nodes.messages.picture_conversions import jpeg_from_msg
from soliton_linkage_nodes.messages.view_conversions import (
    NodeReport,
    reports_from_msg,
    soliton_values,
    state_numbers,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription, subscribe_newest

REPORT_TIMEOUT = 3.5
"""Age of a report after which a node counts as silent [s]; nodes report once a second."""
_SEARCH_INTERVAL = 0.5
"""Poll interval for chains and nodes of the graph [s]; a poll takes about a millisecond."""
_MOST_REPORTS = 200
"""Largest number of diagnostics that one call of `update` takes [1]."""
_MOST_CHAINS = 16
"""Largest number of chains shown."""
_MOST_BYTES = 4_000_000
"""Largest camera picture that is sent [bytes]: a sharp one of 12 million pixels."""


class CameraTopic:
    """Subscription to `camera_overlay` of a namespace while a page shows it."""

    def __init__(self, node: Node, namespace: str) -> None:
        self.pictures = 0
        """Number of pictures received since the subscription."""
        self._node = node
        self._name = f'{namespace}{interfaces.CAMERA_OVERLAY.name}'
        self._publishers = 0
        self._subscription: AdaptiveSubscription | None = None
        self._jpeg = b''
        self._stamp = math.nan
        self._received_at = -math.inf
        self._error = ''

    @property
    def reason(self) -> str:
        """Reason why there is no picture, empty if there may be one."""
        if self._error or self._publishers:
            return self._error
        return f'no node publishes {interfaces.CAMERA_OVERLAY.name}; start camera_encoders'

    def show(self, shown: bool) -> None:
        """Subscribe while a page shows the pictures."""
        if shown and self._publishers and self._subscription is None:
            self._subscription = subscribe_newest(
                self._node, interfaces.CAMERA_OVERLAY, self._name
            )
        elif not shown and self._subscription is not None:
            self.close()

    def update(self) -> None:
        """Keep the newest picture."""
        message = self._subscription.newest() if self._subscription else None
        if message is None:
            return
        try:
            self._jpeg = jpeg_from_msg(message, _MOST_BYTES)
        except ValueError as error:
            self._error = f'{interfaces.CAMERA_OVERLAY.name}: {error}'
            return
        self._error = ''
        self._stamp = time_from_msg(message.header.stamp) / SECOND
        self._received_at = time.monotonic()
        self.pictures += 1

    def adapt(self) -> None:
        """Adapt to new publishers."""
        if self._subscription is not None:
            self._subscription.adapt()
            self._publishers = len(self._subscription.publishers)
        else:
            self._publishers = self._node.count_publishers(self._name)
        if not self._publishers:
            self._error = ''

    def packed(self, index: int) -> bytes:
        """Return the newest picture, given the index of the chain in the status."""
        age = time.monotonic() - self._received_at
        return pack_camera(index, self._stamp, age, self._jpeg)

    def close(self) -> None:
        """Unsubscribe and drop the picture."""
        if self._subscription is not None:
            self._subscription.close()
        self._subscription, self._jpeg, self.pictures = None, b'', 0


class ChainTopics:
    """Topics of the chain of one namespace, which ends in a slash."""

    def __init__(self, node: Node, namespace: str) -> None:
        self.namespace = namespace
        self.model = ChainModel()
        self.camera = CameraTopic(node, namespace)
        self.publishers = 0
        """Number of publishers of `joint_states`."""
        self.kick: LastKick | None = None
        """Latest message of last_kick."""
        self.kicks = 0
        """Number of messages of last_kick."""
        self._decoder = JointStateDecoder()
        self._chain = subscribe_newest(node, interfaces.CHAIN, f'{namespace}chain')
        self._joints = subscribe_newest(
            node, interfaces.JOINT_STATES, f'{namespace}joint_states', raw=True
        )
        self._states = subscribe_newest(
            node, interfaces.SOLITON_STATE, f'{namespace}soliton_state'
        )

        self._kicks = AdaptiveSubscription(
            node, replace(interfaces.LAST_KICK, name=f'{namespace}{interfaces.LAST_KICK.name}')
        )

    def update(self) -> None:
        """Put the newest messages into the model."""
        self.camera.update()
        for kick, _ in self._kicks.waiting():
            self.kick = kick
            self.kicks += 1
        chain = self._chain.newest()
        if chain is not None:
            try:
                self.model.set_chain(chain_from_msg(chain))
            except ValueError as error:
                self.model.error = f'chain: {error}'
        state = self._states.newest()
        if state is not None:
            self.model.update_state(state_numbers(state), soliton_values(state))
        joints = self._joints.newest()
        if joints is not None:
            self.model.update_rate(self._joints.sequence)
            try:
                self.model.update_joints(self._decoder.decode(joints))
            except ValueError as error:
                self.model.error = str(error)

    def adapt(self) -> None:
        """Adapt to new publishers."""
        for topic in (self._joints, self._states, self._kicks, self.camera):
            topic.adapt()
        self.publishers = len(self._joints.publishers)

    def close(self) -> None:
        """Unsubscribe."""
        for topic in (self._chain, self._joints, self._states, self._kicks, self.camera):
            topic.close()


class ChainFinder:
    """All published chains, the expected one, and the reports of nodes.

    No executor may spin the node. The chain of the expected namespace is listed first.
    """

    def __init__(self, node: Node, expected: str) -> None:
        self.chains: dict[str, ChainTopics] = {expected: ChainTopics(node, expected)}
        self.reports: dict[str, tuple[float, NodeReport]] = {}
        """Last report of each node with its monotonic time [s]."""
        self.nodes: list[str] = []
        """Full names of nodes."""
        self._node = node
        self._searched = 0.0
        self._expected = expected
        self._diagnostics = AdaptiveSubscription(node, interfaces.DIAGNOSTICS)

    def update(self) -> None:
        """Take the newest messages of all chains, and search periodically for more chains."""
        for chain in list(self.chains.values()):
            chain.update()
        for _ in range(_MOST_REPORTS):
            message = self._diagnostics.newest()
            if message is None:
                break
            for report in reports_from_msg(message):
                self.reports[report.node] = (time.monotonic(), report)
        if time.monotonic() - self._searched >= _SEARCH_INTERVAL:
            self._searched = time.monotonic()
            self._search()

    def drop(self, namespace: str) -> None:
        """Drop a chain until it is published again."""
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
                    self.chains[namespace] = ChainTopics(self._node, namespace)
        for namespace, chain in list(self.chains.items()):
            chain.adapt()
            if not (chain.publishers or chain.model.frames or namespace == self._expected):
                self.drop(namespace)
        self.nodes = [
            f'{namespace.rstrip("/")}/{node}'
            for node, namespace in self._node.get_node_names_and_namespaces()
            if not node.startswith('_')
        ]
