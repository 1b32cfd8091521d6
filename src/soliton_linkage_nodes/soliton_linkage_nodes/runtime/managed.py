# SPDX-License-Identifier: Apache-2.0
"""Nodes that are configured, activated, deactivated and cleaned up, by themselves or when told."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.runtime.diagnostics import Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown


@dataclass(frozen=True)
class ManagedParameters:
    """Parameters of every managed node."""

    autostart: bool = quantity(
        True, 'whether to configure and activate by itself, without a manager of lifecycles'
    )
    real_time: bool = quantity(
        False, 'whether to go before ordinary threads, where the system allows it, while it waits'
    )


class ManagedNode(GuardedNode, LifecycleNode):
    """A node with the lifecycle of ROS: unconfigured, inactive, active.

    A subclass says in `PARAMETERS` what is declared at once, and in four methods what is done:
    `configure` makes what takes long, topics too, `activate` begins, `deactivate` stops at once,
    `cleanup` closes what is no topic, service or timer: those that `configure` has made are
    destroyed after it. Where `configure` or `activate` raise ValueError or OSError, the node says
    why and stays as it was; a node that starts by itself raises that to who creates it.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {}

    def __init__(self, name: str, **kwargs: Any) -> None:
        """Declare the parameters and, unless a manager is to do it, configure and activate."""
        super().__init__(name, **kwargs)
        self._inactive = f'{self.get_name()} is not active; activate it first'
        self.active = False
        """Whether it does its work."""
        self.configured = False
        """Whether it has what it works with."""
        self._leaving = False
        self._failed_of: Exception | None = None
        self._of_all: set[Any] = set()
        managed = declare(self, ManagedParameters)
        self.real_time = managed.real_time
        self.starting = managed.autostart
        """Whether it is configuring and activating itself."""
        self.declare_parameters_of_node()
        reject_unknown(self)

        def follow(_changes: Any) -> None:
            if self.configured:
                self.follow_parameters()

        self.add_post_set_parameters_callback(self.guarded('take up parameters', follow))
        self._reject_impossible_transitions()
        if managed.autostart:
            self._start()

    def declare_parameters_of_node(self) -> None:
        """Declare all of `PARAMETERS`; ValueError where a value is not allowed."""
        for group, prefix in self.PARAMETERS.items():
            declare(self, group, prefix)

    def configure(self) -> None:
        """Make what takes long, and the topics."""

    def activate(self) -> None:
        """Begin."""

    def deactivate(self) -> None:
        """Stop at once; `active` is False already."""

    def cleanup(self) -> None:
        """Close what `configure` has opened."""

    def follow_parameters(self) -> None:
        """Take up what parameters have been changed to."""

    def while_active(self, take: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return what takes messages while the node is active, and lets others go."""

        def take_or_not(message: Any) -> None:
            if self.active:
                take(message)

        return take_or_not

    def check_active(self) -> None:
        """Raise ValueError where the node is not active."""
        if not self.active:
            raise ValueError(self._inactive)

    def reporting(self, report: Callable[[], Report]) -> Callable[[], Report]:
        """Return a report that says where the node is not active."""
        return lambda: report() if self.active else Report('not active')

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure, or leave nothing behind."""
        self._of_all = {each for kind in _DESTROYERS for each in getattr(self, kind)}
        self.configured = self._carried_out(self.configure)
        if not self.configured:
            self._destroy_what_was_made()
        return self._answer(self.configured, 'configured')

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate."""
        self.active = self._carried_out(self.activate)
        return self._answer(self.active, 'activated')

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate; nothing keeps it from that."""
        self.active = False
        self._carried_out(self.deactivate)
        return self._answer(True, 'deactivated')

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up; nothing keeps it from that."""
        self.configured = False
        self._carried_out(self.cleanup)
        self._destroy_what_was_made()
        return self._answer(True, 'cleaned up')

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate and clean up, as far as there is need to."""
        if self.active:
            self.on_deactivate(state)
        if self.configured:
            self.on_cleanup(state)
        return TransitionCallbackReturn.SUCCESS

    def destroy_node(self) -> None:
        """Deactivate and clean up, then go; raises what cleaning up raises."""
        self._leaving = True
        try:
            if self.active:
                self.trigger_deactivate()
            if self.configured:
                self.configured = False
                self.cleanup()
        finally:
            super().destroy_node()

    def _start(self) -> None:
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != TransitionCallbackReturn.SUCCESS:
                raise self._failed_of or RuntimeError(f'{self.get_name()} could not start')
        self.starting = False

    def _carried_out(self, act: Callable[[], None]) -> bool:
        try:
            act()
        except Exception as error:
            self._failed_of = error
            if not self.starting:
                expected = isinstance(error, (ValueError, OSError))
                self.get_logger().error(str(error) if expected else traceback.format_exc())
            return False
        return True

    def _answer(self, done: bool, what: str) -> TransitionCallbackReturn:
        if done and not self.starting and not self._leaving:
            self.get_logger().info(what)
        return TransitionCallbackReturn.SUCCESS if done else TransitionCallbackReturn.FAILURE

    def _destroy_what_was_made(self) -> None:
        self._unattended = frozenset()
        for kind, destroy in _DESTROYERS.items():
            for entity in [each for each in getattr(self, kind) if each not in self._of_all]:
                destroy(self, entity)

    def _reject_impossible_transitions(self) -> None:
        """Answer a transition that is impossible in this state; rclpy raises into the executor.

        Without this any client that asks for one ends the node.
        """
        name = self.resolve_service_name('~/change_state')
        (service,) = (each for each in self.services if each.service_name == name)
        change = service.callback

        def change_or_reject(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except rclpy_implementation.RCLError:
                asked = request.transition.label or request.transition.id
                _, state = self._state_machine.current_state
                self.get_logger().warning(f'no transition {asked} from state {state}')
                response.success = False
                return response

        service.callback = change_or_reject


_DESTROYERS: dict[str, Callable[[Any, Any], Any]] = {
    'timers': Node.destroy_timer,
    'subscriptions': Node.destroy_subscription,
    'services': Node.destroy_service,
    'clients': Node.destroy_client,
    'publishers': Node.destroy_publisher,
}
"""How a node destroys what it has of each kind; those that call it back go first."""
