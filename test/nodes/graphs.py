# SPDX-License-Identifier: Apache-2.0
"""A separate ROS graph for each test."""

import gc
import time
from collections.abc import Callable, Mapping
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from std_srvs.srv import Trigger

from soliton_linkage_nodes.bags import services
from soliton_linkage_nodes.runtime import interfaces

LONGEST_WAIT = 240.0
_QUEUED = 20


class Graph:
    """The nodes of one test on a domain of their own, spun by the test while it waits."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self._executor = EventsExecutor(context=self.context)
        self._nodes: list[Node] = []
        self._heard: set[str] = set()
        self._refused = False
        self.user = self.start(lambda **kwargs: Node('user', **kwargs))

    def start(
        self,
        create: Callable[..., Node],
        parameters: Mapping[str, Any] | None = None,
        **kwargs: Any,
    ) -> Any:
        """Create a node with parameters and spin it from now on."""
        overrides = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        try:
            node = create(context=self.context, parameter_overrides=overrides, **kwargs)
        except BaseException:
            self._refused = True
            raise
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def stop(self, node: Node) -> None:
        """Destroy a node as its process does at the end."""
        self._nodes.remove(node)
        self._executor.remove_node(node)
        # What the executor has queued for the node must not be called once it is gone.
        for _ in range(_QUEUED):
            self._executor.spin_once(timeout_sec=0)
        node.destroy_node()

    def until(
        self, condition: Callable[[], Any], what: str, found: Callable[[], Any] | None = None
    ) -> None:
        """Spin until a condition holds; on timeout, fail with the actual value."""
        deadline = time.monotonic() + LONGEST_WAIT
        while not condition():
            if time.monotonic() > deadline:
                instead = '' if found is None else f' and found {found()}'
                pytest.fail(f'waited {LONGEST_WAIT:g} s for {what}{instead}')
            self._executor.spin_once(timeout_sec=0.05)

    def hear(self, topic: interfaces.Topic) -> list[Any]:
        """Return a list to which every message of a topic is added."""
        heard: list[Any] = []
        subscription = self.user.create_subscription(
            topic.type, topic.name, heard.append, topic.qos
        )
        self._heard.add(subscription.topic_name)
        return heard

    def speak(self, topic: interfaces.Topic, subscribers: int = 1) -> Publisher:
        """Return a publisher with matched subscribers whose replies are received."""
        publisher = self.user.create_publisher(topic.type, topic.name, topic.qos)
        self.until(
            lambda: publisher.get_subscription_count() == subscribers,
            f'{subscribers} subscribers of {topic.name}',
            lambda: f'{publisher.get_subscription_count()}, of {self._subscribers(topic.name)}',
        )
        answers = [
            answer
            for node in self._nodes
            for answer in node.publishers
            if answer.topic_name in self._heard
        ]
        self.until(
            lambda: all(answer.get_subscription_count() for answer in answers),
            f'a subscriber of each of {", ".join(answer.topic_name for answer in answers)}',
        )
        return publisher

    def _subscribers(self, topic: str) -> list[str]:
        infos = self.user.get_subscriptions_info_by_topic(topic)
        return [f'{info.node_name} ({info.qos_profile.reliability.name})' for info in infos]

    def call(self, service_type: Any, name: str, /, **request: Any) -> Any:
        """Return the response of a service.

        Recorder and player offer the types of rosbag2 if they are installed. Such a response is
        converted to the requested type.
        """
        node, _, verb = name.rpartition('/')
        offered = service_type
        if node in ('bag_recorder', 'bag_player') and not verb.endswith(('parameters', '_state')):
            offered = services.service_type(verb.title().replace('_', ''))
        client = self.user.create_client(offered, name)
        self.until(client.service_is_ready, f'service {name}')
        future = client.call_async(offered.Request(**request))
        self.until(future.done, f'response of {name}')
        response = future.result()
        if service_type is Trigger and offered is not Trigger:
            success = getattr(response, 'success', getattr(response, 'paused', True))
            return Trigger.Response(success=success)
        return response

    def change(self, node: str, values: Mapping[str, Any]) -> list[Any]:
        """Return what a node answers to changes of its parameters, one answer for each."""
        changes = [Parameter(name, value=each).to_parameter_msg() for name, each in values.items()]
        return list(self.call(SetParameters, f'{node}/set_parameters', parameters=changes).results)

    def reports(self, node: str) -> list[Any]:
        """Return a list to which every diagnostic status of a node is added."""
        heard: list[Any] = []

        def note(message: DiagnosticArray) -> None:
            heard.extend(s for s in message.status if s.name.startswith(f'{node}: '))

        topic = interfaces.DIAGNOSTICS
        self.user.create_subscription(topic.type, topic.name, note, topic.qos)
        return heard

    def next_report(self, node: str) -> Any:
        """Return a diagnostic status that a node publishes after this call."""
        heard = self.reports(node)
        self.until(lambda: heard, f'a report of {node}')
        return heard[-1]

    def close(self) -> None:
        for node in reversed(self._nodes):
            node.destroy_node()
        self._executor.shutdown()
        rclpy.shutdown(context=self.context)
        if self._refused:
            # Remains of a node that rejected its parameters would disturb the next test.
            gc.collect()


def values(status: Any) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}
