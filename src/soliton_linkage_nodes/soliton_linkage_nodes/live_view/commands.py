# SPDX-License-Identifier: Apache-2.0
"""Commands of a page to the nodes of a chain."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from action_msgs.srv import CancelGoal
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.messages import view_conversions as views
from soliton_linkage_nodes.messages.view_conversions import AdjustableParameter
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.guarded import ACTION_QOS, SERVICE_QOS

_LONGEST_ANSWER = 10.0
"""Longest time for the answer of a service [s]."""
_LONGEST_PARAMETERS = 3.0
"""Longest time for the parameter services of a node to appear [s]."""
_POLL_INTERVAL = 0.05
"""Poll interval for a node [s]."""
READ_ONLY = 'this page is read-only; start live_view with read_only:=false to act'
"""Reason of a rejection."""

_SERVICES = {
    'simulator/pause': SetBool,
    'simulator/step': Step,
    'simulator/reset': Reset,
    'soliton_steering/release': Trigger,
    'chain_identifier/identify': Trigger,
    'chain_identifier/save': Trigger,
    'chain_identifier/forget': Trigger,
}


@dataclass
class Move:
    """The last move, requested by this page or elsewhere."""

    state: str = ''
    """Empty before the first move, then 'under way', or the outcome."""
    goal: float = math.nan
    """Goal [rotor spacings]."""
    begun: float = math.nan
    """Initial site coordinate of the soliton [rotor spacings]."""
    rotor: float = math.nan
    """Present site coordinate of the soliton [rotor spacings]."""
    message: str = ''
    elsewhere: bool = False
    """Whether another client requested it."""
    handle: Any = field(default=None, repr=False)

    @property
    def under_way(self) -> bool:
        """Whether the move has not ended."""
        return self.state == 'under way'

    @property
    def progress(self) -> float:
        """Share of the way, 0 to 1."""
        way = self.goal - self.begun
        if not (math.isfinite(way) and math.isfinite(self.rotor) and way):
            return 0.0
        return min(max((self.rotor - self.begun) / way, 0.0), 1.0)


class ChainCommands:
    """Commands to the nodes of one namespace. Each raises ValueError if it is rejected."""

    def __init__(self, node: Node, namespace: str, read_only: bool) -> None:
        """Connect to the nodes of a namespace, which ends in a slash."""
        self.namespace = namespace
        self.move = Move()
        self._asked = False
        self._begun = ''
        self._followed = 0.0
        self._node = node
        self.read_only = read_only
        self._clients: dict[str, Client] = {}
        self._publishers: dict[str, Any] = {}
        self._mover: ActionClient | None = None
        if not read_only:
            for topic in (interfaces.NUDGE, interfaces.EDGE_COMMAND, interfaces.TILT):
                self._publishers[topic.name] = node.create_publisher(
                    topic.type, f'{namespace}{topic.name}', topic.qos
                )
            self._mover = ActionClient(
                node, MoveSoliton, f'{namespace}{interfaces.MOVE_SOLITON}', **ACTION_QOS
            )
            for name, service_type in _SERVICES.items():
                self._client(f'{namespace}{name}', service_type)

    def listeners(self, topic: str) -> int:
        """Return the number of subscribers of nudge, edge_command or tilt."""
        publisher = self._publishers.get(topic)
        return publisher.get_subscription_count() if publisher else 0

    def serves(self, name: str) -> bool:
        """Return whether the action move_soliton or a service of the namespace has a server."""
        if name == interfaces.MOVE_SOLITON:
            return self._mover is not None and bool(self._mover.server_is_ready())
        client = self._clients.get(f'{self.namespace}{name}')
        return client is not None and bool(client.service_is_ready())

    def check_writable(self) -> None:
        """Raise ValueError if the page is read-only."""
        if self.read_only:
            raise ValueError(READ_ONLY)

    def nudge(self, speed: float) -> str:
        """Nudge the edge [rad/s]."""
        self._publish('nudge', views.number_to_msg(speed), 'edge_actuator')
        return f'nudged with {speed:g} rad/s'

    def drive(self, kind: str, edge: str, value: float, times: tuple[float, float, float]) -> str:
        """Send an edge_command; the times are duration, ramp up and ramp down [s]."""
        command = views.edge_command_of(kind, edge, value, *times)
        self._publish('edge_command', command, 'edge_actuator')
        unit = {'kick': 'rad/s', 'pulse': 'N m', 'pressure': 'Pa'}[kind]
        return f'{kind} of {value:g} {unit} sent'

    def tilt(self, angle: float) -> str:
        """Tilt the chain [rad]."""
        self._publish('tilt', views.number_to_msg(angle), 'simulator')
        return f'tilted to {angle:.3f} rad'

    async def pause(self, paused: bool) -> str:
        """Pause or resume the simulation."""
        request = SetBool.Request(data=paused)
        return await self._ask('simulator/pause', SetBool, request)

    async def step(self, periods: float) -> str:
        """Advance a paused simulation by some periods."""
        return await self._ask('simulator/step', Step, views.step_request(periods))

    async def reset(
        self,
        state: str,
        place: float = 0.0,
        velocity: float = 0.0,
        joints: Mapping[str, float] | None = None,
    ) -> str:
        """Put the chain into a state."""
        request = views.reset_request(state, place, velocity, joints)
        return await self._ask('simulator/reset', Reset, request)

    async def release(self) -> str:
        """Release the held soliton."""
        return await self._ask('soliton_steering/release', Trigger, Trigger.Request())

    async def of_identifier(self, what: str) -> str:
        """Call a service of the chain identifier: `identify`, `save` or `forget`."""
        return await self._ask(f'chain_identifier/{what}', Trigger, Trigger.Request())

    async def carry(self, rotor: float, speed: float, now: float) -> str:
        """Move the soliton to a rotor from its present site coordinate [rotor spacings]."""
        self.check_writable()
        goal = views.move_goal(rotor, speed)
        if self._mover is None or not self._mover.server_is_ready():
            raise ValueError('nothing serves move_soliton; start soliton_steering first')
        move = Move('under way', rotor, now, now, f'on the way to rotor {rotor:.2f}')
        mover, previous = self._mover, self.move

        def heed(message: Any) -> None:
            move.rotor = message.feedback.rotor

        def begin() -> Any:
            sent = mover.send_goal_async(goal, feedback_callback=heed)
            # On the executor's thread, so that no answer can precede the callback.
            sent.add_done_callback(lambda taken: _await_end(move, taken.result()))
            return sent

        self.move = move
        sent = await self._answered(begin)
        if sent is None or not sent.accepted:
            self.move = previous
            raise ValueError('move_soliton did not take the goal')
        self._asked = True
        return move.message

    def follow(self, came: float, figures: Mapping[str, str]) -> None:
        """Show a move of another client, from a report of the steering and its time."""
        if came <= self._followed or 'moves begun' not in figures:
            return
        self._followed = came
        goal, start = (views.figure(figures, f'move {way} rotor') for way in ('to', 'from'))
        own = self._asked or (self.move.under_way and not self.move.elsewhere)
        before, self._begun = self._begun, figures['moves begun']
        self._asked = False
        if not own and before != self._begun and (before or math.isfinite(goal)):
            self.move = Move('under way', goal, start, start, elsewhere=True)
        if self.move.elsewhere and self.move.under_way and not math.isfinite(goal):
            self.move.state, _, self.move.message = figures.get('last move', '').partition(': ')

    async def cancel(self) -> str:
        """Cancel the move that is under way."""
        self.check_writable()
        move = self.move
        if move.elsewhere and move.under_way:
            # A request without a goal cancels all goals.
            name = f'{self.namespace}{interfaces.MOVE_SOLITON}/_action/cancel_goal'
            await self.call(name, CancelGoal, CancelGoal.Request())
            return 'cancelling'
        while move.handle is None and move.under_way:
            # The goal waits for acceptance.
            await asyncio.sleep(_POLL_INTERVAL)
        if not move.under_way:
            raise ValueError('no move is under way')
        await self._answered(move.handle.cancel_goal_async)
        return 'cancelling'

    async def parameters(self, node: str) -> list[AdjustableParameter]:
        """Return the adjustable parameters of a node, given its full name."""
        listed = await self._of_node(node, ListParameters, ListParameters.Request())
        names = sorted(listed.result.names)
        request = DescribeParameters.Request(names=names)
        described = (await self._of_node(node, DescribeParameters, request)).descriptors
        # One parameter without a value makes a node return no value at all.
        found = [one for one in described if views.is_adjustable(one)]
        request = GetParameters.Request(names=[one.name for one in found])
        values = (await self._of_node(node, GetParameters, request)).values
        return views.adjustable_parameters(found, values)

    async def set_parameter(self, node: str, parameter: AdjustableParameter, value: Any) -> str:
        """Set a parameter of a node."""
        self.check_writable()
        change = Parameter(name=parameter.name, value=views.parameter_value(parameter, value))
        request = SetParameters.Request(parameters=[change])
        (result,) = (await self._of_node(node, SetParameters, request)).results
        if not result.successful:
            raise ValueError(result.reason or f'{node} refused {parameter.name} = {value}')
        return f'{parameter.name} = {value}'

    async def call(self, name: str, service_type: Any, request: Any) -> Any:
        """Return the answer of a service by its full name; raise ValueError without a server."""
        client = self._client(name, service_type)
        if not client.service_is_ready():
            raise ValueError(f'nothing serves {name}')
        return await self._answered(lambda: client.call_async(request))

    def close(self) -> None:
        """Disconnect from the nodes."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        for client in self._clients.values():
            self._node.destroy_client(client)
        if self._mover is not None:
            self._mover.destroy()

    async def _ask(self, name: str, service_type: Any, request: Any) -> str:
        self.check_writable()
        answer = await self.call(f'{self.namespace}{name}', service_type, request)
        if not answer.success:
            raise ValueError(answer.message)
        return str(answer.message)

    async def _of_node(self, node: str, service_type: Any, request: Any) -> Any:
        names = {
            ListParameters: 'list_parameters',
            DescribeParameters: 'describe_parameters',
            GetParameters: 'get_parameters',
            SetParameters: 'set_parameters',
        }
        client = self._client(f'{node}/{names[service_type]}', service_type)
        for _ in range(int(_LONGEST_PARAMETERS / _POLL_INTERVAL)):
            if client.service_is_ready():
                return await self._answered(lambda: client.call_async(request))
            await asyncio.sleep(_POLL_INTERVAL)
        raise ValueError(f'{node} does not tell its parameters')

    async def _answered(self, ask: Callable[[], Any]) -> Any:
        """Return the result of a future of ROS that `ask` creates on the executor's thread."""
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[Any] = loop.create_future()

        def finish(future: Any) -> None:
            loop.call_soon_threadsafe(_settle, answered, future)

        executor = self._node.executor
        if executor is None:
            raise ValueError('live_view is not being spun')
        executor.create_task(lambda: ask().add_done_callback(finish))
        try:
            return await asyncio.wait_for(answered, _LONGEST_ANSWER)
        except asyncio.TimeoutError as error:
            raise ValueError(f'no answer came within {_LONGEST_ANSWER:g} s') from error

    def _client(self, name: str, service_type: Any) -> Client:
        if name not in self._clients:
            self._clients[name] = self._node.create_client(
                service_type, name, qos_profile=SERVICE_QOS
            )
        return self._clients[name]

    def _publish(self, topic: str, message: Any, listener: str) -> None:
        self.check_writable()
        if not self.listeners(topic):
            raise ValueError(f'nothing subscribes to {topic}; start {listener} first')
        self._publishers[topic].publish(message)


def _await_end(move: Move, handle: Any) -> None:
    if handle is not None and handle.accepted:
        move.handle = handle
        handle.get_result_async().add_done_callback(lambda done: _conclude(move, done.result()))


def _conclude(move: Move, ended: Any) -> None:
    result = ended.result
    move.state = views.OUTCOMES.get(result.outcome, f'outcome {result.outcome}')
    move.message, move.rotor = result.message, result.rotor


def _settle(answered: asyncio.Future[Any], future: Any) -> None:
    if answered.done():
        return
    error = future.exception()
    if error is not None:
        answered.set_exception(ValueError(str(error)))
    else:
        answered.set_result(future.result())
