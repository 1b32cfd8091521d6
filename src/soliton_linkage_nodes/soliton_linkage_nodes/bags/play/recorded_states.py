# SPDX-License-Identifier: Apache-2.0
"""Recorded soliton states give way to an analyser that makes its own of the same frames."""

from __future__ import annotations

import time

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from soliton_linkage_nodes.runtime import interfaces

_LOOK_INTERVAL = 0.25
"""How often the graph is asked for an analyser, which takes a millisecond [s]."""


class RecordedStates:
    """Whether recorded soliton states, or events, are played: two sources on one topic would mix.

    An analyser is another node that hears `joint_states` and publishes their topic beside it.
    """

    def __init__(self, node: Node, topic: str, chosen: bool) -> None:
        """Watch the topic; where it was chosen by name its messages are played all the same."""
        self.topic = topic
        self._node = node
        self._states = node.resolve_topic_name(topic)
        frames = f'{topic.rpartition("/")[0]}/{interfaces.JOINT_STATES.name}'
        self._frames = node.resolve_topic_name(frames)
        self._chosen = chosen
        self._analyser = ''
        self._looked_at = -_LOOK_INTERVAL

    def give_way(self) -> bool:
        """Whether the message that is due is to be left out; says so when that changes."""
        now = time.monotonic()
        if now - self._looked_at >= _LOOK_INTERVAL:
            self._looked_at = now
            analyser = self._find_analyser()
            if analyser != self._analyser:
                self._analyser = analyser
                self._say()
        return bool(self._analyser) and not self._chosen

    def _find_analyser(self) -> str:
        node = self._node
        heard = {_name(each) for each in node.get_subscriptions_info_by_topic(self._frames)}
        said = {_name(each) for each in node.get_publishers_info_by_topic(self._states)}
        return min(heard & said - {node.get_fully_qualified_name()}, default='')

    def _say(self) -> None:
        log, name = self._node.get_logger(), self.topic.rpartition('/')[2]
        if not self._analyser:
            log.info(f'no analyser is left: the recorded {self._states} is played again')
        elif self._chosen:
            log.warning(
                f'{self._analyser} publishes {self._states}, too, and the two mix; '
                f'stop it, or leave {name} out of topics'
            )
        else:
            log.info(
                f'{self._analyser} publishes {self._states}: what was recorded is left out; '
                f'name {name} in topics to have both'
            )


def _name(endpoint: TopicEndpointInfo) -> str:
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
