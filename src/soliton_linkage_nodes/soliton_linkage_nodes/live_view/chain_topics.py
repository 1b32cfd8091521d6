# SPDX-License-Identifier: Apache-2.0
"""The chains of a graph, each in its namespace, and the newest messages about them."""

from __future__ import annotations

import math
import time

from rclpy.node import Node

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

REPORTS_LAST = 3.5
"""Age after which a node that reports once a second is silent [s]."""
_SEARCH_INTERVAL = 0.5
"""Poll interval for chains and services of the graph [s]; a poll takes about a millisecond."""
_MOST_REPORTS = 200
"""Diagnostics taken at a time: those of a second of many nodes."""
_MOST_CHAINS = 16
"""Largest number of chains shown."""
_MOST_BYTES = 4_000_000
"""Largest camera picture that is passed on: a sharp one of 12 million pixels."""


class CameraTopic:
    """`camera_overlay` of a namespace, subscribed to only while a page shows it."""

    def __init__(self, node: Node, namespace: str) -> None:
        """Subscribe to nothing yet; the namespace ends in a slash."""
        self.pictures = 0
        """Number of pictures received since it was wanted."""
        self._node = node
        self._name = f'{namespace}{interfaces.CAMERA_OVERLAY.name}'
        self._publishers = 0
        self._newest: AdaptiveSubscription | None = None
        self._jpeg = b''
        self._stamp = math.nan
        self._received_at = -math.inf
        self._complaint = ''

    @property
    def reason(self) -> str:
        """Reason why there is no picture, empty if there may be one."""
        if self._complaint or self._publishers:
            return self._complaint
        return f'nothing publishes {interfaces.CAMERA_OVERLAY.name}: start camera_encoders'

    def want(self, wanted: bool) -> None:
        """Subscribe while a page shows the pictures."""
        if wanted and self._publishers and self._newest is None:
            self._newest = subscribe_newest(self._node, interfaces.CAMERA_OVERLAY, self._name)
        elif not wanted and self._newest is not None:
            self.close()

    def take(self) -> None:
        """Keep the newest picture."""
        message = self._newest.newest() if self._newest else None
        if message is None:
            return
        try:
            self._jpeg = jpeg_from_msg(message, _MOST_BYTES)
        except ValueError as error:
            self._complaint = f'{interfaces.CAMERA_OVERLAY.name}: {error}'
            return
        self._complaint = ''
        self._stamp = time_from_msg(message.header.stamp) / SECOND
        self._received_at = time.monotonic()
        self.pictures += 1

    def adapt(self) -> None:
        """Adapt to new publishers."""
        if self._newest is not None:
            self._newest.adapt()
            self._publishers = len(self._newest.publishers)
        else:
            self._publishers = self._node.count_publishers(self._name)
        if not self._publishers:
            self._complaint = ''

    def picture(self, number: int) -> bytes:
        """Return the newest picture for a page, given the number of the chain in its list."""
        age = time.monotonic() - self._received_at
        return pack_camera(number, self._stamp, age, self._jpeg)

    def close(self) -> None:
        """Unsubscribe and drop the picture."""
        if self._newest is not None:
            self._newest.close()
        self._newest, self._jpeg, self.pictures = None, b'', 0


class ChainTopics:
    """The topics of the chain of one namespace."""

    def __init__(self, node: Node, namespace: str) -> None:
        """Subscribe to `chain`, `joint_states` and `soliton_state`; the namespace ends in '/'."""
        self.namespace = namespace
        self.model = ChainModel()
        self.camera = CameraTopic(node, namespace)
        self.publishers = 0
        """Number of publishers of `joint_states`."""
        self._decoder = JointStateDecoder()
        self._chain = subscribe_newest(node, interfaces.CHAIN, f'{namespace}chain')
        self._joints = subscribe_newest(
            node, interfaces.JOINT_STATES, f'{namespace}joint_states', raw=True
        )
        self._states = subscribe_newest(
            node, interfaces.SOLITON_STATE, f'{namespace}soliton_state'
        )

    def take(self) -> None:
        """Put the newest messages into the model."""
        self.camera.take()
        chain = self._chain.newest()
        if chain is not None:
            try:
                self.model.learn(chain_from_msg(chain))
            except ValueError as error:
                self.model.complaint = f'chain: {error}'
        state = self._states.newest()
        if state is not None:
            self.model.take_state(state_numbers(state), soliton_values(state))
        joints = self._joints.newest()
        if joints is not None:
            self.model.count(self._joints.sequence)
            try:
                self.model.take_joints(self._decoder.decode(joints))
            except ValueError as error:
                self.model.complaint = str(error)

    def adapt(self) -> None:
        """Adapt to new publishers."""
        for topic in (self._joints, self._states, self.camera):
            topic.adapt()
        self.publishers = len(self._joints.publishers)

    def close(self) -> None:
        """Unsubscribe."""
        for topic in (self._chain, self._joints, self._states, self.camera):
            topic.close()


class ChainFinder:
    """All chains that are published, the awaited one, and the reports of nodes."""

    def __init__(self, node: Node, awaited: str) -> None:
        """Use a node that no executor spins; list the chain of the namespace `awaited` first."""
        self.chains: dict[str, ChainTopics] = {awaited: ChainTopics(node, awaited)}
        self.reports: dict[str, tuple[float, NodeReport]] = {}
        """Last report of each node with its monotonic time [s]."""
        self.nodes: list[str] = []
        """Full names of nodes."""
        self._node = node
        self._searched = 0.0
        self._awaited = awaited
        self._diagnostics = AdaptiveSubscription(node, interfaces.DIAGNOSTICS)

    def take(self) -> None:
        """Take the newest messages of all chains, and search periodically for more chains."""
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
            if not (chain.publishers or chain.model.frames or namespace == self._awaited):
                self.forget(namespace)
        self.nodes = [
            f'{space.rstrip("/")}/{node}'
            for node, space in self._node.get_node_names_and_namespaces()
            if not node.startswith('_')
        ]
