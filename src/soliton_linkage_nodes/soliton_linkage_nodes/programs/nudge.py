# SPDX-License-Identifier: Apache-2.0
"""Nudge an edge of the chain and print the result.

Use this program instead of `ros2 topic pub`. It waits for the edge actuator and publishes on the
topic nudge. It then prints the answer of the actuator from the topic last_kick, or the reason of a
failure.
"""

from __future__ import annotations

import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float64

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage_msgs.msg import LastKick
from soliton_linkage_nodes.messages.view_conversions import (
    NodeReport,
    describe_kick,
    reports_from_msg,
    topics_of,
)
from soliton_linkage_nodes.programs import command_line
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.interfaces import node_of
from soliton_linkage_nodes.runtime.process import WaitingNode

_SPEED = Quantity('speed of the kick along the zero mode, positive away from the edge', 'rad/s')
_TIMEOUT = Quantity(
    'longest wait for the actuator, and afterwards for its answer', 's', 0.0, 3600.0
)
"""Time limit for an actuator to become ready. It is also the time limit for the answer to the
nudge."""
_SUBSCRIBERS = Quantity('subscribers to wait for, 2 with actuator and recorder', minimum=1)
"""Before the nudge, the topic must have this number of subscribers, including the actuator."""
_LONGEST_WAIT = 5.0
"""Default of the option --timeout [s]."""
_DISCOVERY_TIME = 1.0
"""After an actuator is found, the program waits this long for other subscribers and for the
latched `last_kick` of an earlier kick [s]."""


class NudgeClient(WaitingNode):
    """Client that nudges a chain and receives the answer of the actuator."""

    def __init__(self, stopping: threading.Event, **kwargs: Any) -> None:
        super().__init__('nudge', stopping, **kwargs)
        self._reports: dict[str, NodeReport] = {}
        self._kicks: list[LastKick] = []
        self._nudges = interfaces.NUDGE.publisher(self)
        topic = interfaces.LAST_KICK
        self._answers = self.create_subscription(
            topic.type, topic.name, self._kicks.append, topic.qos
        )
        interfaces.DIAGNOSTICS.subscribe(self, self._on_diagnostics)

    def nudge(self, speed: float, subscribers: int, timeout: float) -> LastKick | None:
        """Publish a nudge; return the answer of the actuator, or None if interrupted.

        `speed` is the speed of the kick along the unit zero mode [rad/s]. Before the nudge, the
        method waits at most `timeout` [s] until an actuator reports that it is ready and the topic
        has `subscribers` subscribers. Raises ValueError if by then no actuator or too few
        subscribers are found, or if the actuator rejects the nudge or does not answer it within
        `timeout`. If an actuator is found but does not report that it is ready, the nudge is sent
        nevertheless.
        """
        deadline = time.monotonic() + timeout
        self.wait(self._actuators, timeout)
        met = time.monotonic()
        ready = self.wait(lambda: self._ready(subscribers), deadline - met)
        if not (ready or self.stopping.is_set()):
            self._check_subscribers(subscribers, timeout)
        self.wait(lambda: False, met + _DISCOVERY_TIME - time.monotonic())
        if self.stopping.is_set():
            return None
        rejected = {name: _rejections(report) for name, report in self._reports.items()}
        self._kicks.clear()
        self._nudges.publish(Float64(data=speed))
        self.wait(lambda: self._answer() or self._rejection(rejected), timeout)
        answer = self._answer()
        if answer is None and not self.stopping.is_set():
            raise ValueError(self._rejection(rejected) or self._silence(timeout))
        interfaces.wait_for_acknowledgements(self._nudges)
        return answer

    def _actuators(self) -> set[str]:
        """Return the names of the nodes that subscribe to `nudge` and publish `last_kick`."""
        subscribed = self.get_subscriptions_info_by_topic(self._nudges.topic_name)
        publishing = self.get_publishers_info_by_topic(self._answers.topic_name)
        return set(map(node_of, subscribed)) & set(map(node_of, publishing))

    def _ready(self, subscribers: int) -> bool:
        reports = [self._reports[name] for name in self._actuators() & self._reports.keys()]
        return (
            self._nudges.get_subscription_count() >= subscribers
            and self._answers.get_publisher_count() > 0
            and any(report.ok for report in reports)
        )

    def _check_subscribers(self, subscribers: int, timeout: float) -> None:
        topic, after = self._nudges.topic_name, f'after {timeout:g} s'
        if not self._actuators():
            others = sorted(map(node_of, self.get_subscriptions_info_by_topic(topic)))
            who = f'only {", ".join(others)} subscribes to' if others else 'no node subscribes to'
            raise ValueError(f'{who} {topic} {after}; start edge_actuator first')
        count = self._nudges.get_subscription_count()
        if count < subscribers:
            raise ValueError(
                f'{topic} has {count} of {subscribers} subscribers {after}; start the others, or '
                'lower --subscribers'
            )

    def _answer(self) -> LastKick | None:
        topic = self._nudges.topic_name.rpartition('/')[2]
        for kick in self._kicks:
            if topics_of(kick) & {topic, interfaces.NUDGE.name}:
                return kick
        return None

    def _rejection(self, before: dict[str, int]) -> str:
        """Return the reason why an actuator rejected the nudge, or ''.

        `before` contains the number of rejections that each actuator had reported before the
        nudge.
        """
        for name in self._actuators() & before.keys():
            report = self._reports[name]
            source, _, reason = report.figures.get('last rejection', '').partition(': ')
            if _rejections(report) > before[name] and interfaces.NUDGE.name in source:
                return f'{name} rejected the nudge: {reason}'
        return ''

    def _silence(self, timeout: float) -> str:
        who = ' '.join(sorted(self._actuators())) or 'the actuator, which has stopped,'
        return (
            f'{who} published no answer on {self._answers.topic_name} within {timeout:g} s; see '
            'its log. If it converts nudges to long pressures, raise --timeout'
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self._reports.update({report.node: report for report in reports_from_msg(message)})


def main() -> None:
    """Nudge as the command line specifies; exit with 1 after a failure, 130 after Ctrl-C."""
    parser = PlainParser(prog='nudge', description=__doc__)
    command_line.add_quantity(parser, 'speed', _SPEED)
    command_line.add_quantity(parser, '--subscribers', _SUBSCRIBERS, 1, int)
    command_line.add_quantity(parser, '--timeout', _TIMEOUT, _LONGEST_WAIT)
    options = command_line.parse_own_arguments(parser)
    with command_line.ros_client('nudge', NudgeClient) as client:
        kick = client.nudge(options.speed, options.subscribers, options.timeout)
        if kick is not None:
            print(f'nudge: {describe_kick(kick)}')


def _rejections(report: NodeReport) -> int:
    return int(report.figures.get('rejected') or 0)
