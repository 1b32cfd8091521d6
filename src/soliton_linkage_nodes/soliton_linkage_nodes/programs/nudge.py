# SPDX-License-Identifier: Apache-2.0
"""One nudge of the edge, and what became of it; for shells without `ros2 topic pub` as well.

It waits for the edge actuator, nudges the chain on the topic nudge, and says what the actuator
answers on last_kick, or why there is no answer.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Float64

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage_msgs.msg import EdgeCommand, LastKick
from soliton_linkage_nodes.programs.command_line import (
    exit_on_failure,
    number,
    parse_own_arguments,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.process import WaitingNode, initialise, stop_on_signals
from soliton_linkage_nodes.start import INTERRUPTED

_SPEED = Quantity('speed of the kick along the zero mode; the sign is its direction', 'rad/s')
_TIMEOUT = Quantity('longest wait, for the actuator and then for its answer', 's', 0.0, 3600.0)
"""No person waits for longer than an hour."""
_SUBSCRIBERS = Quantity('listeners to wait for', minimum=1)
"""The actuator is one."""
_LONGEST_WAIT = 5.0
"""For an actuator that runs to be found, and to answer, with room for a busy machine [s]."""
_TIME_TO_MEET_ANOTHER = 1.0
"""For others to be met, as a recorder is, and for the last kick that was before [s]."""
_EDGES = {EdgeCommand.FIRST: 'first', EdgeCommand.LAST: 'last'}


class NudgeClient(WaitingNode):
    """Nudges a chain by its actuator, and hears what that says of it."""

    def __init__(self, stopping: threading.Event, **kwargs: Any) -> None:
        """Connect the topics; `stopping` is set to interrupt it."""
        super().__init__('nudge', stopping, **kwargs)
        self._reports: dict[str, DiagnosticStatus] = {}
        self._kicks: list[LastKick] = []
        self._nudges = interfaces.NUDGE.publisher(self)
        topic = interfaces.LAST_KICK
        self._answers = self.create_subscription(
            topic.type, topic.name, self._kicks.append, topic.qos
        )
        interfaces.DIAGNOSTICS.subscribe(self, self._on_diagnostics)

    def nudge(self, speed: float, subscribers: int, timeout: float) -> LastKick | None:
        """Nudge [rad/s] and return the actuator's answer, None where it is interrupted.

        It waits for an actuator that is ready, and for so many subscribers of any kind, no
        longer than `timeout` [s]. Raises ValueError where there is none, or no answer.
        """
        deadline = time.monotonic() + timeout
        self.wait(self._actuators, timeout)
        met = time.monotonic()
        ready = self.wait(lambda: self._ready(subscribers), deadline - met)
        if not (ready or self.stopping.is_set()):
            self._check_heard(subscribers, timeout)
        self.wait(lambda: False, met + _TIME_TO_MEET_ANOTHER - time.monotonic())
        if self.stopping.is_set():
            return None
        refused = {name: _refused(report) for name, report in self._reports.items()}
        self._kicks.clear()
        self._nudges.publish(Float64(data=speed))
        self.wait(lambda: self._answer() or self._refusal(refused), timeout)
        answer = self._answer()
        if answer is None and not self.stopping.is_set():
            raise ValueError(self._refusal(refused) or self._silence(timeout))
        interfaces.wait_for_acknowledgements(self._nudges)
        return answer

    def _actuators(self) -> set[str]:
        """Nodes that listen to nudges and tell of kicks, which a recorder does not."""
        listening = self.get_subscriptions_info_by_topic(self._nudges.topic_name)
        telling = self.get_publishers_info_by_topic(self._answers.topic_name)
        return _names(listening) & _names(telling)

    def _ready(self, subscribers: int) -> bool:
        """Whether an actuator is, which is not while it lacks the chain or its frames."""
        reports = [self._reports[name] for name in self._actuators() & self._reports.keys()]
        return (
            self._nudges.get_subscription_count() >= subscribers
            and self._answers.get_publisher_count() > 0
            and any(report.level == DiagnosticStatus.OK for report in reports)
        )

    def _check_heard(self, subscribers: int, timeout: float) -> None:
        topic, after = self._nudges.topic_name, f'after {timeout:g} s'
        if not self._actuators():
            others = sorted(_names(self.get_subscriptions_info_by_topic(topic)))
            who = f'no actuator, only {", ".join(others)}, hears' if others else 'nothing hears'
            raise ValueError(f'{who} {topic} {after}; start edge_actuator first')
        count = self._nudges.get_subscription_count()
        if count < subscribers:
            raise ValueError(
                f'{topic} has {count} of {subscribers} subscribers {after}; start the others, or '
                'ask for fewer with --subscribers'
            )

    def _answer(self) -> LastKick | None:
        topic = self._nudges.topic_name.rpartition('/')[2]
        for kick in self._kicks:
            sources = {source.rpartition('/')[2] for source in kick.source.split(', ')}
            if sources & {topic, interfaces.NUDGE.name}:
                return kick
        return None

    def _refusal(self, before: dict[str, int]) -> str:
        """What an actuator says that has refused a nudge since it had refused so much."""
        for name in self._actuators() & before.keys():
            report = self._reports[name]
            source, _, reason = _figure(report, 'last rejection').partition(': ')
            if _refused(report) > before[name] and interfaces.NUDGE.name in source:
                return f'{name} refused it: {reason}'
        return ''

    def _silence(self, timeout: float) -> str:
        who = ' '.join(sorted(self._actuators())) or 'the actuator, which is gone,'
        return (
            f'{who} said nothing of it on {self._answers.topic_name} within {timeout:g} s; see '
            'its log, or allow more by --timeout where nudges are long pressures'
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self._reports.update({status.hardware_id: status for status in message.status})


def described(kick: LastKick) -> str:
    """What became of a nudge; raises ValueError where it is nothing."""
    if kick.cut_short and not kick.name:
        raise ValueError('the simulator did not carry it out; see its log')
    asked = kick.asked
    edge = f'at the {_EDGES.get(asked.edge, "nearest")} edge'
    said = [
        f'{asked.value:g} Pa for {kick.duration:.3g} s {edge}, at most {kick.peak_torque:.3g} N m'
        if asked.kind == EdgeCommand.PRESSURE
        else f'a kick of {asked.value:g} rad/s {edge}',
        f'an impulse of {math.hypot(*kick.impulse):.3g} N m s and a work of {kick.work:.3g} J, '
        + ('as the simulator measured' if kick.measured else 'as reckoned, for nobody measures'),
    ]
    said += ['less than was asked: the actuator saturated'] if kick.saturated else []
    said += ['cut short'] if kick.cut_short else []
    return '; '.join(said)


def main() -> None:
    """Nudge as the command line asks; exit with 1 where nothing came of it, 130 on Ctrl-C."""
    options = parse_own_arguments(_parser())
    stopping = stop_on_signals()
    try:
        with exit_on_failure('nudge'):
            initialise()
            node = NudgeClient(stopping)
            kick = node.nudge(options.speed, options.subscribers, options.timeout)
            if kick is not None:
                print(f'nudge: {described(kick)}')
    finally:
        rclpy.try_shutdown()
    if stopping.is_set():
        sys.exit(INTERRUPTED)


def _parser() -> PlainParser:
    parser = PlainParser(prog='nudge', description=__doc__)
    parser.add_argument('speed', type=number(_SPEED), help=f'{_SPEED.description} [rad/s]')
    parser.add_argument(
        '--subscribers',
        type=number(_SUBSCRIBERS, int),
        default=1,
        help='listeners to wait for, the actuator and a recorder being 2 (%(default)s)',
    )
    parser.add_argument(
        '--timeout',
        type=number(_TIMEOUT),
        default=_LONGEST_WAIT,
        help=f'{_TIMEOUT.description} [s] (%(default)g)',
    )
    return parser


def _names(endpoints: list[Any]) -> set[str]:
    return {f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in endpoints}


def _figure(report: DiagnosticStatus, key: str) -> str:
    return next((pair.value for pair in report.values if pair.key == key), '')


def _refused(report: DiagnosticStatus) -> int:
    return int(_figure(report, 'rejected') or 0)
