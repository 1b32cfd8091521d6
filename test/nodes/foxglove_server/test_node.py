# SPDX-License-Identifier: Apache-2.0
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from graphs import Graph, values
from hostile_values import PATIENT, TEXTS
from hypothesis import given
from hypothesis import strategies as st
from joint_frames import frame_of
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_msgs.msg import Chain, EdgeCommand
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.foxglove_server.node import FoxgloveServer
from soliton_linkage_nodes.messages.conversions import chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND
from soliton_linkage_nodes.simulator.node import Simulator

sys.path.append(str(Path(__file__).parent))

pytest.importorskip('foxglove', reason='needs the Foxglove SDK: pip install foxglove-sdk')
pytest.importorskip('websockets.sync.client', reason='needs websockets: pip install websockets')

from foxglove_client import FoxgloveClient

TYPES = ('std_msgs/msg/Float64', 'std_msgs/Float64', 'std_msgs/msg/Header', 'os/path', 'a/b/c')
MESSAGES = (b'{}', b'{"data": 1}', b'{"data": 1e999}', b'{"data": NaN}', 100_000 * b'[', b'\xff')
Connect = Callable[[FoxgloveServer], FoxgloveClient]


@pytest.fixture
def served(graph):
    server: FoxgloveServer = graph.start(FoxgloveServer, {'port': 0})
    return server


@pytest.fixture
def connect(graph):
    clients: list[FoxgloveClient] = []

    def connected(server: FoxgloveServer) -> FoxgloveClient:
        clients.append(FoxgloveClient(f'ws://127.0.0.1:{server.serving.port}'))
        return clients[-1]

    yield connected
    for client in clients:
        client.close()


@pytest.fixture
def client(served, connect):
    return connect(served)


def until(graph: Graph, client: FoxgloveClient, condition: Callable[[], Any], what: str) -> None:
    def received() -> Any:
        client.read()
        return condition()

    graph.until(received, what)


def test_topics_of_actions_are_not_offered(graph, served, client):
    feedback = '/move_soliton/_action/feedback'
    graph.user.create_publisher(MoveSoliton.Impl.FeedbackMessage, feedback, 10)
    graph.user.create_publisher(Float64, '/seen', 10)
    until(graph, client, lambda: '/seen' in client.channels, 'a topic')
    assert feedback in dict(served.get_topic_names_and_types())
    assert feedback not in client.channels
    assert served.diagnostics.rejected == 0


def test_topics_are_offered_with_their_definitions(graph, client):
    graph.user.create_publisher(Chain, 'lab/chain', interfaces.CHAIN.qos)
    graph.user.create_subscription(EdgeCommand, 'edge_command', [].append, 10)
    wanted = {'/lab/chain', '/edge_command'}
    until(graph, client, lambda: wanted <= client.channels.keys(), 'topics')
    assert client.information['supportedEncodings'] == ['cdr', 'json']
    channel = client.channels['/lab/chain']
    assert (channel['encoding'], channel['schemaEncoding']) == ('cdr', 'ros2msg')
    assert channel['schemaName'] == 'soliton_linkage_msgs/msg/Chain'
    types = get_types_from_msg(channel['schema'], channel['schemaName'])
    assert {'soliton_linkage_msgs/msg/Chain', 'std_msgs/msg/Header'} <= types.keys()


def test_clients_receive_messages_unchanged_and_can_decode_them_by_their_definitions(
    graph, client, named
):
    frame = frame_of(named, named.chain.uniform_state(1), 7 * SECOND)
    publisher = graph.user.create_publisher(type(frame), 'joint_states', 10)
    until(graph, client, lambda: '/joint_states' in client.channels, 'joint_states')
    received = client.subscribe('/joint_states')
    until(graph, client, publisher.get_subscription_count, 'a subscription')
    publisher.publish(frame)
    until(graph, client, lambda: received, 'a message')
    assert [deserialize_message(data, type(frame)) for data in received] == [frame]
    channel = client.channels['/joint_states']
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(channel['schema'], channel['schemaName']))
    read: Any = store.deserialize_cdr(received[0], channel['schemaName'])
    assert read.header.stamp.sec == 7
    assert read.name == list(named.joint_names)
    assert read.position.tolist() == frame.position.tolist()
    client.unsubscribe('/joint_states')
    until(graph, client, lambda: not publisher.get_subscription_count(), 'no subscription')


def test_each_client_receives_latched_messages(graph, served, connect, named):
    interfaces.CHAIN.publisher(graph.user).publish(chain_to_msg(named, Time()))
    for _ in range(2):
        client = connect(served)
        until(graph, client, lambda c=client: '/chain' in c.channels, 'the chain')
        received = client.subscribe('/chain')
        until(graph, client, lambda h=received: h, 'the latched message')
        assert tuple(deserialize_message(received[0], Chain).joint_names) == named.joint_names


@pytest.mark.parametrize('encoding', ['cdr', 'json'])
def test_a_nudge_from_a_client_kicks_the_chain(graph, client, named, encoding):
    graph.start(EdgeActuator, {'state_timeout': 60.0})
    impulses = graph.hear(interfaces.ROTOR_IMPULSES)
    chain, joints = graph.speak(interfaces.CHAIN), graph.speak(interfaces.JOINT_STATES)
    chain.publish(chain_to_msg(named, Time()))
    angles = named.chain.uniform_state(-1)
    frame = frame_of(named, angles, SECOND, 0 * angles)
    nudge = Float64(data=2.0)
    data = serialize_message(nudge) if encoding == 'cdr' else json.dumps({'data': 2.0}).encode()
    number = client.advertise('/nudge', 'std_msgs/msg/Float64', encoding)
    graph.until(lambda: graph.user.count_publishers('/nudge'), 'a publisher')
    graph.until(lambda: graph.user.count_subscribers('/rotor_impulses'), 'impulses')

    def is_kicked() -> bool:
        joints.publish(frame)
        client.publish(number, data)
        client.read(0.1)
        return bool(impulses)

    graph.until(is_kicked, 'a kick')
    assert any(impulses[0].impulse)


def test_a_client_calls_services_by_their_definitions(graph, client):
    graph.start(Simulator, {'chain.number_of_rotors': 3})
    wanted = {'/simulator/pause', '/simulator/step', '/simulator/reset'}
    until(graph, client, lambda: wanted <= client.services.keys(), 'services')
    offered = client.services['/simulator/reset']
    assert offered['type'] == 'soliton_linkage_msgs/srv/Reset'
    request_schema = offered['request']
    assert (request_schema['encoding'], request_schema['schemaEncoding']) == ('cdr', 'ros2msg')
    assert request_schema['schemaName'] == 'soliton_linkage_msgs/srv/Reset_Request'
    store = get_typestore(Stores.EMPTY)
    store.register(
        get_types_from_msg(request_schema['schema'], 'soliton_linkage_msgs/msg/Reset_Request')
    )
    request: Any = store.types['soliton_linkage_msgs/msg/Reset_Request']
    empty = np.zeros(0)
    lean = request(
        state=Reset.Request.RIGHT_LEANING,
        rotor=0.0,
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
def test_a_service_without_fields_accepts_each_encoding_of_an_empty_request(graph, client, data):
    def answer(_: Any, response: Trigger.Response) -> Trigger.Response:
        response.message = 'done'
        return response

    graph.user.create_service(Trigger, 'lab/act', answer)
    until(graph, client, lambda: '/lab/act' in client.services, 'a service')
    call = client.call('/lab/act', data)
    until(graph, client, lambda: call in client.answers, 'an answer')
    assert deserialize_message(client.answers[call], Trigger.Response).message == 'done'


def test_a_failed_call_reports_the_reason(graph, served, client):
    service = graph.user.create_service(SetBool, 'lab/pause', lambda _, response: response)
    until(graph, client, lambda: '/lab/pause' in client.services, 'a service')
    sound = serialize_message(SetBool.Request())
    for data, encoding, complaint in (
        (b'\0', 'cdr', '1 bytes are not a request of type std_srvs/srv/SetBool'),
        (sound, 'json', 'Unsupported encoding'),
    ):
        call = client.call('/lab/pause', data, encoding)
        until(graph, client, lambda c=call: c in client.answers, 'a failure')
        assert complaint in str(client.answers[call])
    graph.user.destroy_service(service)
    until(graph, client, lambda: '/lab/pause' not in client.services, 'the end of the service')


def test_a_call_without_a_response_is_reported(graph, served, client):
    unspun = Graph(graph.domain)
    unspun.user.create_service(SetBool, 'lab/pause', lambda _, response: response)
    until(graph, client, lambda: '/lab/pause' in client.services, 'a service')
    served.serving.services.services['/lab/pause'].answer_timeout = 0.3
    call = client.call('/lab/pause', serialize_message(SetBool.Request()))
    until(graph, client, lambda: call in client.answers, 'a timeout')
    assert str(client.answers[call]).endswith('/lab/pause did not respond in 0.3 s')
    unspun.close()


def test_an_invalid_message_is_rejected(graph, served, client):
    for topic, schema, encoding, data in (
        ('/nudge', 'std_msgs/msg/Float64', 'cdr', b'\x00'),
        ('/nudge', 'std_msgs/msg/Float64', 'json', b'{"data": "fast"}'),
        ('/else', 'no_such_msgs/msg/Thing', 'cdr', b''),
        ('/else', 'std_msgs/msg/Float64', 'xml', b''),
    ):
        rejected = served.diagnostics.rejected
        client.publish(client.advertise(topic, schema, encoding), data)
        graph.until(lambda n=rejected: served.diagnostics.rejected > n, f'{encoding} rejected')
    figures = values(graph.next_report('foxglove_server'))
    assert 'xml' in figures['last rejection']
    assert figures['messages from clients'] == '0'


@PATIENT
@given(
    advertised=st.tuples(
        st.sampled_from([*TEXTS, '/nudge', '/diagnostics', '/lab/x', 'ü/x']),
        st.sampled_from([*TEXTS, *TYPES]),
        st.sampled_from(['cdr', 'json', 'x']),
    ),
    messages=st.lists(st.one_of(st.binary(max_size=40), st.sampled_from(MESSAGES)), max_size=4),
)
def test_every_message_of_a_client_is_published_or_rejected(served, advertised, messages):
    serving, key = served.serving, (1, 2)
    rejected, published = served.diagnostics.rejected, serving.published
    serving.advertise(key, *advertised)
    if served.diagnostics.rejected == rejected:
        for data in messages:
            serving.publish(key, data)
        answered = served.diagnostics.rejected - rejected + serving.published - published
        assert answered == len(messages)
    serving.unadvertise(key)


def test_clients_of_a_read_only_server_publish_nothing(graph, connect):
    server = graph.start(FoxgloveServer, {'port': 0, 'read_only': True})
    client = connect(server)
    until(graph, client, lambda: client.information, 'the server information')
    assert not {'clientPublish', 'services'} & set(client.information['capabilities'])
    assert server.serving.services is None


def test_an_error_names_a_port_that_is_in_use(graph, served):
    with pytest.raises(OSError, match=f'127.0.0.1:{served.serving.port}.*set another'):
        graph.start(FoxgloveServer, {'port': served.serving.port}, namespace='other')
