# SPDX-License-Identifier: Apache-2.0
"""The server between a graph and a client of its protocol."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from graphs import Graph, values
from hostile_values import PATIENT, TEXTS
from hypothesis import given
from hypothesis import strategies as st
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_msgs.msg import Chain, EdgeCommand
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.foxglove_server.node import FoxgloveServer
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    chain_to_msg,
    frame_to_msg,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.simulator.node import Simulator

sys.path.append(str(Path(__file__).parent))

pytest.importorskip('foxglove', reason='the Foxglove SDK is not installed')
pytest.importorskip('websockets.sync.client', reason='websockets is not installed')

from foxglove_client import FoxgloveClient

from soliton_linkage_nodes.foxglove_server import services

TYPES = ('std_msgs/msg/Float64', 'std_msgs/Float64', 'std_msgs/msg/Header', 'os/path', 'a/b/c')
SAID = (b'{}', b'{"data": 1}', b'{"data": 1e999}', b'{"data": NaN}', 100_000 * b'[', b'\xff')
Connect = Callable[[FoxgloveServer], FoxgloveClient]


@pytest.fixture
def served(graph: Graph) -> FoxgloveServer:
    server: FoxgloveServer = graph.start(FoxgloveServer, {'port': 0})
    return server


@pytest.fixture
def connect(graph: Graph) -> Iterator[Connect]:
    clients: list[FoxgloveClient] = []

    def connected(server: FoxgloveServer) -> FoxgloveClient:
        clients.append(FoxgloveClient(f'ws://127.0.0.1:{server.serving.port}'))
        return clients[-1]

    yield connected
    for client in clients:
        client.close()


def until(graph: Graph, client: FoxgloveClient, condition: Callable[[], Any], what: str) -> None:
    """Spin and listen until a condition holds."""

    def heard() -> Any:
        client.listen()
        return condition()

    graph.until(heard, what)


def test_what_an_action_says_to_its_clients_is_hidden(
    graph: Graph, served: FoxgloveServer, connect: Connect
) -> None:
    feedback = '/move_soliton/_action/feedback'
    graph.user.create_publisher(MoveSoliton.Impl.FeedbackMessage, feedback, 10)
    graph.user.create_publisher(Float64, '/seen', 10)
    client = connect(served)
    until(graph, client, lambda: '/seen' in client.channels, 'a topic')
    assert feedback in dict(served.get_topic_names_and_types())
    assert feedback not in client.channels
    assert served.diagnostics.rejected == 0


def test_topics_come_with_their_definitions(
    graph: Graph, served: FoxgloveServer, connect: Connect
) -> None:
    graph.user.create_publisher(Chain, 'lab/chain', interfaces.CHAIN.qos)
    graph.user.create_subscription(EdgeCommand, 'edge_command', [].append, 10)
    client = connect(served)
    wanted = {'/lab/chain', '/edge_command'}
    until(graph, client, lambda: wanted <= client.channels.keys(), 'topics')
    assert client.information['supportedEncodings'] == ['cdr', 'json']
    channel = client.channels['/lab/chain']
    assert (channel['encoding'], channel['schemaEncoding']) == ('cdr', 'ros2msg')
    assert channel['schemaName'] == 'soliton_linkage_msgs/msg/Chain'
    types = get_types_from_msg(channel['schema'], channel['schemaName'])
    assert {'soliton_linkage_msgs/msg/Chain', 'std_msgs/msg/Header'} <= types.keys()


def test_messages_reach_clients_as_they_are_and_can_be_read_by_their_definitions(
    graph: Graph, served: FoxgloveServer, connect: Connect, named: NamedChain
) -> None:
    frame = frame_to_msg(
        named, Frame(named.chain.uniform_state(1), None), np.arange(8.0), Time(sec=7)
    )
    publisher = graph.user.create_publisher(type(frame), 'joint_states', 10)
    client = connect(served)
    until(graph, client, lambda: '/joint_states' in client.channels, 'joint_states')
    heard = client.subscribe('/joint_states')
    until(graph, client, publisher.get_subscription_count, 'a subscription')
    publisher.publish(frame)
    until(graph, client, lambda: heard, 'a message')
    assert [deserialize_message(data, type(frame)) for data in heard] == [frame]
    channel = client.channels['/joint_states']
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(channel['schema'], channel['schemaName']))
    read: Any = store.deserialize_cdr(heard[0], channel['schemaName'])
    assert read.header.stamp.sec == 7
    assert read.name == list(named.joint_names)
    assert read.position.tolist() == frame.position.tolist()
    client.unsubscribe('/joint_states')
    until(graph, client, lambda: not publisher.get_subscription_count(), 'no subscription')


def test_each_client_gets_what_is_latched(
    graph: Graph, served: FoxgloveServer, connect: Connect, named: NamedChain
) -> None:
    interfaces.CHAIN.publisher(graph.user).publish(chain_to_msg(named, Time()))
    for _ in range(2):
        client = connect(served)
        until(graph, client, lambda c=client: '/chain' in c.channels, 'the chain')
        heard = client.subscribe('/chain')
        until(graph, client, lambda h=heard: h, 'what is latched')
        assert tuple(deserialize_message(heard[0], Chain).joint_names) == named.joint_names


def test_a_best_effort_publisher_is_heard(
    graph: Graph, served: FoxgloveServer, connect: Connect
) -> None:
    qos = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = graph.user.create_publisher(Float64, 'sensed', qos)
    client = connect(served)
    until(graph, client, lambda: '/sensed' in client.channels, 'a topic')
    heard = client.subscribe('/sensed')
    until(graph, client, publisher.get_subscription_count, 'a subscription')

    def comes() -> bool:
        publisher.publish(Float64(data=0.5))
        return bool(heard)

    until(graph, client, comes, 'a message')


@pytest.mark.parametrize('encoding', ['cdr', 'json'])
def test_a_nudge_from_a_client_kicks_the_chain(
    graph: Graph, served: FoxgloveServer, connect: Connect, named: NamedChain, encoding: str
) -> None:
    graph.start(EdgeActuator, {'state_timeout': 60.0})
    impulses = graph.hear(interfaces.ROTOR_IMPULSES)
    chain, joints = graph.speak(interfaces.CHAIN), graph.speak(interfaces.JOINT_STATES)
    chain.publish(chain_to_msg(named, Time()))
    angles = named.chain.uniform_state(-1)
    frame = frame_to_msg(named, Frame(angles, 0 * angles), 0 * angles, Time(sec=1))
    client = connect(served)
    nudge = Float64(data=2.0)
    data = serialize_message(nudge) if encoding == 'cdr' else json.dumps({'data': 2.0}).encode()
    number = client.advertise('/nudge', 'std_msgs/msg/Float64', encoding)
    graph.until(lambda: graph.user.count_publishers('/nudge'), 'a publisher')
    graph.until(lambda: graph.user.count_subscribers('/rotor_impulses'), 'impulses')

    def is_kicked() -> bool:
        joints.publish(frame)
        client.publish(number, data)
        client.listen(0.1)
        return bool(impulses)

    graph.until(is_kicked, 'a kick')
    assert any(impulses[0].impulse)


def test_a_client_calls_services_by_their_definitions(
    graph: Graph, served: FoxgloveServer, connect: Connect
) -> None:
    graph.start(Simulator, {'chain.number_of_rotors': 3})
    client = connect(served)
    wanted = {'/simulator/pause', '/simulator/step', '/simulator/reset'}
    until(graph, client, lambda: wanted <= client.services.keys(), 'services')
    offered = client.services['/simulator/reset']
    assert offered['type'] == 'soliton_linkage_msgs/srv/Reset'
    told = offered['request']
    assert (told['encoding'], told['schemaEncoding']) == ('cdr', 'ros2msg')
    assert told['schemaName'] == 'soliton_linkage_msgs/srv/Reset_Request'
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(told['schema'], 'soliton_linkage_msgs/msg/Reset_Request'))
    request: Any = store.types['soliton_linkage_msgs/msg/Reset_Request']
    empty = np.zeros(0)
    lean = request(
        state=Reset.Request.RIGHT_LEANING,
        place=0.0,
        velocity=0.0,
        name=[],
        angle=empty,
        rate=empty,
    )
    reset = bytes(store.serialize_cdr(lean, 'soliton_linkage_msgs/msg/Reset_Request'))
    for name, data, service, message in (
        ('pause', serialize_message(SetBool.Request(data=True)), SetBool, 'paused'),
        ('reset', reset, Reset, 'at rest, right-leaning'),
    ):
        call = client.call(f'/simulator/{name}', data)
        until(graph, client, lambda c=call: c in client.answers, f'an answer of {name}')
        response = deserialize_message(client.answers[call], service.Response)
        assert (response.success, response.message) == (True, message)


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0\1\0\0\7\0\0\0'])
def test_a_service_without_fields_takes_what_clients_send_for_nothing(
    graph: Graph, served: FoxgloveServer, connect: Connect, data: bytes
) -> None:
    def answer(_: Any, response: Trigger.Response) -> Trigger.Response:
        response.message = 'done'
        return response

    graph.user.create_service(Trigger, 'lab/act', answer)
    client = connect(served)
    until(graph, client, lambda: '/lab/act' in client.services, 'a service')
    call = client.call('/lab/act', data)
    until(graph, client, lambda: call in client.answers, 'an answer')
    assert deserialize_message(client.answers[call], Trigger.Response).message == 'done'


def test_a_call_that_cannot_be_answered_says_why(
    graph: Graph, served: FoxgloveServer, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(services, '_LONGEST_ANSWER', 0.3)
    service = graph.user.create_service(SetBool, 'lab/pause', lambda _, response: response)
    client = connect(served)
    until(graph, client, lambda: '/lab/pause' in client.services, 'a service')
    sound = serialize_message(SetBool.Request())
    for data, encoding, complaint in (
        (b'\0', 'cdr', '1 bytes are no request of std_srvs/srv/SetBool'),
        (sound, 'json', 'Unsupported encoding'),
    ):
        call = client.call('/lab/pause', data, encoding)
        until(graph, client, lambda c=call: c in client.answers, 'a failure')
        assert complaint in str(client.answers[call])
    graph.user.destroy_service(service)
    call = client.call('/lab/pause', sound)
    until(graph, client, lambda: call in client.answers, 'no answer')
    assert str(client.answers[call]).endswith('/lab/pause has not answered in 0.3 s')
    until(graph, client, lambda: '/lab/pause' not in client.services, 'an end of the service')


def test_what_is_no_message_is_refused(
    graph: Graph, served: FoxgloveServer, connect: Connect
) -> None:
    client = connect(served)
    for topic, schema, encoding, data in (
        ('/nudge', 'std_msgs/msg/Float64', 'cdr', b'\x00'),
        ('/nudge', 'std_msgs/msg/Float64', 'json', b'{"data": "fast"}'),
        ('/else', 'no_such_msgs/msg/Thing', 'cdr', b''),
        ('/else', 'std_msgs/msg/Float64', 'xml', b''),
    ):
        refused = served.diagnostics.rejected
        client.publish(client.advertise(topic, schema, encoding), data)
        graph.until(lambda n=refused: served.diagnostics.rejected > n, f'{encoding} refused')
    told = values(graph.next_report('foxglove_server'))
    assert 'xml' in told['last rejection']
    assert told['messages from clients'] == '0'


@PATIENT
@given(
    advertised=st.tuples(
        st.sampled_from([*TEXTS, '/nudge', '/diagnostics', '/lab/x', 'ü/x']),
        st.sampled_from([*TEXTS, *TYPES]),
        st.sampled_from(['cdr', 'json', 'x']),
    ),
    said=st.lists(st.one_of(st.binary(max_size=40), st.sampled_from(SAID)), max_size=4),
)
def test_whatever_a_client_advertises_and_says_is_published_or_refused(
    served: FoxgloveServer, advertised: tuple[str, str, str], said: list[bytes]
) -> None:
    serving, key = served.serving, (1, 2)
    refused, published = served.diagnostics.rejected, serving.published
    serving.advertise(key, *advertised)
    if served.diagnostics.rejected == refused:
        for data in said:
            serving.publish(key, data)
        answered = served.diagnostics.rejected - refused + serving.published - published
        assert answered == len(said)
    serving.unadvertise(key)


def test_clients_of_a_server_that_is_read_only_publish_nothing(
    graph: Graph, connect: Connect
) -> None:
    server = graph.start(FoxgloveServer, {'port': 0, 'read_only': True})
    client = connect(server)
    until(graph, client, lambda: client.information, 'an introduction')
    assert not {'clientPublish', 'services'} & set(client.information['capabilities'])
    assert server.serving.services is None


def test_a_port_that_is_taken_is_told(graph: Graph, served: FoxgloveServer) -> None:
    with pytest.raises(OSError, match=f'127.0.0.1:{served.serving.port}.*give another'):
        graph.start(FoxgloveServer, {'port': served.serving.port}, namespace='other')
