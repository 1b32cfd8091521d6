# SPDX-License-Identifier: Apache-2.0
"""Commands that the page sends to the nodes of a chain."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from action_msgs.srv import CancelGoal
from rcl_interfaces.msg import Parameter, ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.action import ActionClient
from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder, ChainTopics
from soliton_linkage_nodes.live_view.moves import UNDER_WAY, Move, Pull, await_end
from soliton_linkage_nodes.messages import view_conversions as views
from soliton_linkage_nodes.messages.view_conversions import AdjustableParameter, NodeReport
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.guarded import ACTION_QOS, SERVICE_QOS

_ANSWER_TIMEOUT = 60.0
"""Longest wait for the answer to a command [s]. The page shows a warning after 2 s."""
_ACCEPTED_TIME = 2.0
"""Longest wait until last_kick reports the effect of an accepted command [s]. After this time the
answer only states that edge_actuator accepted the command."""
_PARAMETERS_TIMEOUT = 3.0
"""Longest wait until the parameter services of a node are available [s]."""
_POLL_INTERVAL = 0.02
"""Poll interval for an answer [s]."""
_TILT_RESOLUTION = 1e-5
"""Difference between requested and reported tilt below which the tilt counts as reached [rad]."""
_MOVES = 0.5
"""Speed above which a released soliton counts as moving [rotor spacings/s]."""
_CARRIED_OUT = 'commands carried out'
"""Name under which edge_actuator reports the number of executed commands."""
READ_ONLY = 'this page is read-only; start live_view with read_only:=false to send commands'
_PUBLISHED = (
    *(interfaces.NUDGE, interfaces.EDGE_COMMAND, interfaces.TILT, interfaces.JOINT_COMMANDS),
)
_SERVICES = {
    'simulator/pause': SetBool,
    'simulator/step': Step,
    'simulator/reset': Reset,
    'soliton_steering/release': Trigger,
    **{f'chain_identifier/{name}': Trigger for name in ('identify', 'save', 'forget')},
}
_PARAMETER_SERVICES = {
    ListParameters: 'list_parameters',
    DescribeParameters: 'describe_parameters',
    GetParameters: 'get_parameters',
    SetParameters: 'set_parameters',
}


class ChainCommands:
    """Commands to the nodes in a namespace. A rejected command raises ValueError."""

    def __init__(self, node: Node, namespace: str, read_only: bool, finder: ChainFinder) -> None:
        self.namespace = namespace
        self.read_only = read_only
        self.move = Move()
        self.holding = False
        self._finder = finder
        self._edge = asyncio.Lock()
        self._tilt = math.nan
        self._requested = False
        self._moves_started = ''
        self._reported_at = 0.0
        self._node = node
        self._clients: dict[str, Client] = {}
        self._publishers: dict[str, Any] = {}
        self._mover: ActionClient | None = None
        if not read_only:
            for topic in _PUBLISHED:
                self._publishers[topic.name] = node.create_publisher(
                    topic.type, f'{namespace}{topic.name}', topic.qos
                )
            self._mover = ActionClient(
                node, MoveSoliton, f'{namespace}{interfaces.MOVE_SOLITON}', **ACTION_QOS
            )
            for name, service_type in _SERVICES.items():
                self._client(f'{namespace}{name}', service_type)

    def subscribers(self, topic: str) -> int:
        """Return the number of subscribers of a command topic, such as nudge or edge_command."""
        publisher = self._publishers.get(topic)
        return publisher.get_subscription_count() if publisher else 0

    def reaches(self, name: str) -> bool:
        """Return whether a node subscribes to, or serves, the topic, service or action `name`."""
        if name in self._publishers:
            return self.subscribers(name) > 0
        if name == interfaces.MOVE_SOLITON:
            return self._mover is not None and bool(self._mover.server_is_ready())
        client = self._clients.get(f'{self.namespace}{name}')
        return client is not None and bool(client.service_is_ready())

    def check_writable(self) -> None:
        """Raise ValueError if the page is read-only."""
        if self.read_only:
            raise ValueError(READ_ONLY)

    async def nudge(self, speed: float) -> str:
        """Publish a nudge with an angular speed [rad/s]."""
        return await self._send('nudge', views.number_to_msg(speed))

    async def drive(
        self, kind: str, edge: str, value: float, times: tuple[float, float, float], **wave: Any
    ) -> str:
        """Publish an edge_command. `edge_command_of` describes `kind`, `edge` and `value`.

        `times` are duration, ramp up and ramp down [s]. `wave` contains those fields that only a
        waveform has, such as `shape` and `frequency`.
        """
        message = views.edge_command_of(kind, edge, value, *times, **wave)
        lasting = any(times) or bool(wave)
        return await self._send('edge_command', message, lasting)

    async def pull(self, pull: Pull, updated: Callable[[], Awaitable[None]]) -> str:
        """Release the soliton if soliton_steering holds it. Pull a rotor while `pull.held` is set.

        `updated` waits for new messages. After it returns, the torque is computed again.
        """
        self.check_writable()
        chain = self._chain
        named = chain.model.named if chain else None
        if chain is None or named is None:
            raise ValueError('the chain is unknown: no node publishes the topic chain')
        if not 0 <= pull.rotor < named.rotors:
            raise ValueError(f'rotor {pull.rotor} must lie in the range 0 to {named.rotors - 1}')
        if self.move.under_way:
            raise ValueError('a move of the soliton is under way; cancel it first')
        if self.holding or self.move.held:
            await self.release()
        joint = named.joint_names[pull.rotor]
        limit = await self._torque_limit(joint)
        topic = interfaces.JOINT_COMMANDS.name

        async def act() -> None:
            try:
                while pull.held:
                    model = chain.model
                    torque = pull.torque(named.chain, model.angles, model.rates, limit)
                    self._publish(topic, views.torque_to_msg(joint, torque), 'edge_actuator')
                    await updated()
            finally:
                self._publishers[topic].publish(views.torque_to_msg(joint, 0.0))

        return await self._actuate(topic, act)

    async def _torque_limit(self, joint: str) -> float:
        for name in (f'torque_limits.{joint}', 'torque_limit'):
            request = GetParameters.Request(names=[name])
            node = f'{self.namespace}edge_actuator'
            values = (await self._call_parameters(node, GetParameters, request)).values
            if values and values[0].type == ParameterType.PARAMETER_DOUBLE:
                return float(values[0].double_value)
        raise ValueError(f'edge_actuator has no torque limit for {joint}')

    async def tilt(self, angle: float) -> str:
        """Set a tilt [rad], positive if rotor 0 is up; return '' if a newer tilt replaces it."""
        message = views.number_to_msg(angle)
        before = self._report('simulator')
        self._publish('tilt', message, 'simulator')
        self._tilt = angle

        def answer() -> str | None:
            report = self._report('simulator')
            if self._tilt != angle:
                return ''
            if rejection := _new_rejection(before, report, 'tilt'):
                raise ValueError(f'simulator rejected the tilt: {rejection}')
            tilt = views.figure(report.figures, 'tilt [rad]') if report else math.nan
            return f'tilt of {tilt:.4g} rad' if abs(tilt - angle) < _TILT_RESOLUTION else None

        return await self._until(answer, 'simulator')

    async def pause(self, paused: bool) -> str:
        """Pause or resume the simulation."""
        return await self._call_own('simulator/pause', SetBool.Request(data=paused))

    async def step(self, periods: float) -> str:
        """Advance a paused simulation by a number of publishing periods."""
        return await self._call_own('simulator/step', views.step_request(periods))

    async def reset(
        self,
        state: str,
        position: float = 0.0,
        velocity: float = 0.0,
        joints: Mapping[str, float] | None = None,
    ) -> str:
        """Reset the simulated chain to the state with the name `state`.

        The state 'soliton' uses `position` [rotor spacings] and `velocity` [m/s]. The state
        'angles' uses the angles of `joints` [rad].
        """
        request = views.reset_request(state, position, velocity, joints)
        answer = await self._call_own('simulator/reset', request)
        self._forget_move()
        return answer

    async def release(self) -> str:
        """Release the held soliton."""
        answer = await self._call_own('soliton_steering/release', Trigger.Request())
        self.holding = False
        self._forget_move()
        chain = self._chain
        speed = chain.model.numbers.get('velocity', 0.0) if chain else 0.0
        spacing = chain.model.named.chain.spacing if chain and chain.model.named else 1.0
        moves = abs(speed) > _MOVES * spacing
        return f'{answer}: {"it moves on freely" if moves else "it rests here until pushed"}'

    async def call_identifier(self, name: str) -> str:
        """Call a service of the chain identifier: `identify`, `save` or `forget`."""
        return await self._call_own(f'chain_identifier/{name}', Trigger.Request())

    async def move_to(self, rotor: float, speed: float, position: float) -> str:
        """Move the soliton to the site coordinate `rotor` [rotor spacings].

        `position` is the present site coordinate, at which the shown progress starts. If `speed`
        [rotor spacings/s] is 0, soliton_steering chooses the speed.
        """
        self.check_writable()
        goal = views.move_goal(rotor, speed)
        if self._mover is None or not self._mover.server_is_ready():
            raise ValueError('no node serves move_soliton; start soliton_steering')
        move = Move(UNDER_WAY, rotor, position, position)
        mover = self._mover
        started = False

        def on_feedback(message: Any) -> None:
            nonlocal started
            move.rotor, started = message.feedback.rotor, True

        def send() -> Any:
            sent = mover.send_goal_async(goal, feedback_callback=on_feedback)
            # Add the callback on the executor's thread, so that no answer arrives before it.
            sent.add_done_callback(lambda accepted: await_end(move, accepted.result()))
            return sent

        def answer() -> str | None:
            return 'started' if started or not move.under_way else None

        self._requested = True
        handle = await self._result_of(send)
        if handle is None or not handle.accepted:
            raise ValueError('move_soliton rejected the goal; see the log of soliton_steering')
        await self._until(answer, 'soliton_steering')
        if move.under_way or move.held:
            # A rejected goal does not replace the active move.
            self.move = move
            return move.message or f'moving the soliton to rotor {rotor:.2f}'
        self._requested = False
        raise ValueError(f'{move.state}: {move.message}')

    def follow(self, received_at: float, figures: Mapping[str, str]) -> None:
        """Update `move`, which any client may have requested, from a report of soliton_steering.

        `figures` are the values in the report. It arrived at the monotonic time `received_at` [s].
        """
        if received_at <= self._reported_at or 'moves begun' not in figures:
            return
        self._reported_at = received_at
        goal, start = (views.figure(figures, f'move {end} rotor') for end in ('to', 'from'))
        own = self._requested or (self.move.under_way and not self.move.foreign)
        before, self._moves_started = self._moves_started, figures['moves begun']
        self._requested = False
        if not own and before != self._moves_started and (before or math.isfinite(goal)):
            self.move = Move(UNDER_WAY, goal, start, start, foreign=True)
        if self.move.foreign and self.move.under_way and not math.isfinite(goal):
            self.move.state, _, self.move.message = figures.get('last move', '').partition(': ')
            self.move.ended_at = received_at
        self.holding = figures.get('holding') == 'True'
        if received_at > self.move.ended_at and not self.holding:
            self.move = Move()

    def _forget_move(self) -> None:
        if not self.move.under_way:
            self.move = Move()

    async def cancel(self) -> str:
        """Cancel the active move."""
        self.check_writable()
        move = self.move
        if move.foreign and move.under_way:
            # A cancel request without a goal identifier cancels all goals.
            name = f'{self.namespace}{interfaces.MOVE_SOLITON}/_action/cancel_goal'
            await self.call(name, CancelGoal, CancelGoal.Request())
        elif move.under_way:
            await self._result_of(move.handle.cancel_goal_async)
        else:
            raise ValueError('no move is under way')
        return await self._until(
            lambda: None if move.under_way else f'{move.state}: {move.message}', 'soliton_steering'
        )

    async def parameters(self, node: str) -> list[AdjustableParameter]:
        """Return the adjustable parameters of the node with this full name."""
        listed = await self._call_parameters(node, ListParameters, ListParameters.Request())
        request = DescribeParameters.Request(names=sorted(listed.result.names))
        answer = await self._call_parameters(node, DescribeParameters, request)
        # If one of the requested parameters has no value, a node returns no values at all.
        found = [each for each in answer.descriptors if views.is_adjustable(each)]
        request = GetParameters.Request(names=[each.name for each in found])
        values = (await self._call_parameters(node, GetParameters, request)).values
        return views.adjustable_parameters(found, values)

    async def set_parameter(self, node: str, parameter: AdjustableParameter, value: Any) -> str:
        """Set a parameter of a node."""
        self.check_writable()
        change = Parameter(name=parameter.name, value=views.parameter_value(parameter, value))
        request = SetParameters.Request(parameters=[change])
        (result,) = (await self._call_parameters(node, SetParameters, request)).results
        if not result.successful:
            raise ValueError(result.reason or f'{node} rejected {parameter.name} = {value}')
        return f'{parameter.name} = {value}'

    async def call(self, name: str, service_type: Any, request: Any) -> Any:
        """Call the service with this full name. Raises ValueError if no node serves it."""
        client = self._client(name, service_type)
        if not client.service_is_ready():
            raise ValueError(f'no node serves {name}')
        return await self._result_of(lambda: client.call_async(request))

    @property
    def _chain(self) -> ChainTopics | None:
        return self._finder.chains.get(self.namespace)

    def _report(self, node: str) -> NodeReport | None:
        return self._finder.reports.get(f'{self.namespace}{node}', (0.0, None))[1]

    async def _send(self, topic: str, message: Any, lasting: bool = False) -> str:
        async def act() -> None:
            self._publish(topic, message, 'edge_actuator')

        return await self._actuate(topic, act, lasting)

    async def _actuate(
        self, topic: str, act: Callable[[], Awaitable[None]], lasting: bool = False
    ) -> str:
        # Send one command at a time, so that each answer belongs to its command.
        async with self._edge:
            before, kicks = self._report('edge_actuator'), self._chain.kicks if self._chain else 0
            await act()
            sent_at = time.monotonic()

            def answer() -> str | None:
                report = self._report('edge_actuator')
                if rejection := _new_rejection(before, report, topic):
                    raise ValueError(f'edge_actuator rejected the command: {rejection}')
                chain = self._chain
                if chain and chain.kicks > kicks and topic in views.topics_of(chain.kick):
                    return views.describe_kick(chain.kick)
                if not lasting and time.monotonic() < sent_at + _ACCEPTED_TIME:
                    return None
                earlier, now = (
                    views.figure(each.figures, _CARRIED_OUT) if each else math.nan
                    for each in (before, report)
                )
                accepted = 'edge_actuator accepted it; last_kick will report the effect'
                return accepted if now > earlier else None

            return await self._until(answer, 'edge_actuator')

    async def _until(self, answer: Callable[[], str | None], node: str) -> str:
        deadline = time.monotonic() + _ANSWER_TIMEOUT
        while time.monotonic() < deadline:
            if (text := answer()) is not None:
                return text
            await asyncio.sleep(_POLL_INTERVAL)
        raise ValueError(f'no answer of {node} within {_ANSWER_TIMEOUT:g} s; see its log')

    def close(self) -> None:
        """Destroy the action client. The node itself does not destroy it."""
        if self._mover is not None:
            self._mover.destroy()

    async def _call_own(self, name: str, request: Any) -> str:
        self.check_writable()
        answer = await self.call(f'{self.namespace}{name}', _SERVICES[name], request)
        if not answer.success:
            raise ValueError(answer.message)
        return str(answer.message)

    async def _call_parameters(self, node: str, service_type: Any, request: Any) -> Any:
        client = self._client(f'{node}/{_PARAMETER_SERVICES[service_type]}', service_type)
        for _ in range(int(_PARAMETERS_TIMEOUT / _POLL_INTERVAL)):
            if client.service_is_ready():
                return await self._result_of(lambda: client.call_async(request))
            await asyncio.sleep(_POLL_INTERVAL)
        raise ValueError(f'{node} has no parameter services; it may have ended')

    async def _result_of(self, send: Callable[[], Any]) -> Any:
        """Call `send` on the thread of the executor, and return the result of its future."""
        loop = asyncio.get_running_loop()
        result: asyncio.Future[Any] = loop.create_future()

        def finish(future: Any) -> None:
            loop.call_soon_threadsafe(_set_result, result, future)

        executor = self._node.executor
        if executor is None:
            raise ValueError('no executor spins live_view')
        executor.create_task(lambda: send().add_done_callback(finish))
        try:
            return await asyncio.wait_for(result, _ANSWER_TIMEOUT)
        except asyncio.TimeoutError as error:
            raise ValueError(f'no answer within {_ANSWER_TIMEOUT:g} s; try again') from error

    def _client(self, name: str, service_type: Any) -> Client:
        if name not in self._clients:
            self._clients[name] = self._node.create_client(
                service_type, name, qos_profile=SERVICE_QOS
            )
        return self._clients[name]

    def _publish(self, topic: str, message: Any, subscriber: str) -> None:
        self.check_writable()
        if not self.reaches(topic):
            raise ValueError(f'no node subscribes to {topic}; start {subscriber}')
        self._publishers[topic].publish(message)


def _new_rejection(before: NodeReport | None, report: NodeReport | None, topic: str) -> str:
    """Return the reason if a command on `topic` was rejected between two reports, else ''."""
    if report is None:
        return ''
    rejected = views.figure(report.figures, 'rejected')
    source, _, reason = report.figures.get('last rejection', '').partition(': ')
    new = before is not None and rejected > views.figure(before.figures, 'rejected')
    return reason if new and source.rpartition('/')[2] == topic else ''


def _set_result(result: asyncio.Future[Any], future: Any) -> None:
    if result.done():
        return
    error = future.exception()
    if error is not None:
        result.set_exception(ValueError(str(error)))
    else:
        result.set_result(future.result())
