# SPDX-License-Identifier: Apache-2.0
"""Lifecycle nodes, which activate themselves or are activated by a lifecycle manager."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.runtime.command_line import executable_name
from soliton_linkage_nodes.runtime.diagnostics import Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import Parameters, current, declare, reject_unknown


@dataclass(frozen=True)
class ManagedParameters:
    """Parameters of every managed node."""

    autostart: bool = quantity(
        True, 'whether the node configures and activates itself, without a lifecycle manager'
    )
    real_time: bool = quantity(
        False,
        'whether the node has real-time priority while it is mostly idle, if the system allows it',
    )


class ManagedNode(GuardedNode, LifecycleNode):
    """Node with the lifecycle of ROS: unconfigured, inactive, active.

    A subclass lists its parameters in `PARAMETERS` and overrides `configure`, `activate`,
    `deactivate` and `cleanup`. After `cleanup`, the node destroys the topics, timers and services
    that were created since `configure` began. If `configure` or `activate` raises an error, the
    node logs the error and keeps its previous state. If the parameter `autostart` is true, the
    constructor configures and activates the node. It then raises an error of these two steps
    instead of logging it.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {}

    def __init__(self, name: str = '', **kwargs: Any) -> None:
        """Start the node, by default with the name of its executable."""
        super().__init__(name or executable_name(type(self)), **kwargs)
        self.active = False
        self.configured = False
        self._leaving = False
        self._start_error: Exception | None = None
        self._permanent: set[Any] = set()
        managed = declare(self, ManagedParameters)
        self.real_time = managed.real_time
        self.starting = managed.autostart
        self.declare_parameters_of_node()
        reject_unknown(self)

        def follow(_changes: Any) -> None:
            if self.configured:
                self.follow_parameters()

        self.add_post_set_parameters_callback(self.guarded('apply parameters', follow))
        self._reject_impossible_transitions()
        if managed.autostart:
            self._start()

    def declare_parameters_of_node(self) -> None:
        """Declare the parameters in `PARAMETERS`; ValueError if a value is not allowed."""
        for group, prefix in self.PARAMETERS.items():
            declare(self, group, prefix)

    def current(self, group: type[Parameters]) -> Parameters:
        """Return an instance of a dataclass in `PARAMETERS` with the current values."""
        return current(self, group, self.PARAMETERS[group])

    def configure(self) -> None:
        """Create the topics and perform slow preparations."""

    def activate(self) -> None:
        """Start the work of the node."""

    def deactivate(self) -> None:
        """Stop the work immediately. `active` is already False when this method is called."""

    def cleanup(self) -> None:
        """Close what `configure` has opened, except topics, timers and services."""

    def follow_parameters(self) -> None:
        """Apply changed parameters.

        The node calls this method after each change while its state is inactive or active.
        """

    def while_active(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback that passes messages to `take` only while the node is active."""

        def take_or_drop(message: Any) -> None:
            if self.active:
                take(message)

        return take_or_drop

    def check_active(self) -> None:
        """Raise ValueError unless the node is active."""
        if not self.active:
            raise ValueError(f'{self.get_name()} is not active; activate it first')

    def reporting(self, report: Callable[[], Report]) -> Callable[[], Report]:
        """Return a function that calls `report`, or reports 'not active' for an inactive node."""
        return lambda: report() if self.active else Report('not active')

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure the node. If this fails, destroy the topics, timers and services created."""
        self._permanent = {each for kind in _DESTROYERS for each in getattr(self, kind)}
        self.configured = self._run(self.configure)
        if not self.configured:
            self._destroy_entities()
        return self._answer(self.configured, 'configured')

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate the node."""
        self.active = self._run(self.activate)
        return self._answer(self.active, 'activated')

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate the node, even if `deactivate` raises an error."""
        self.active = False
        self._run(self.deactivate)
        return self._answer(True, 'deactivated')

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up, even if `cleanup` raises an error."""
        self.configured = False
        self._run(self.cleanup)
        self._destroy_entities()
        return self._answer(True, 'cleaned up')

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate an active node and clean up a configured one."""
        if self.active:
            self.on_deactivate(state)
        if self.configured:
            self.on_cleanup(state)
        return TransitionCallbackReturn.SUCCESS

    def destroy_node(self) -> None:
        """Deactivate, clean up and destroy the node. Raises the exceptions of `cleanup`."""
        self._leaving = True
        try:
            if self.active:
                self.trigger_deactivate()
            if self.configured:
                self.configured = False
                self.cleanup()
        finally:
            super().destroy_node()
            # LifecycleNode does not destroy its state machine, which keeps the node in the graph
            # and the threads of the middleware running while the process ends.
            self._state_machine.destroy_when_not_in_use()

    def _start(self) -> None:
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != TransitionCallbackReturn.SUCCESS:
                raise self._start_error or RuntimeError(f'{self.get_name()} could not start')
        self.starting = False

    def _run(self, act: Callable[[], None]) -> bool:
        try:
            act()
        except Exception as error:
            self._start_error = error
            if not self.starting:
                expected = isinstance(error, (ValueError, OSError))
                self.get_logger().error(str(error) if expected else traceback.format_exc())
            return False
        return True

    def _answer(self, done: bool, state: str) -> TransitionCallbackReturn:
        if done and not self.starting and not self._leaving:
            self.get_logger().info(state)
        return TransitionCallbackReturn.SUCCESS if done else TransitionCallbackReturn.FAILURE

    def _destroy_entities(self) -> None:
        self._undispatched = frozenset()
        for kind, destroy in _DESTROYERS.items():
            for entity in [each for each in getattr(self, kind) if each not in self._permanent]:
                destroy(self, entity)

    def _reject_impossible_transitions(self) -> None:
        """Reject requests for impossible transitions, which would end the process in Jazzy."""
        service = self._service_change_state
        change = service.callback

        def change_or_reject(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except rclpy_implementation.RCLError:
                transition = request.transition.label or request.transition.id
                _, state = self._state_machine.current_state
                self.get_logger().warning(
                    f'rejected transition {transition}, which state {state} does not allow; '
                    '~/get_available_transitions lists the allowed transitions'
                )
                response.success = False
                return response

        service.callback = change_or_reject


_DESTROYERS: dict[str, Callable[[Any, Any], Any]] = {
    'timers': Node.destroy_timer,
    'subscriptions': GuardedNode.destroy_subscription,
    'services': Node.destroy_service,
    'clients': Node.destroy_client,
    'publishers': Node.destroy_publisher,
}
"""Functions that destroy each kind of entity. Timers and subscriptions come first, because their
callbacks may use the other entities."""
