# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of nodes on /diagnostics, and rejection of invalid input."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from itertools import zip_longest
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from soliton_linkage_nodes.runtime.guarded import describe_error
from soliton_linkage_nodes.runtime.interfaces import DIAGNOSTICS

_PERIOD = 1.0
"""Period of the reports [s], as in diagnostic_updater."""
MOST_LINES = 100
"""Largest number of lines that a `LogThrottle` logs in one period [1]."""
_NUMBERS = re.compile(r'[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|\binf\b|\bnan\b)')


class LogThrottle:
    """Filter for log messages. Messages that differ only in numbers are logged once per period."""

    def __init__(self, log: Callable[[str], object], period: float) -> None:
        self._log = log
        self._period = period
        self._start = -period
        self._suppressed: dict[str, int] = {}
        self._before: dict[str, int] = {}
        self._others = self._others_before = 0

    def __len__(self) -> int:
        return len(self._suppressed)

    def log(self, message: str) -> None:
        """Log a message, unless a similar one was logged in this period."""
        now = time.monotonic()
        if now - self._start >= self._period:
            self._start = now
            self._before, self._suppressed = self._suppressed, {}
            self._others_before, self._others = self._others, 0
        kind = _NUMBERS.sub('#', message)
        if kind in self._suppressed:
            self._suppressed[kind] += 1
        elif len(self._suppressed) < MOST_LINES:
            self._suppressed[kind] = 0
            self._log(message + self._previous_period(kind))
        else:
            self._others += 1

    def _previous_period(self, kind: str) -> str:
        alike, self._before[kind] = self._before.get(kind, 0), 0
        others, self._others_before = self._others_before, 0
        if alike:
            return f' (and {alike} more of this kind)'
        return f' (and {others} other messages in the previous second)' if others else ''


@dataclass(frozen=True)
class Report:
    """State of a node as a sentence and named values. A flag marks the report as a warning."""

    message: str
    values: Mapping[str, Any] = field(default_factory=dict)
    warning: bool = False


class Increments:
    """Increase of counters from one report to the next."""

    def __init__(self) -> None:
        self._before: tuple[Any, ...] = (time.monotonic(),)

    def take(self, *counts: float) -> list[Any]:
        """Return the time [s], and the increase of each counter, since the previous call.

        The first call returns the time since the construction [s], and the counters themselves.
        """
        before, self._before = self._before, (time.monotonic(), *counts)
        pairs = zip_longest(self._before, before, fillvalue=0)
        return [now - earlier for now, earlier in pairs]


class Diagnostics:
    """Publisher that reports the state of a node once per second.

    It also counts rejected inputs and failures. Each function in `monitors` returns a warning (or
    '') and named values for the report.
    """

    def __init__(self, node: Node, task: str, report: Callable[[], Report]) -> None:
        """Start to publish reports with the name '<node>: <task>'."""
        self.rejected = 0
        self.failed = 0
        self.monitors: list[Callable[[], tuple[str, Mapping[str, Any]]]] = []
        self._node = node
        self._task = task
        self._report = report
        self._increments = Increments()
        self._last_rejection = self._last_failure = ''
        # The log throttle of rclpy needs 0.7 ms per message, because it determines the line of
        # code that logs the message.
        self._rejections = LogThrottle(lambda line: node.get_logger().warning(line), _PERIOD)
        self._failures = LogThrottle(lambda line: node.get_logger().error(line), _PERIOD)
        self._publisher = DIAGNOSTICS.publisher(node)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_PERIOD, self.publish, clock=steady)

    def reject(self, source: str, reason: object) -> None:
        """Count a rejected input from `source`, and log the reason with a `LogThrottle`."""
        self.rejected += 1
        self._last_rejection = f'{source}: {reason}'
        self._rejections.log(f'rejected {self._last_rejection}')

    def fail(self, failure: str) -> None:
        """Count a failure of the node, and log it with a `LogThrottle`."""
        self.failed += 1
        self._last_failure = failure
        self._failures.log(failure)

    def guarded(self, source: str, take: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that calls `take` and catches all errors except MemoryError.

        ValueError and ArithmeticError count as a rejected message of `source`, other errors as
        failures.
        """

        @wraps(take)
        def take_or_reject(*args: Any) -> None:
            try:
                take(*args)
            except (ValueError, ArithmeticError) as error:
                self.reject(source, error)
            except MemoryError:
                raise
            except Exception as error:
                self.fail(f'could not process {source}: {describe_error(error)}')

        return take_or_reject

    def publish(self) -> None:
        """Publish the current report."""
        report = self._report()
        values, concerns = dict(report.values), []
        for monitor in self.monitors:
            concern, more = monitor()
            concerns += [concern] if concern else []
            values |= more
        values |= {'rejected': self.rejected, 'last rejection': self._last_rejection}
        if self.failed:
            values |= {'failed': self.failed, 'last failure': self._last_failure}
        _, rejected, failed = self._increments.take(self.rejected, self.failed)
        level, message = DiagnosticStatus.OK, '; '.join(concerns) or report.message
        if report.warning or concerns or rejected:
            level = DiagnosticStatus.WARN
        if failed:
            level, message = DiagnosticStatus.ERROR, f'{failed} failed: {self._last_failure}'
        elif rejected:
            message = f'{rejected} rejected: {self._last_rejection}'
        status = DiagnosticStatus(
            level=level,
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
