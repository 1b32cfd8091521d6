# SPDX-License-Identifier: Apache-2.0
"""Subscriptions to the topics of all chains in a ROS graph. A namespace contains one chain.

A frame consists of the joint states with one stamp, from one message or several. A state is a
soliton_state message. A pair is a frame and the state with the same stamp.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from soliton_linkage_msgs.msg import LastKick, SolitonState
from soliton_linkage_nodes.live_view.chain_model import ChainModel
from soliton_linkage_nodes.live_view.frame_layout import pack_camera
from soliton_linkage_nodes.live_view.sharing import soliton_numbers
from soliton_linkage_nodes.messages import view_conversions as views
from soliton_linkage_nodes.messages.conversions import JointStates, chain_from_msg
from soliton_linkage_nodes.messages.frames import NewestFrame
from soliton_linkage_nodes.messages.picture_conversions import jpeg_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, stamp_of, time_from_msg
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription, subscribe_newest

REPORT_TIMEOUT = 3.5
"""Age of the last report above which a node counts as stopped [s]. Nodes report every second."""
_SEARCH_INTERVAL = 0.5
"""Time between two searches for chains in the graph [s]. A search takes about 1 ms."""
_PAIRED = 200
"""Largest number of stored frames without a state, and of stored states without a frame [1]."""
_SILENCE = 0.5
"""Time without a state after which frames are shown alone [s]."""
_LONGEST_WAIT = 2.0
"""Longest wait for a pair [s]. After this time, the newest frame is shown with the newest state,
because an analyser may use other stamps than the encoders."""
_LATE_SPAN = 10.0
"""Time window for the fraction of late frames [s]."""
_CHANGES = 3
"""Number of decreases of the sequence number [1]. If the sequence number of a topic decreases at
least this many times within `_CHANGE_SPAN`, the topic counts as having several publishers."""
_CHANGE_SPAN = 4.0
"""Time window in which decreases of the sequence number are counted [s]."""
_MOST_CHAINS = 16
"""Largest number of chains that the page shows [1]."""
_MOST_BYTES = 4_000_000
"""Size of the largest camera picture that is sent to a page [B]. A JPEG picture of this size has
about 12 megapixels."""


class CameraTopic:
    """Subscription to `camera_overlay` that exists only while a page shows the pictures."""

    def __init__(self, node: Node, namespace: str) -> None:
        self.pictures = 0
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
        """Reason why no picture can be received, or ''."""
        if self._error or self._publishers:
            return self._error
        return f'no node publishes {interfaces.CAMERA_OVERLAY.name}; start camera_encoders'

    def show(self, shown: bool) -> None:
        """Subscribe if `shown` is true, otherwise unsubscribe."""
        if shown and self._publishers and self._subscription is None:
            self._subscription = subscribe_newest(
                self._node, interfaces.CAMERA_OVERLAY, self._name
            )
        elif not shown and self._subscription is not None:
            self.close()

    def update(self) -> None:
        """Store the newest picture."""
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
        """Adapt the quality of service of the subscription to new publishers."""
        if self._subscription is not None:
            self._subscription.adapt()
            self._publishers = len(self._subscription.publishers)
        else:
            self._publishers = self._node.count_publishers(self._name)
        if not self._publishers:
            self._error = ''

    def packed(self, index: int) -> bytes:
        """Return the newest picture as a binary message for the page.

        `index` is the index of the chain in the list of chains that the page receives.
        """
        age = time.monotonic() - self._received_at
        return pack_camera(index, self._stamp, age, self._jpeg)

    def close(self) -> None:
        """Unsubscribe and drop the picture."""
        if self._subscription is not None:
            self._subscription.close()
        self._subscription, self._jpeg, self.pictures = None, b'', 0


class Sources:
    """Detector that recognises whether several publishers send messages on one topic.

    Each publisher numbers its own messages. Where messages of two publishers alternate, the number
    therefore decreases again and again. After the restart of a node it decreases only once.
    """

    def __init__(self) -> None:
        self._number = 0
        self._changes: deque[float] = deque([-math.inf] * _CHANGES, maxlen=_CHANGES)

    @property
    def several(self) -> bool:
        """Whether several publishers have sent messages in the last 4 s."""
        return time.monotonic() - self._changes[0] < _CHANGE_SPAN

    def add(self, number: int | None) -> None:
        """Process the sequence number of a message. None means that the number is unknown."""
        if number is None:
            return
        if number < self._number:
            self._changes.append(time.monotonic())
        self._number = number


class ChainTopics:
    """Subscriptions to the topics of one chain. The namespace of the chain ends with a slash."""

    def __init__(self, node: Node, namespace: str) -> None:
        self.namespace = namespace
        self.model = ChainModel()
        self.camera = CameraTopic(node, namespace)
        self.publishers = 0
        self.kick: LastKick | None = None
        self.kicks = 0
        self.newest_frame = self.newest_state = 0
        self._chain = subscribe_newest(node, interfaces.CHAIN, f'{namespace}chain')
        self._joints = NewestFrame(node, f'{namespace}joint_states')
        self._states = subscribe_newest(
            node, interfaces.SOLITON_STATE, f'{namespace}soliton_state', raw=True, depth=_PAIRED
        )
        # Frames and states by their stamps [ns]. Each is stored until the other has arrived.
        self._frames: dict[int, JointStates] = {}
        self._analysed: dict[int, bytes] = {}
        self._shown_at = self._state_at = -math.inf
        self._apart = False
        self._joint_sources, self._state_sources = Sources(), Sources()
        self._kicks = AdaptiveSubscription(
            node, replace(interfaces.LAST_KICK, name=f'{namespace}{interfaces.LAST_KICK.name}')
        )

    def update(self) -> None:
        """Update the model with the newest messages."""
        self.camera.update()
        for kick, _ in self._kicks.waiting():
            self.kick = kick
            self.kicks += 1
        chain = self._chain.newest()
        if chain is not None:
            try:
                named = chain_from_msg(chain)
                self.model.set_chain(named)
                self._joints.set_joints(named.joint_names)
            except ValueError as error:
                self.model.error = f'chain: {error}'
        for serialized, info in self._states.waiting():
            self._state_sources.add(info['publication_sequence_number'])
            try:
                self.newest_state = stamp_of(serialized)
                self._analysed[self.newest_state] = serialized
                self._state_at = time.monotonic()
            except ValueError as error:
                self.model.error = f'soliton_state: {error}'
        try:
            frame = self._joints.take()
        except ValueError as error:
            self.model.error = str(error)
            frame = None
        if frame is not None:
            self.model.update_rate(self._joints.number)
            self._joint_sources.add(self._joints.number)
            self._frames[frame.stamp] = frame
            self.newest_frame = frame.stamp
        for kept in (self._frames, self._analysed):
            for stamp in list(kept)[:-_PAIRED]:
                del kept[stamp]
        self._show_frame(frame is not None)

    @property
    def conflict(self) -> str:
        """Warning that several nodes publish the same topic, or ''."""
        topics = (
            (interfaces.JOINT_STATES, self._joint_sources),
            (interfaces.SOLITON_STATE, self._state_sources),
        )
        mixed = next((topic.name for topic, sources in topics if sources.several), '')
        return f'several nodes publish {mixed} at the same time; stop all but one' if mixed else ''

    def is_analysed(self, stamp: int) -> bool:
        """Return whether the state of the frame at `stamp` [ns], or a later state, has arrived.

        If no state has arrived for 0.5 s, return True.
        """
        silent = time.monotonic() - self._state_at > _SILENCE
        return silent or self.newest_state >= stamp

    def _show_frame(self, fresh: bool) -> None:
        """Show the newest pair.

        If states arrive but no pair for 2 s, show the newest frame with the newest state. If no
        state has arrived for 0.5 s, show the newest frame alone. `fresh` is whether a frame has
        just arrived.
        """
        now = time.monotonic()
        if fresh and self._shown_at == -math.inf:
            self._shown_at = now
        paired = [stamp for stamp in self._frames if stamp in self._analysed]
        silent = now - self._state_at > _SILENCE
        self._apart = not paired and (self._apart or now - self._shown_at > _LONGEST_WAIT)
        new = fresh or bool(silent and self._analysed)
        if not paired and not (new and (silent or self._apart)):
            return
        self._shown_at = now
        if paired or (self._apart and self._analysed):
            state = paired[-1] if paired else next(reversed(self._analysed))
            message = deserialize_message(self._analysed[state], SolitonState)
            self.model.update_state(
                views.state_numbers(message), soliton_numbers(message.solitons)
            )
        elif not self._apart:
            self.model.clear_state()
        if self._frames:
            frame = paired[-1] if paired else next(reversed(self._frames))
            for stamp in _until(self._frames, frame)[:-1]:
                skipped = self._analysed.get(stamp)
                self.model.extend_history(
                    self._frames[stamp],
                    views.state_numbers(deserialize_message(skipped, SolitonState))
                    if skipped
                    else {},
                )
            self.model.update_joints(self._frames[frame])
        # Delete messages in the order of their arrival, because stamps may restart at a reset.
        for kept in (self._frames, self._analysed):
            shown = _until(kept, paired[-1]) if paired else list(kept) if silent else []
            if kept is self._frames and not paired:
                del shown[-1:]  # The state of the newest frame may still arrive.
            for stamp in shown:
                del kept[stamp]

    def adapt(self) -> None:
        """Adapt the quality of service of the subscriptions to new publishers."""
        for topic in (self._joints, self._states, self._kicks, self.camera):
            topic.adapt()
        self.publishers = self._joints.publishers
        sources = len(self._chain.publishers)
        self._chain.adapt()
        if len(self._chain.publishers) < sources:
            # The last stored message may be from a publisher that has ended.
            self._chain.resubscribe()

    def close(self) -> None:
        """Unsubscribe."""
        for topic in (self._chain, self._joints, self._states, self._kicks, self.camera):
            topic.close()


def _until(kept: Mapping[int, object], last: int) -> list[int]:
    stamps = list(kept)
    return stamps[: stamps.index(last) + 1]


class ChainFinder:
    """Chains in the ROS graph, and the latest report of each node.

    The namespace `expected` is listed even if no node publishes in it. The method `update` takes
    the messages from the subscriptions of `node`. An executor would take them first. Therefore
    `node` must not be added to an executor.
    """

    def __init__(self, node: Node, expected: str) -> None:
        self.chains: dict[str, ChainTopics] = {expected: ChainTopics(node, expected)}
        self.reports: dict[str, tuple[float, views.NodeReport]] = {}
        """Reception time on the monotonic clock [s] and last report of each node, by full node
        name."""
        self.nodes: list[str] = []
        self._node = node
        self._deadlines: dict[str, deque[tuple[float, ...]]] = {}
        self._searched = 0.0
        self._expected = expected
        self._diagnostics = AdaptiveSubscription(node, interfaces.DIAGNOSTICS)

    def update(self) -> None:
        """Process the newest messages of all chains, and search for new chains every 0.5 s."""
        for chain in list(self.chains.values()):
            chain.update()
        for message, _ in self._diagnostics.waiting():
            for report in views.reports_from_msg(message):
                self.reports[report.node] = (time.monotonic(), report)
                if 'missed deadlines' in report.figures:
                    namespace = f'/{report.node.lstrip("/")}'.rpartition('/')[0] + '/'
                    counts = self._deadlines.setdefault(namespace, deque())
                    missed, frames = (
                        views.figure(report.figures, k) for k in ('missed deadlines', 'frames')
                    )
                    counts.append((time.monotonic(), missed, frames))
        if time.monotonic() - self._searched >= _SEARCH_INTERVAL:
            self._searched = time.monotonic()
            self._search()

    def late_share(self, namespace: str) -> float | None:
        """Return the fraction of late frames in the last 10 s, or None if it is unknown.

        A frame is late if the simulator publishes it more than one period after its deadline.
        """
        counts = self._deadlines.get(namespace)
        while counts and counts[0][0] < time.monotonic() - _LATE_SPAN:
            counts.popleft()
        if not counts or counts[-1][2] <= counts[0][2]:
            return None
        (_, missed_before, before), (_, missed, frames) = counts[0], counts[-1]
        return max(0.0, min(1.0, (missed - missed_before) / (frames - before)))

    def drop(self, namespace: str) -> None:
        """Remove a chain from the list. The next search may find it again."""
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
