# SPDX-License-Identifier: Apache-2.0
"""Nodes that continue after an exception in a callback."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Mapping
from functools import wraps
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from soliton_linkage_nodes.runtime.parameters import rejection, unknown_parameter

SERVICE_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Quality of service of services. The default queue of 10 would lose simultaneous responses."""
ACTION_QOS = {f'{call}_service_qos_profile': SERVICE_QOS for call in ('goal', 'result', 'cancel')}


def describe_error(error: BaseException) -> str:
    """Describe an unexpected error and its line of code, in one line of text."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f' ({Path(frames[-1].filename).name}:{frames[-1].lineno})' if frames else ''
    return f'{type(error).__name__}: {" ".join(str(error).split())}{where}'


class GuardedNode(Node):
    """Node that logs an exception of a callback, except MemoryError, and drops the message."""

    _undispatched: frozenset[Subscription] = frozenset()
    _finalisers: Mapping[Subscription, Callable[[], None]] = {}

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions for executors, without those whose messages the node takes itself."""
        return (each for each in super().subscriptions if each not in self._undispatched)

    def dispatch(self, subscription: Subscription, dispatched: bool) -> None:
        """Set whether executors take the messages of a subscription.

        If not, the node must take the messages itself, which is faster.
        """
        this = frozenset([subscription])
        self._undispatched = self._undispatched - this if dispatched else self._undispatched | this
        if self.executor is not None:
            self.executor.wake()

    def destroy_subscription(self, subscription: Subscription) -> bool:
        """Destroy a subscription, whether or not executors take its messages."""
        self._undispatched -= {subscription}
        if subscription in self._finalisers:
            self._finalisers[subscription]()
            self._finalisers = {k: v for k, v in self._finalisers.items() if k != subscription}
        return bool(super().destroy_subscription(subscription))

    def before_destroying(self, subscription: Subscription, finalise: Callable[[], None]) -> None:
        """Register the function `finalise` to be called before the subscription is destroyed."""
        self._finalisers = {**self._finalisers, subscription: finalise}

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., Any], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a subscription that logs an exception of the callback."""
        guarded = self.guarded(f'process a message of {topic}', callback)
        return super().create_subscription(msg_type, topic, guarded, *args, **kwargs)

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], Any], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a timer that logs an exception of the callback.

        By default, the timer uses a steady clock.
        """
        guarded = self.guarded('run a timer', callback)
        timer: Any = None

        def act() -> None:
            # If the timer was due when it was destroyed, an executor still calls this function.
            if timer is None or timer in self.timers:
                guarded()

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timer = super().create_timer(timer_period_sec, act, *args, **{'clock': steady, **kwargs})
        return timer

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **kwargs: Any
    ) -> Any:
        """Create a service that logs an exception of the callback and responds with a failure."""

        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except MemoryError:
                raise
            except Exception as error:
                return _reject(request, response, self.fail(f'answer {srv_name}', error))

        return super().create_service(
            srv_type, srv_name, answer, **{'qos_profile': SERVICE_QOS, **kwargs}
        )

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all parameters, or none if any of them is rejected or unknown."""
        for parameter in parameter_list:
            if not self.has_parameter(parameter.name):
                known = self.get_parameters_by_prefix('')
                reason = unknown_parameter(self, parameter.name, known)
                return SetParametersResult(successful=False, reason=reason)
        result = super().set_parameters_atomically(parameter_list)
        if not result.successful:
            # The reasons that rclpy returns contain neither the value nor a remedy.
            reasons = (rejection(self.describe_parameter(p.name), p.value) for p in parameter_list)
            result.reason = next(filter(None, reasons), result.reason)
        return result

    def guarded(self, action: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that logs an exception of `call` as 'could not <action>: <error>'."""

        @wraps(call)
        def call_or_fail(*args: Any) -> None:
            try:
                call(*args)
            except MemoryError:
                raise
            except Exception as error:
                self.fail(action, error)

        return call_or_fail

    def fail(self, action: str, error: Exception) -> str:
        """Count a failure, log it in one line, and return this line."""
        failure = f'could not {action}: {describe_error(error)}'
        diagnostics = getattr(self, 'diagnostics', None)
        (self.get_logger().error if diagnostics is None else diagnostics.fail)(failure)
        return failure


def _reject(request: Any, response: Any, reason: str) -> Any:
    if hasattr(response, 'success'):
        response.success = False
    for text in ('message', 'reason'):
        if hasattr(response, text):
            setattr(response, text, reason)
    if hasattr(response, 'results') and hasattr(request, 'parameters'):
        rejection = SetParametersResult(successful=False, reason=reason)
        response.results = [rejection for _ in request.parameters]
    return response
