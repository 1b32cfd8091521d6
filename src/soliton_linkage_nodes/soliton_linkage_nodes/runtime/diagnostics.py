# SPDX-License-Identifier: Apache-2.0
"""What a node says about itself on /diagnostics once a second, and how it refuses input."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from soliton_linkage_nodes.runtime.interfaces import DIAGNOSTICS

_PERIOD = 1.0
"""Of the reports, and of the log of a flood of refusals [s]: that of ROS's own updater."""


@dataclass(frozen=True)
class Report:
    """How a node is doing: one sentence, and the figures behind it."""

    message: str
    values: Mapping[str, Any] = field(default_factory=dict)
    warning: bool = False


class Diagnostics:
    """Publishes a node's report once a second and counts what the node refused."""

    def __init__(self, node: Node, task: str, report: Callable[[], Report]) -> None:
        """Start reporting as '<node>: <task>'."""
        self.refused = 0
        self._node = node
        self._task = task
        self._report = report
        self._refused_before = 0
        self._last_refusal = ''
        self._said_at = -math.inf
        self._publisher = DIAGNOSTICS.publisher(node)
        self._timer = node.create_timer(
            _PERIOD, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def refuse(self, source: str, reason: object) -> None:
        """Count a refused input and say why in one line; a flood is said once a second."""
        self.refused += 1
        self._last_refusal = f'{source}: {reason}'
        # rclpy's own throttle looks up the caller in the source for each message, in 0.7 ms.
        now = time.monotonic()
        if now - self._said_at >= _PERIOD:
            self._said_at = now
            self._node.get_logger().warning(f'refused {self._last_refusal}')

    def refusing(self, source: str, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return what takes each message, and refuses those that cannot be taken."""

        def take_or_refuse(message: Any) -> None:
            try:
                take(message)
            except (ValueError, ArithmeticError) as error:
                self.refuse(source, error)

        return take_or_refuse

    def publish(self) -> None:
        """Publish the report of this moment."""
        report = self._report()
        fresh = self.refused - self._refused_before
        self._refused_before = self.refused
        message = f'{fresh} refused: {self._last_refusal}' if fresh else report.message
        values = {**report.values, 'refused': self.refused, 'last refusal': self._last_refusal}
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if report.warning or fresh else DiagnosticStatus.OK,
            name=f'{self._node.get_name()}: {self._task}',
            message=message,
            hardware_id=self._node.get_fully_qualified_name(),
            values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
