# SPDX-License-Identifier: Apache-2.0
"""Bags of other recorders are played as rosbag2 plays them, or refused in one line."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from graphs import Graph, values
from mcap.writer import Writer
from rclpy.node import Node
from rclpy.serialization import serialize_message
from recordings import START
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32, String
from std_srvs.srv import Trigger

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.runtime.interfaces import CLOCK, Topic, latched_qos, reliable_qos
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

TEXTS = 'std_msgs/msg/String'
LATCHED = (
    '- {history: unknown, depth: DEPTH, reliability: reliable, durability: transient_local, '
    'deadline: {sec: 0, nsec: 0}, lifespan: {sec: 0, nsec: 0}, liveliness: automatic, '
    'liveliness_lease_duration: {sec: 0, nsec: 0}, avoid_ros_namespace_conventions: false}'
)


@dataclass(frozen=True)
class Channel:
    """A channel of an MCAP file, with its messages and their times [ns]."""

    topic: str
    type_name: str
    messages: Sequence[tuple[int, bytes]]
    profiles: str = ''


def write_mcap(path: Path, *channels: Channel) -> Path:
    """Write a file as rosbag2 does, without a folder and without definitions."""
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2', library='test')
        for each in channels:
            schema = writer.register_schema(each.type_name, 'ros2msg', b'')
            about = {'offered_qos_profiles': each.profiles}
            number = writer.register_channel(each.topic, 'cdr', schema, about)
            for stamp, data in each.messages:
                writer.add_message(number, stamp, data, stamp)
        writer.finish()
    return path


def texts(number: int, size: int = 1, gap: int = 1) -> list[tuple[int, bytes]]:
    """Numbered texts of a size [B]."""
    return [
        (START + n * gap, serialize_message(String(data=f'{n}'.rjust(size))))
        for n in range(number)
    ]


def numbers_in(heard: Sequence[String]) -> list[int]:
    return [int(message.data) for message in heard]


CHATTER = Topic('chatter', String, reliable_qos(1000))


@pytest.mark.parametrize(('name', 'type_name'), [('/x', 'absent_msgs/msg/X'), ('/a b', TEXTS)])
def test_a_bag_without_a_topic_that_can_be_played_is_rejected_in_one_line(
    graph, tmp_path, name, type_name
):
    bag = write_mcap(tmp_path / 'x.mcap', Channel(name, type_name, texts(3)))
    complaint = f'bag {str(bag)!r}: no topic can be played; '
    with pytest.raises(ValueError, match=re.escape(complaint)) as refusal:
        graph.start(BagPlayer, {'bag': str(bag)})
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize('chosen', [[], ['chatter']])
def test_the_first_installed_type_of_a_topic_is_played(graph, tmp_path, capfd, chosen):
    number = serialize_message(Int32(data=7))
    bag = write_mcap(
        tmp_path / 'x.mcap',
        Channel('/chatter', 'absent_msgs/msg/X', texts(2)),
        Channel('/chatter', TEXTS, texts(5)),
        Channel('/chatter', 'std_msgs/msg/Int32', [(START + 10, number)]),
    )
    heard = graph.hear(CHATTER)
    given = {'topics': chosen} if chosen else {}
    graph.start(BagPlayer, {'bag': str(bag), 'wait_for': ['chatter'], **given})
    graph.until(lambda: len(heard) == 5, 'the texts')
    said = capfd.readouterr().err
    assert said.count('/chatter of type std_msgs/msg/Int32 is not played: ') == 1
    assert said.count('/chatter of type absent_msgs/msg/X is not played: ') == 1


def test_service_events_are_played_if_their_type_is_installed(graph, tmp_path):
    topic, event = '/stop/_service_event', Trigger.Event(request=[Trigger.Request()])
    sent = [(START, serialize_message(event))]
    bag = write_mcap(tmp_path / 'x.mcap', Channel(topic, 'std_srvs/srv/Trigger_Event', sent))
    received = []
    graph.user.create_subscription(Trigger.Event, topic, received.append, 10)
    graph.start(BagPlayer, {'bag': str(bag), 'wait_for': [topic]})
    graph.until(lambda: received, 'the event')
    assert received == [event]


def test_a_recorded_clock_is_not_played_beside_an_own_one(graph, tmp_path, capfd):
    clocks = [
        (START + n, serialize_message(Clock(clock=time_to_msg(n * SECOND)))) for n in range(20)
    ]
    bag = write_mcap(
        tmp_path / 'x.mcap',
        Channel('/clock', 'rosgraph_msgs/msg/Clock', clocks),
        Channel('/chatter', TEXTS, texts(20)),
    )
    shown, heard = graph.hear(CLOCK), graph.hear(CHATTER)
    given = {'bag': str(bag), 'publish_clock': True, 'wait_for': ['chatter', '/clock']}
    player = graph.start(BagPlayer, given)
    graph.until(lambda: player.finished and len(heard) == 20 and shown, 'the end')
    assert {message.clock.sec for message in shown} == {START // SECOND}
    assert values(graph.next_report('bag_player'))['messages'] == '20'
    assert capfd.readouterr().err.count('the recorded /clock is not played') == 1


def test_the_subscription_of_its_own_clock_is_no_subscriber(graph, tmp_path):
    clocks = [(START + n, serialize_message(Clock())) for n in range(20)]
    bag = write_mcap(tmp_path / 'x.mcap', Channel('/clock', 'rosgraph_msgs/msg/Clock', clocks))
    given = {'wait_for': ['/clock'], 'subscriber_timeout': 3600.0, 'use_sim_time': True}
    player = graph.start(BagPlayer, {'bag': str(bag), **given})
    (own,) = (each for each in player.publishers if each.topic_name == '/clock')
    graph.until(own.get_subscription_count, 'its own subscription')
    reports = graph.reports('bag_player')
    graph.until(lambda: len(reports) > 3, 'more time than the player takes to discover others')
    assert values(reports[-1])['messages played'] == '0'
    shown = graph.hear(CLOCK)
    graph.until(lambda: len(shown) == 20, 'the clock')


def latecomer(graph: Graph) -> list[String]:
    """Return the messages that a new transient-local subscriber receives."""
    node = graph.start(lambda **kwargs: Node('latecomer', **kwargs))
    heard: list[String] = []
    node.create_subscription(String, 'chatter', heard.append, latched_qos(1000))
    return heard


@pytest.mark.parametrize(('depth', 'held'), [(0, 10), (3, 3)])
def test_a_late_subscriber_gets_the_latched_messages_as_from_rosbag2(graph, tmp_path, depth, held):
    profiles = LATCHED.replace('DEPTH', str(depth))
    bag = write_mcap(tmp_path / 'x.mcap', Channel('/chatter', TEXTS, texts(12), profiles))
    given = {'bag': str(bag), 'subscriber_timeout': 0.0, 'stay': True, 'wait_for': ['chatter']}
    graph.start(BagPlayer, given)
    reports = graph.reports('bag_player')
    graph.until(lambda: reports and values(reports[-1])['messages played'] == '12', 'the end')
    heard = latecomer(graph)
    graph.until(lambda: len(heard) == held, f'{held} texts')
    assert numbers_in(heard) == list(range(12 - held, 12))


def test_an_offset_keeps_as_many_latched_messages_as_a_late_subscriber_gets(graph, tmp_path):
    profiles = LATCHED.replace('DEPTH', '0')
    bag = write_mcap(
        tmp_path / 'x.mcap', Channel('/chatter', TEXTS, texts(20, gap=SECOND), profiles)
    )
    heard = latecomer(graph)
    graph.start(BagPlayer, {'bag': str(bag), 'start_offset': 15.5, 'rate': 1000.0})
    graph.until(lambda: len(heard) == 14, 'the texts')
    assert numbers_in(heard) == list(range(6, 20))


def test_no_message_that_is_reported_as_played_is_lost_on_its_way(graph, start, tmp_path):
    profiles = LATCHED.replace('DEPTH', '1')
    bag = write_mcap(tmp_path / 'x.mcap', Channel('/chatter', TEXTS, texts(300, 20_000), profiles))
    heard = graph.hear(Topic('chatter', String, latched_qos(1000)))
    program = start('bag_player', '--ros-args', '-p', f'bag:={bag}', '-p', 'wait_for:=[chatter]')
    graph.until(lambda: program.process.poll() is not None, 'the end')
    assert program.process.returncode == 0
    assert f'played 300 of 300 messages of {bag}' in program.said[-1]
    graph.until(lambda: len(heard) == 300, '300 texts', lambda: len(heard))
    assert numbers_in(heard) == list(range(300))


@pytest.mark.parametrize('first', [0, START - 3 * 86400 * SECOND])
def test_a_gap_longer_than_the_limit_is_skipped_and_reported(graph, tmp_path, capfd, first):
    early = (first, serialize_message(String(data='-1')))
    bag = write_mcap(tmp_path / 'x.mcap', Channel('/chatter', TEXTS, [early, *texts(10)]))
    heard = graph.hear(CHATTER)
    player = graph.start(BagPlayer, {'bag': str(bag), 'wait_for': ['chatter']})
    graph.until(lambda: player.finished and len(heard) == 11, 'the end')
    skipped = (START - first) / SECOND
    assert f'skipped {skipped:.0f} s without a message' in capfd.readouterr().err
