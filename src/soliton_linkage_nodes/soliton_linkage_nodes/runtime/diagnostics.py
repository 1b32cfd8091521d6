# SPDX-License-Identifier: Apache-2.0
"""What a node says about itself on /diagnostics once a second, and how it refuses input."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from soliton_linkage_nodes.runtime.guarded import in_one_line
from soliton_linkage_nodes.runtime.interfaces import DIAGNOSTICS

_PERIOD = 1.0
"""Of the reports [s]: that of ROS's own updater."""
_SAID_AGAIN = 1.0
"""After which a refusal is said that is like one before [s]: a person reads no faster."""
MOST_LINES = 100
"""In a period [1]: more than a person reads, and no burden where thousands are made up."""
_NUMBERS = re.compile(r'[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|\binf\b|\bnan\b)')
"""A complaint with other numbers is the same."""


class Complaints:
    """Says each distinct complaint once a period, and how many like it there were meanwhile."""

    def __init__(self, say: Callable[[str], object], period: float) -> None:
        """`say` is called with each line; the period is in [s]."""
        self._say = say
        self._period = period
        self._begun = -period
        self._said: dict[str, int] = {}
        self._before: dict[str, int] = {}
        self._unsaid = self._unsaid_before = 0

    def __len__(self) -> int:
        return len(self._said)

    def tell(self, complaint: str) -> None:
        """Say a complaint, unless one like it was said within the period."""
        now = time.monotonic()
        if now - self._begun >= self._period:
            self._begun = now
            self._before, self._said = self._said, {}
            self._unsaid_before, self._unsaid = self._unsaid, 0
        kind = _NUMBERS.sub('#', complaint)
        if kind in self._said:
            self._said[kind] += 1
        elif len(self._said) < MOST_LINES:
            self._said[kind] = 0
            self._say(complaint + self._of_before(kind))
        else:
            self._unsaid += 1

    def _of_before(self, kind: str) -> str:
        alike, self._before[kind] = self._before.get(kind, 0), 0
        others, self._unsaid_before = self._unsaid_before, 0
        if alike:
            return f' (and {alike} more like it)'
        return f' (and {others} other complaints in the second before)' if others else ''


@dataclass(frozen=True)
class Report:
    """How a node is doing: one sentence, and the figures behind it."""

    message: str
    values: Mapping[str, Any] = field(default_factory=dict)
    warning: bool = False


class Diagnostics:
    """Publishes a node's report once a second and counts what the node refused or failed of.

    What `watches` return is told with the report: a sentence, empty where all is well, and
    figures.
    """

    def __init__(self, node: Node, task: str, report: Callable[[], Report]) -> None:
        """Start reporting as '<node>: <task>'."""
        self.refused = 0
        self.failed = 0
        self.watches: list[Callable[[], tuple[str, Mapping[str, Any]]]] = []
        self._node = node
        self._task = task
        self._report = report
        self._refused_before = self._failed_before = 0
        self._last_refusal = self._last_failure = ''
        # rclpy's own throttle looks up the caller in the source for each message, in 0.7 ms.
        self._refusals = Complaints(lambda line: node.get_logger().warning(line), _SAID_AGAIN)
        self._failures = Complaints(lambda line: node.get_logger().error(line), _SAID_AGAIN)
        self._publisher = DIAGNOSTICS.publisher(node)
        self._timer = node.create_timer(
            _PERIOD, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def refuse(self, source: str, reason: object) -> None:
        """Count a refused input and say each distinct reason in a line, a flood once a second."""
        self.refused += 1
        self._last_refusal = f'{source}: {reason}'
        self._refusals.tell(f'refused {self._last_refusal}')

    def fail(self, failure: str) -> None:
        """Count what the node should have been able to do, and say it as it says refusals."""
        self.failed += 1
        self._last_failure = failure
        self._failures.tell(failure)

    def refusing(self, source: str, take: Callable[..., Any]) -> Callable[..., Any]:
        """Return what takes each message, and refuses those that cannot be taken."""

        @wraps(take)
        def take_or_refuse(*args: Any) -> None:
            try:
                take(*args)
            except (ValueError, ArithmeticError) as error:
                self.refuse(source, error)
            except MemoryError:
                raise
            except Exception as error:
                self.fail(f'could not take {source}: {in_one_line(error)}')

        return take_or_refuse

    def publish(self) -> None:
        """Publish the report of this moment."""
        report = self._report()
        told = [watch() for watch in self.watches]
        concerns = [concern for concern, _ in told if concern]
        values = dict(report.values)
        for _, figures in told:
            values |= figures
        values |= {'refused': self.refused, 'last refusal': self._last_refusal}
        if self.failed:
            values |= {'failed': self.failed, 'last failure': self._last_failure}
        refused, self._refused_before = self.refused - self._refused_before, self.refused
        failed, self._failed_before = self.failed - self._failed_before, self.failed
        message = (
            f'{failed} failed: {self._last_failure}'
            if failed
            else f'{refused} refused: {self._last_refusal}'
            if refused
            else '; '.join(concerns) or report.message
        )
        status = DiagnosticStatus(
            level=DiagnosticStatus.ERROR
            if failed
            else DiagnosticStatus.WARN
            if report.warning or refused or concerns
            else DiagnosticStatus.OK,
            name=f'{self._node.get_name()}: {self._task}',
            message=message,
            hardware_id=self._node.get_fully_qualified_name(),
            values=[
                KeyValue(key=key, value=f'{v:.6g}' if isinstance(v, float) else str(v))
                for key, v in values.items()
            ],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
