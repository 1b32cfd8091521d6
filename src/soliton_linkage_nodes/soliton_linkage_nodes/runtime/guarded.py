# SPDX-License-Identifier: Apache-2.0
"""Nodes that continue after an exception in a callback."""

from __future__ import annotations

import difflib
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import wraps
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

SERVICE_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Of services and their clients: that of ROS keeps ten calls, and loses more that come at once.
Each client of a service hears the answers to all others too, and keeps as few."""
ACTION_QOS = {f'{call}_service_qos_profile': SERVICE_QOS for call in ('goal', 'result', 'cancel')}
"""The same of an action and its clients."""


def describe_error(error: BaseException) -> str:
    """An error that nobody expected, and where it was raised, in a line."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f' ({Path(frames[-1].filename).name}:{frames[-1].lineno})' if frames else ''
    return f'{type(error).__name__}: {" ".join(str(error).split())}{where}'


def unknown(node: Node, name: str, known: Iterable[str]) -> str:
    """Complaint about a parameter that a node has not declared."""
    near = difflib.get_close_matches(name, list(known), n=1)
    meant = f'did you mean {near[0]!r}?' if near else f'known: {", ".join(sorted(known))}'
    return f'parameter {name!r} of {node.get_name()} is unknown; {meant}'


class GuardedNode(Node):
    """Node that drops the message, logs and continues if a callback raises, except MemoryError."""

    _unattended: frozenset[Subscription] = frozenset()
    _ends: Mapping[Subscription, Callable[[], None]] = {}

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions that executors call back for."""
        return (each for each in super().subscriptions if each not in self._unattended)

    def dispatch(self, subscription: Subscription, dispatched: bool) -> None:
        """Have executors call back for each message of a subscription, or leave them waiting.

        To be woken for each of a thousand messages a second costs more than to take them.
        """
        this = frozenset([subscription])
        self._unattended = self._unattended - this if dispatched else self._unattended | this
        if self.executor is not None:
            self.executor.wake()

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription, dispatched to or not."""
        self._unattended -= {subscription}
        if subscription in self._ends:
            self._ends[subscription]()
            self._ends = {each: end for each, end in self._ends.items() if each != subscription}
        return bool(super().destroy_subscription(subscription))

    def before_destroying(self, subscription: Subscription, end: Callable[[], None]) -> None:
        """Have something end before a subscription does."""
        self._ends = {**self._ends, subscription: end}

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., Any], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a subscription of which a message may be too much."""
        guarded = self.guarded(f'take a message of {topic}', callback)
        return super().create_subscription(msg_type, topic, guarded, *args, **kwargs)

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], Any], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a timer of which an instant may be too much."""
        guarded = self.guarded('act on a timer', callback)
        timer: Any = None

        def act() -> None:
            # Executors call once more for what was due when it was destroyed.
            if timer is None or timer in self.timers:
                guarded()

        timer = super().create_timer(timer_period_sec, act, *args, **kwargs)
        return timer

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **kwargs: Any
    ) -> Any:
        """Create a service that keeps many calls, of which one may be too much."""

        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except MemoryError:
                raise
            except Exception as error:
                reason = self.fail(f'answer {srv_name}', error)
                return _refusing(request, response, reason)

        return super().create_service(
            srv_type, srv_name, answer, **{'qos_profile': SERVICE_QOS, **kwargs}
        )

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all parameters or none; what was not declared is refused by its name."""
        for parameter in parameter_list:
            if not self.has_parameter(parameter.name):
                known = self.get_parameters_by_prefix('')
                reason = unknown(self, parameter.name, known)
                return SetParametersResult(successful=False, reason=reason)
        return super().set_parameters_atomically(parameter_list)

    def guarded(self, what: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that may fail of what it does."""

        @wraps(call)
        def call_or_fail(*args: Any) -> None:
            try:
                call(*args)
            except MemoryError:
                raise
            except Exception as error:
                self.fail(what, error)

        return call_or_fail

    def fail(self, what: str, error: Exception) -> str:
        """Count a failure and say it in one line, which is returned."""
        failure = f'could not {what}: {describe_error(error)}'
        diagnostics = getattr(self, 'diagnostics', None)
        if diagnostics is None:
            self.get_logger().error(failure)
        else:
            diagnostics.fail(failure)
        return failure


def _refusing(request: Any, response: Any, reason: str) -> Any:
    """Return a response that refuses a request, as far as it has fields for that."""
    if hasattr(response, 'success'):
        response.success = False
    for text in ('message', 'reason'):
        if hasattr(response, text):
            setattr(response, text, reason)
    if hasattr(response, 'results') and hasattr(request, 'parameters'):
        refusal = SetParametersResult(successful=False, reason=reason)
        response.results = [refusal for _ in request.parameters]
    return response
