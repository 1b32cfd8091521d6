# SPDX-License-Identifier: Apache-2.0
"""A bag is played completely, in order and in real time, after subscribers match."""

import os
import pty
import re
import select
import signal
from pathlib import Path
from typing import Any

import pytest
from ament_index_python.packages import get_package_prefix
from graphs import Graph, values
from programs import PACKAGE
from rclpy.serialization import serialize_message
from recordings import MILLISECOND, START, frame_message, frames_of, run_of, write_bag
from std_srvs.srv import Trigger

from soliton_linkage_msgs.msg import SolitonEvent, SolitonState
from soliton_linkage_msgs.srv import GetRate, Seek, SetRate
from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg

MINUTE = 60 * 10**9
PATIENT = {'lockstep_timeout': 600.0}


def played(graph: Graph) -> str:
    return values(graph.next_report('bag_player'))['messages played']


@pytest.mark.parametrize(('storage', 'namespace'), [('mcap', '/lab'), ('sqlite3', '')])
def test_every_message_is_played_unchanged_and_in_order(
    graph, named, tmp_path, storage, namespace
):
    entries = run_of(named, 300)
    bag = write_bag(tmp_path / 'run', entries, storage, namespace)
    heard = {}
    for topic in (interfaces.CHAIN, interfaces.JOINT_STATES, interfaces.NUDGE):
        heard[topic.name] = messages = []
        graph.user.create_subscription(
            topic.type, f'{namespace}/{topic.name}', messages.append, topic.qos
        )
    player = graph.start(BagPlayer, {'bag': str(bag), 'rate': 10.0})
    graph.until(lambda: player.finished, 'the end of the bag')
    expected = {name: [m for t, _, m in entries if t.name == name] for name in heard}
    graph.until(lambda: sum(map(len, heard.values())) == len(entries), f'{len(entries)} messages')
    assert heard == expected


def test_latched_topics_come_first_and_the_rest_waits_for_a_subscriber(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 100))
    chains = graph.hear(interfaces.CHAIN)
    nudges = graph.hear(interfaces.NUDGE)
    graph.start(BagPlayer, {'bag': str(bag), 'subscriber_timeout': 3600.0})
    graph.until(lambda: chains, 'the chain')
    assert played(graph) == '1'
    assert nudges == []
    frames = graph.hear(interfaces.JOINT_STATES)
    graph.until(lambda: len(frames) == 100, 'the frames')
    assert frames[0] == frame_message(named, 0)
    graph.until(lambda: played(graph) == '102', 'the end of the bag')
    assert len(chains) == 1


def test_without_subscribers_it_plays_and_reports_so(graph, named, tmp_path, capfd):
    bag = write_bag(tmp_path / 'run', run_of(named, 10))
    player = graph.start(BagPlayer, {'bag': str(bag), 'subscriber_timeout': 0.0})
    graph.until(lambda: player.finished, 'the end of the bag')
    assert played(graph) == '12'
    said = 'nothing subscribes to /joint_states after 0 s; playing without subscribers'
    assert said in capfd.readouterr().err


def test_only_the_topics_that_are_asked_for_are_played(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 20), namespace='/lab')
    given = {
        'bag': str(bag),
        'topics': ['chain', '/joint_states', 'joint_states'],
        'subscriber_timeout': 0.0,
    }
    player = graph.start(BagPlayer, given)
    graph.until(lambda: player.finished, 'the end of the bag')
    topics = {publisher.topic_name for publisher in player.publishers}
    assert {name for name in topics if name.startswith('/lab')} == {
        '/lab/chain',
        '/lab/joint_states',
    }
    figures = values(graph.next_report('bag_player'))
    assert (figures['messages played'], figures['messages']) == ('21', '21')


def test_the_clock_shows_the_recorded_time_where_it_is_asked_for(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 20))
    clocks = graph.hear(interfaces.CLOCK)
    graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag), 'publish_clock': True})
    graph.until(lambda: player.finished and clocks, 'the end of the bag')
    shown = [time_from_msg(clock.clock) for clock in clocks]
    assert shown == sorted(shown)
    assert START <= shown[0] <= shown[-1] <= START + 20_000_000


@pytest.mark.parametrize(
    ('given', 'complaint'),
    [
        ({}, "parameter bag of bag_player = '' must be the path of a bag"),
        ({'bag': '/nowhere/at/all'}, "bag '/nowhere/at/all' does not exist"),
        ({'bag': 'RUN', 'topics': ['joints']}, "has no topic 'joints', it contains /chain, "),
        ({'bag': 'NUDGES', 'lockstep': True}, "has no topic 'joint_states', it contains /nudge"),
        ({'bag': 'RUN', 'wait_for': ['joints']}, "has no topic 'joints', it contains /chain, "),
        ({'bag': 'RUN', 'start_offset': 5.0}, 'start_offset of bag_player = 5 s must lie before'),
        ({'bag': 'RUN', 'start_offset': 6e307}, 'start_offset of bag_player = 6e+307 must lie in'),
    ],
)
def test_an_unplayable_bag_is_reported_in_one_line(graph, named, tmp_path, given, complaint):
    asked = dict(given)
    if (messages := {'RUN': 5, 'NUDGES': 1}.get(given.get('bag'))) is not None:
        asked['bag'] = str(write_bag(tmp_path / 'run', run_of(named, 3)[:messages]))
    with pytest.raises(ValueError, match=re.escape(complaint)) as refusal:
        graph.start(BagPlayer, asked)
    assert '\n' not in str(refusal.value)


def test_damage_that_shows_while_playing_ends_it_with_one_line(start, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 2000))
    data = bag / 'run_0_0.mcap'
    whole = data.read_bytes()
    record = len(serialize_message(frame_message(named, 0))) + 22
    # The length of a message record: the reader runs beyond the end of the chunk.
    opcode = whole.rindex(b'\x05' + record.to_bytes(8, 'little'), 0, len(whole) // 2)
    data.write_bytes(whole[: opcode + 1] + b'\xff' * 7 + whole[opcode + 8 :])
    program = start(
        'bag_player', '--ros-args', '-p', f'bag:={bag}', '-p', 'subscriber_timeout:=0.0'
    )
    assert program.wait() == 1
    assert f"bag '{bag}' is damaged: " in program.said[-1]
    assert 'Traceback' not in ''.join(program.said)


@pytest.mark.parametrize(('number', 'heard'), [(signal.SIGINT, True), (signal.SIGTERM, False)])
def test_a_signal_stops_it_while_it_plays_and_while_it_waits(
    graph, start, named, tmp_path, number, heard
):
    bag = write_bag(tmp_path / 'run', run_of(named, 2, gap=MINUTE))
    given = ['-p', f'bag:={bag}', '-p', 'subscriber_timeout:=3600.0']
    chains = graph.hear(interfaces.CHAIN)
    frames = graph.hear(interfaces.JOINT_STATES) if heard else chains
    program = start('bag_player', '--ros-args', *given)
    graph.until(lambda: frames, 'the first message')
    assert program.stop(number) == 0


def test_from_an_offset_the_last_latched_message_before_it_comes_first(graph, named, tmp_path):
    entries = chains_among_frames(named)
    bag = write_bag(tmp_path / 'run', entries)
    chains, frames = graph.hear(interfaces.CHAIN), graph.hear(interfaces.JOINT_STATES)
    given = {'bag': str(bag), 'start_offset': 0.055, 'playback_until': 0.065}
    player = graph.start(BagPlayer, given)
    graph.until(lambda: player.finished, 'the end')
    graph.until(lambda: len(frames) == 10, 'ten frames')
    assert frames_of(chains) == [50, 60]
    assert frames_of(frames) == list(range(55, 65))


def chains_among_frames(named: NamedChain) -> list[Any]:
    """A hundred frames of a millisecond, and a chain before each tenth, with the same stamp."""
    entries: list[Any] = []
    for topic, stamp, message in run_of(named, 100)[1:-1]:
        if (stamp - START) % (10 * MILLISECOND) == 0:
            chain = chain_to_msg(named, time_to_msg(stamp))
            entries.append((interfaces.CHAIN, stamp, chain))
        entries.append((topic, stamp, message))
    return entries


def test_a_seek_sends_the_preceding_latched_message_and_continues_there(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', chains_among_frames(named))
    chains, frames = graph.hear(interfaces.CHAIN), graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag), 'start_paused': True})
    graph.until(lambda: chains, 'the first chain')
    assert frames_of(chains) == [0]
    assert frames == []
    for place, origin in ((57, START), (71, 0), (33, START)):
        chains.clear()
        sought = time_to_msg(origin + place * MILLISECOND)
        assert graph.call(Seek, 'bag_player/seek', time=sought).success
        graph.until(lambda: chains, 'the chain before it')
        assert frames_of(chains) == [place // 10 * 10]
    for outside in (-1, 200):
        sought = time_to_msg(START + outside * MILLISECOND)
        assert not graph.call(Seek, 'bag_player/seek', time=sought).success
    assert frames == []
    assert graph.call(Trigger, 'bag_player/resume').success
    graph.until(lambda: player.finished and len(frames) == 67, 'the rest')
    assert frames_of(frames) == list(range(33, 100))


def test_the_time_in_which_the_recorder_was_paused_is_skipped(graph, named, tmp_path, capfd):
    entries = run_of(named, 20)
    paused, resumed = START + 9 * MILLISECOND + 1, START + 1000 * SECOND
    pause = resumed - paused
    later = [(t, stamp + pause * (stamp > paused), message) for t, stamp, message in entries]
    bag = write_bag(tmp_path / 'run', later, gaps=[(paused, resumed)])
    frames = graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag)})
    graph.until(lambda: player.finished and len(frames) == 20, 'the end')
    assert 'skipped 1000 s without a message' in capfd.readouterr().err


def test_in_a_pause_it_plays_message_by_message(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 20)[1:-1])
    frames = graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag), 'start_paused': True})
    assert graph.call(Trigger, 'bag_player/is_paused').success
    graph.until(lambda: graph.call(Trigger, 'bag_player/play_next').success, 'one message')
    for number in (2, 3):
        assert graph.call(Trigger, 'bag_player/play_next').success
        graph.until(lambda n=number: len(frames) == n, f'message {number}')
    assert graph.call(Trigger, 'bag_player/toggle_paused').success
    assert not graph.call(Trigger, 'bag_player/is_paused').success
    graph.until(lambda: player.finished and len(frames) == 20, 'the rest')
    assert frames == [frame_message(named, number) for number in range(20)]


def test_the_rate_is_set_and_reported(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 2, gap=MINUTE))
    player = graph.start(BagPlayer, {'bag': str(bag), 'subscriber_timeout': 0.0})
    assert graph.call(GetRate, 'bag_player/get_rate').rate == 1.0
    for refused in (0.0, -1.0, 1e4, float('nan')):
        assert not graph.call(SetRate, 'bag_player/set_rate', rate=refused).success
    assert graph.call(GetRate, 'bag_player/get_rate').rate == 1.0
    assert graph.call(SetRate, 'bag_player/set_rate', rate=1000.0).success
    graph.until(lambda: player.finished, 'the end of two minutes')


def test_it_waits_for_the_subscribers_that_are_expected(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 20))
    frames = graph.hear(interfaces.JOINT_STATES)
    given = {'bag': str(bag), 'wait_for': ['joint_states', 'nudge'], 'subscriber_timeout': 60.0}
    graph.start(BagPlayer, given)
    reports = graph.reports('bag_player')
    graph.until(lambda: len(reports) > 2, 'some time')
    assert frames == []
    nudges = graph.hear(interfaces.NUDGE)
    graph.until(lambda: len(frames) == 20, 'the frames')
    assert len(nudges) == 1


def test_in_lockstep_no_more_frames_are_on_their_way_than_the_window(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 50))
    frames = graph.hear(interfaces.JOINT_STATES)
    answers = interfaces.SOLITON_STATE.publisher(graph.user)
    graph.start(BagPlayer, {'bag': str(bag), 'lockstep': True, 'lockstep_window': 7})
    for expected in range(7, 51):
        graph.until(lambda n=expected: len(frames) == n, f'{expected} frames')
        reports = graph.reports('bag_player') if expected == 7 else []
        graph.until(lambda seen=reports, n=expected: seen or n > 7, 'some time')
        assert len(frames) == expected
        answers.publish(SolitonState(header=frames[expected - 7].header))


def test_in_lockstep_recorded_states_and_events_are_not_published(graph, named, tmp_path):
    recorded = [
        (interfaces.SOLITON_STATE, START, SolitonState()),
        (interfaces.SOLITON_EVENTS, START, SolitonEvent()),
    ]
    bag = write_bag(tmp_path / 'run', [*recorded, *run_of(named, 20)])
    frames, states, events = (
        graph.hear(topic)
        for topic in (
            interfaces.JOINT_STATES,
            interfaces.SOLITON_STATE,
            interfaces.SOLITON_EVENTS,
        )
    )
    answers = interfaces.SOLITON_STATE.publisher(graph.user)
    player = graph.start(BagPlayer, {'bag': str(bag), 'lockstep': True, **PATIENT})
    graph.until(lambda: len(frames) == 20, 'the frames')
    answers.publish(SolitonState(header=frames[-1].header))
    graph.until(lambda: player.finished and len(states) == 1, 'the end')
    assert states[0].header == frames[-1].header
    assert events == []


def test_frames_that_the_analyser_does_not_answer_are_given_up(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 20)[1:-1])
    interfaces.SOLITON_STATE.publisher(graph.user)
    frames = graph.hear(interfaces.JOINT_STATES)
    given = {'lockstep_window': 10, 'lockstep_timeout': 0.2}
    player = graph.start(BagPlayer, {'bag': str(bag), 'lockstep': True, **given})
    graph.until(lambda: player.finished, 'the end')
    assert len(frames) == 20
    report = graph.next_report('bag_player')
    assert report.message.endswith(', 20 frames without an answer of the analyser')
    assert report.level == report.WARN


def test_lockstep_needs_an_analyser(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 20))
    graph.hear(interfaces.JOINT_STATES)
    given = {'bag': str(bag), 'lockstep': True, 'subscriber_timeout': 1.0}
    player = graph.start(BagPlayer, given)
    graph.until(lambda: player.finished, 'the end')
    said = 'nothing publishes soliton_state after 1 s; start soliton_analyser'
    assert said in str(player.failure)


def test_the_keys_of_a_terminal_pause_step_and_change_the_rate(graph, named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 1000, gap=100 * MILLISECOND)[1:-1])
    frames = graph.hear(interfaces.JOINT_STATES)
    executable = Path(get_package_prefix(PACKAGE), 'lib', PACKAGE, 'bag_player')
    child, terminal = pty.fork()
    if not child:
        os.environ['ROS_DOMAIN_ID'] = str(graph.domain)
        arguments = ['--ros-args', '-p', f'bag:={bag}', '-p', 'start_paused:=true']
        os.execv(executable, [str(executable), *arguments])
    try:
        said = bytearray()

        def read(expected: bytes) -> bool:
            if select.select([terminal], [], [], 0)[0]:
                said.extend(os.read(terminal, 10000))
            return expected in said

        graph.until(lambda: read(b'0.0 of 99.9 s, paused'), 'the player to pause')
        os.write(terminal, b'\x1b[C')
        graph.until(lambda: read(b'') or len(frames) == 1, 'one frame')
        os.write(terminal, b'\x1b[A\x1b[A \x1b[B')
        graph.until(lambda: read(b's, x 1.1') and len(frames) > 5, 'faster playback')
        os.kill(child, signal.SIGINT)
        graph.until(lambda: read(b'played '), 'its end')
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(terminal)
