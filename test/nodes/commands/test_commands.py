# SPDX-License-Identifier: Apache-2.0
"""The commands inspect and use topics, parameters and services without `ros2`."""

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

import pytest
import yaml
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from programs import signalled
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from std_msgs.msg import Float64

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.commands import (
    action,
    bag,
    interface,
    lifecycle,
    node,
    param,
    run,
    service,
    topic,
)
from soliton_linkage_nodes.commands.visitor import visiting
from soliton_linkage_nodes.runtime import interfaces

Said = Callable[..., str]


class Pendulum(LifecycleNode):
    """A node with a parameter, a latched topic, a lifecycle and an action."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('pendulum', **kwargs)
        bounds = FloatingPointRange(from_value=0.1, to_value=2.0)
        self.declare_parameter('length', 0.5, ParameterDescriptor(floating_point_range=[bounds]))
        self.declare_parameter('masses', [1, 2])
        topic = interfaces.Topic('angle', Float64, interfaces.latched_qos())
        topic.publisher(self).publish(Float64(data=0.25))
        self._swing = ActionServer(
            self,
            MoveSoliton,
            'swing',
            self._execute,
            goal_callback=lambda goal: (
                GoalResponse.ACCEPT if goal.speed >= 0 else GoalResponse.REJECT
            ),
        )

    def _execute(self, handle: Any) -> MoveSoliton.Result:
        handle.publish_feedback(MoveSoliton.Feedback(rotor=0.5))
        (handle.succeed if handle.request.rotor else handle.abort)()
        return MoveSoliton.Result(rotor=handle.request.rotor)

    def destroy_node(self) -> None:
        self._swing.destroy()
        super().destroy_node()


@pytest.fixture
def said(graph, monkeypatch, capsys):
    """Run a command on the domain of the test while it spins; return the output."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.domain))
    # Only the main thread, which spins the graph, can have handlers of signals.
    monkeypatch.setattr(signal, 'signal', lambda *_: None)
    graph.start(Pendulum)

    def run_beside(
        command: Any, verb: str, *arguments: str, timeout: float = 60.0, code: int = 0
    ) -> str:
        codes: list[Any] = []

        def work() -> None:
            try:
                codes.append(command.main([verb, '--timeout', str(timeout), *arguments]))
            except Exception as error:
                codes.append(error)

        thread = threading.Thread(target=work)
        thread.start()
        graph.until(lambda: not thread.is_alive(), ' '.join((verb, *arguments)))
        if isinstance(codes[0], Exception):
            raise codes[0]
        assert codes == [code]
        return capsys.readouterr().out

    return run_beside


def test_a_latched_message_is_echoed(said):
    assert said(topic, 'echo', '--once', 'angle') == 'data: 0.25\n---\n'
    assert said(topic, 'echo', '--once', '--field', 'data', '/angle') == '0.25\n---\n'
    with pytest.raises(ValueError, match='--field size: there is no size; there are data'):
        said(topic, 'echo', '--field', 'size', 'angle')


def test_a_message_is_published_to_a_waiting_subscriber(said, graph):
    heard = graph.hear(interfaces.TILT)
    shown = said(topic, 'pub', '--once', 'tilt', 'std_msgs/msg/Float64', '{data: 3}')
    graph.until(lambda: heard, 'the message')
    assert heard == [Float64(data=3.0)]
    assert shown == 'published on /tilt: std_msgs.msg.Float64(data=3.0)\n'


def test_nothing_is_published_without_a_subscriber(said):
    with pytest.raises(RuntimeError, match=r'/tilt has 0 subscribers after 0.1 s, not 1; nothing'):
        said(topic, 'pub', '--once', 'tilt', 'std_msgs/msg/Float64', '{data: 3}', timeout=0.1)


def test_parameters_are_listed_got_set_and_dumped(said):
    assert {'length', 'masses'} <= set(said(param, 'list', 'pendulum').split())
    assert said(param, 'get', '/pendulum', 'length') == '0.5\n'
    shown = said(param, 'set', 'pendulum', 'length', '0.75')
    assert shown == 'Set parameter successful: length = 0.75\n'
    dumped = yaml.safe_load(said(param, 'dump', 'pendulum'))['/pendulum']['ros__parameters']
    assert (dumped['length'], dumped['masses']) == (0.75, [1, 2])
    assert said(param, 'set', 'pendulum', 'length', '5e-1').endswith(' length = 0.5\n')


def test_a_rejected_parameter_is_reported_with_value_limit_and_remedy(said):
    for name, value, reason in [
        ('length', 'long', "parameter length = 'long' must be a number such as 1.0"),
        ('length', '{a: 1}', "parameter length = '{a: 1}' must be a number such as 1.0"),
        ('length', 'true', 'parameter length = True must be a number such as 1.0'),
        ('length', '3', 'parameter length = 3.0 must lie in the range 0.1 to 2'),
        ('masses', '[1, a]', "'[1, a]' must be a list of whole numbers such as [1, 2]"),
        ('masses', '9' * 20, f"'{'9' * 20}' must be a list of whole numbers such as [1, 2]"),
    ]:
        with pytest.raises(RuntimeError) as rejected:
            said(param, 'set', 'pendulum', name, value)
        shown = str(rejected.value)
        assert shown.startswith(f'pendulum rejected {name} = {value}: ')
        assert reason in shown
        assert shown.endswith('; set another value')
    with pytest.raises(RuntimeError, match='pendulum has no parameter mass, or it is not set'):
        said(param, 'get', 'pendulum', 'mass')


def test_a_topic_is_described_with_its_endpoints(said, graph):
    expected = 'Type: std_msgs/msg/Float64\nPublisher count: 1\nSubscription count: 0\n'
    graph.until(lambda: said(topic, 'info', 'angle') == expected, 'the publisher')
    shown = said(topic, 'info', '-v', 'angle')
    assert {'Node name: pendulum', '  Durability: TRANSIENT_LOCAL'} <= set(shown.split('\n'))


def test_a_node_is_described_with_its_topics_services_and_actions(said, graph):
    blocks: dict[str, Any] = {}

    def complete() -> bool:
        truth = graph.user.get_service_names_and_types_by_node('pendulum', '/')
        services = {name: types[0] for name, types in truth if '/_' not in name}
        blocks.update(yaml.safe_load(said(node, 'info', 'pendulum').partition('\n')[2]))
        known = blocks['Publishers'] or {}, blocks['Action Servers'] or {}
        return (
            blocks['Service Servers'] == services and '/angle' in known[0] and '/swing' in known[1]
        )

    graph.until(complete, 'the services of the node', lambda: blocks)
    assert blocks['Publishers']['/angle'] == 'std_msgs/msg/Float64'
    assert blocks['Action Servers'] == {'/swing': 'soliton_linkage_msgs/action/MoveSoliton'}
    assert blocks['Subscribers'] is blocks['Action Clients'] is None
    with pytest.raises(RuntimeError, match='there is no node /nobody; list all with'):
        said(node, 'info', 'nobody', timeout=0.1)


def test_a_goal_is_sent_and_its_result_printed(said, graph):
    kind = 'soliton_linkage_msgs/action/MoveSoliton'
    graph.until(
        lambda: f'/swing [{kind}]' in said(action, 'list', '-t', timeout=0.0), 'the action'
    )
    shown = said(action, 'send_goal', '-f', 'swing', kind, '{rotor: 2.5}')
    assert 'Feedback:\n    rotor: 0.5\n' in shown
    assert 'Result:\n    outcome: 0\n' in shown
    assert 'rotor: 2.5' in shown.partition('Result:')[2]
    assert shown.endswith('Goal finished with status: SUCCEEDED\n')
    shown = said(action, 'send_goal', '/swing', kind, code=1)
    assert shown.endswith('Goal finished with status: ABORTED\n')
    with pytest.raises(RuntimeError, match='Goal was rejected'):
        said(action, 'send_goal', 'swing', kind, '{speed: -1.0}')
    with pytest.raises(RuntimeError, match='there is no action sway of the type'):
        said(action, 'send_goal', 'sway', kind, timeout=0.1)


def test_ctrl_c_cancels_the_goal(graph, tmp_path):
    held: list[Any] = []
    cancelled: list[Any] = []

    def cancel(handle: Any) -> CancelResponse:
        cancelled.append(handle)
        return CancelResponse.ACCEPT

    server = ActionServer(
        graph.user,
        MoveSoliton,
        'swing',
        lambda handle: (handle.canceled(), MoveSoliton.Result(message='stopped'))[1],
        handle_accepted_callback=held.append,
        cancel_callback=cancel,
    )
    # A KeyboardInterrupt inside the executor of rclpy would lose the response.
    while_it_is_accepted = signalled('action/client.py:take_data', signal.SIGINT)
    log = tmp_path / 'said.log'
    program = shutil.which('soliton-linkage')
    assert program is not None
    words = ['action', 'send_goal', '/swing', 'soliton_linkage_msgs/action/MoveSoliton']
    with log.open('wb') as stream:
        process = subprocess.Popen(
            [*while_it_is_accepted, program, *words, '--timeout', '240'],
            env={**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)},
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
    try:
        graph.until(lambda: cancelled, 'the request to cancel', log.read_text)
        held[0].execute()
        graph.until(lambda: process.poll() is not None, 'the end', log.read_text)
    finally:
        process.kill()
        process.wait()
        server.destroy()
    assert process.returncode == signal.SIGINT
    assert log.read_text().rstrip().endswith('Goal finished with status: CANCELED')


def test_a_lifecycle_state_is_printed_and_changed(said):
    assert said(lifecycle, 'get', 'pendulum') == 'unconfigured [1]\n'
    assert said(lifecycle, 'set', '/pendulum', 'configure') == 'Transitioning successful\n'
    assert said(lifecycle, 'get', 'pendulum') == 'inactive [2]\n'
    with pytest.raises(RuntimeError, match=r"transition 'swing'.*cleanup \[2\], activate \[3\]"):
        said(lifecycle, 'set', 'pendulum', 'swing')
    with pytest.raises(RuntimeError, match='nobody: there is no service /nobody/get_state'):
        said(lifecycle, 'get', 'nobody', timeout=0.1)


def test_a_state_is_requested_again_if_the_response_is_lost(said, graph):
    server = Node('deaf', context=graph.context)
    states = server.create_service(GetState, 'deaf/get_state', lambda _, answer: answer)
    ended = threading.Event()
    taken: list[Any] = []

    def answer_the_second() -> None:
        while len(taken) < 2 and not ended.wait(0.02):
            with states.handle:
                request, header = states.handle.service_take_request(GetState.Request)
            taken.extend([header] * (request is not None))
        if len(taken) == 2:
            state = State(id=3, label='active')
            states.send_response(GetState.Response(current_state=state), taken[1])

    thread = threading.Thread(target=answer_the_second)
    thread.start()
    try:
        assert said(lifecycle, 'get', 'deaf') == 'active [3]\n'
    finally:
        ended.set()
        thread.join()
        server.destroy_node()


def test_a_definition_is_shown_with_nested_fields(capsys):
    assert interface.main(['show', 'soliton_linkage_msgs/msg/SolitonState']) == 0
    shown = capsys.readouterr().out
    assert '\nstd_msgs/Header header\n\tbuiltin_interfaces/Time stamp\n\t\tint32 sec\n' in shown
    assert '\nSoliton[] solitons\n\tuint32 id\n\tfloat64 position\n\tfloat64 rotor\n' in shown
    assert interface.main(['show', 'std_srvs/srv/SetBool']) == 0
    assert '\n---\nbool success' in capsys.readouterr().out
    for wrong, complaint in (
        ('std_msgs/msg/None', 'there is no type std_msgs/msg/None'),
        ('nowhere/msg/None', 'the package nowhere is not installed'),
        ('Float64', 'the package Float64 is not installed'),
    ):
        with pytest.raises(ValueError, match=complaint):
            interface.main(['show', wrong])


@pytest.mark.parametrize(
    ('words', 'forwarded'),
    [
        (['info', 'a', 'b'], ['check_bag', 'a', 'b']),
        (
            ['record', '-o', 'my run', '/angle', '--ros-args', '-r', '__ns:=/left'],
            [
                *('bag_recorder', '--ros-args', '-p', 'topics:=["/angle"]'),
                *('-p', 'output:="my run"', '-r', '__ns:=/left'),
            ],
        ),
        (['record', '-a'], ['bag_recorder', '--ros-args', '-p', 'regex:="."']),
        (
            ['play', 'a', '-r', '2', '--loop'],
            ['bag_player', '--ros-args', '-p', 'bag:="a"', '-p', 'rate:=2.0', '-p', 'loop:=true'],
        ),
    ],
)
def test_bags_are_handled_by_the_programs_of_the_suite(monkeypatch, words, forwarded):
    begun: list[list[str]] = []
    monkeypatch.setattr('sys.argv', ['soliton-linkage'])
    monkeypatch.setattr(run.start, forwarded[0], lambda: begun.append(list(sys.argv)))
    assert bag.main(words) == 0
    assert begun == [forwarded]


def test_nodes_and_services_are_listed_and_called(said, graph):
    graph.until(lambda: '/pendulum' in said(node, 'list', timeout=0.0).split(), 'the node')
    listed = '/pendulum/list_parameters'
    graph.until(lambda: listed in said(service, 'list', timeout=0.0).split(), 'its services')
    kind = 'rcl_interfaces/srv/GetParameters'
    shown = said(service, 'call', '/pendulum/get_parameters', kind, '{names: [length]}')
    assert yaml.safe_load(shown)['values'][0]['double_value'] == 0.5


@pytest.mark.parametrize(
    ('command', 'shown'), [(topic, '/angle'), (service, '/pendulum/get_parameters')]
)
def test_hidden_names_are_not_listed(said, graph, command, shown):
    user, listed = graph.user, list[str]()

    def complete() -> bool:
        listed[:] = said(command, 'list', timeout=0.0).split()
        truth = [*user.get_topic_names_and_types(), *user.get_service_names_and_types()]
        return shown in listed and any('/_action/' in name for name, _ in truth)

    graph.until(complete, f'{shown} and an action', lambda: listed)
    assert not any('/_' in name for name in listed)


@pytest.mark.parametrize(
    ('announced', 'length'),
    [([3.1], 4.1), ([3.1, 4.0, 4.9], 5.9), ([], 3.2), ([0.7 * n for n in range(20)], 10)],
)
def test_a_list_is_complete_once_it_no_longer_grows(graph, monkeypatch, announced, length):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.domain))
    now = 0.0

    def found() -> list[float]:
        nonlocal now
        now += 0.05
        return [time for time in announced if time <= now]

    with visiting(clock=lambda: now) as visitor:
        assert visitor.settled(found) == [time for time in announced if time <= length]
    assert now == pytest.approx(length, abs=0.11)


def test_an_unknown_name_is_reported(said):
    with pytest.raises(
        RuntimeError, match='there is no topic /none; list all with: soliton-linkage topic list'
    ):
        said(topic, 'echo', 'none', timeout=0.1)
    with pytest.raises(RuntimeError, match='nobody: there is no service /nobody/get_parameters'):
        said(param, 'get', 'nobody', 'length', timeout=0.1)


def test_programs_are_run_by_their_names(monkeypatch):
    begun: list[list[str]] = []
    monkeypatch.setattr('sys.argv', ['soliton-linkage'])
    monkeypatch.setattr(run.start, 'simulator', lambda: begun.append(list(sys.argv)))
    assert run.main(['simulator', '--ros-args', '-p', 'publish_rate:=5.0']) == 0
    assert begun == [['simulator', '--ros-args', '-p', 'publish_rate:=5.0']]
    with pytest.raises(SystemExit, match='2'):
        run.main(['simulatr'])
