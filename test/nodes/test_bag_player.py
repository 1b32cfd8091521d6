# SPDX-License-Identifier: Apache-2.0
"""A bag is played whole, in order and at its pace, and to somebody who listens."""

from __future__ import annotations

import re
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from graphs import Graph, values
from programs import Program
from recordings import START, frame_message, run_of, write_bag

from soliton_linkage_nodes import bag_player, interfaces
from soliton_linkage_nodes.bag_player import BagPlayer
from soliton_linkage_nodes.conversions import NamedChain, time_from_msg

MINUTE = 60 * 10**9


class Clock:
    """Stands in for the module time, and goes on only while somebody waits."""

    now = 1000.0

    def monotonic(self) -> float:
        return self.now


class Waiting(threading.Event):
    """An event that is never waited for."""

    clock: Clock

    def wait(self, timeout: float | None = None) -> bool:
        if not self.is_set():
            self.clock.now += timeout or 0.0
        return self.is_set()


class TimedPlayer(BagPlayer):
    """A player that notes what it plays, and when."""

    def __init__(self, **kwargs: Any) -> None:
        self.played: list[tuple[str, float]] = []
        super().__init__(**kwargs)

    def _publish(self, connection: Any, serialized: bytes) -> None:
        self.played.append((connection.topic, bag_player.time.monotonic()))
        super()._publish(connection, serialized)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('namespace', ['', '/lab'])
def test_every_message_is_played_in_order_as_it_was(
    graph: Graph, named: NamedChain, tmp_path: Path, storage: str, namespace: str
) -> None:
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


@pytest.mark.parametrize('rate', [0.5, 1.0, 4.0])
def test_messages_are_paced_by_when_they_were_received(
    graph: Graph,
    named: NamedChain,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    rate: float,
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 50, gap=7_000_001))
    graph.hear(interfaces.JOINT_STATES)
    clock = Clock()
    monkeypatch.setattr(Waiting, 'clock', clock, raising=False)
    monkeypatch.setattr(bag_player, 'time', clock)
    fake = SimpleNamespace(Event=Waiting, Thread=threading.Thread)
    monkeypatch.setattr(bag_player, 'threading', fake)
    player = graph.start(TimedPlayer, {'bag': str(bag), 'rate': rate})
    graph.until(lambda: player.finished, 'the end of the bag')
    frames = [when for topic, when in player.played if topic == '/joint_states']
    assert [when - frames[0] for when in frames] == pytest.approx(
        [number * 0.007000001 / rate for number in range(50)], abs=1e-9
    )


def test_latched_topics_come_first_and_the_rest_waits_for_a_subscriber(
    graph: Graph, named: NamedChain, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 100))
    chains = graph.hear(interfaces.CHAIN)
    nudges = graph.hear(interfaces.NUDGE)
    player = graph.start(TimedPlayer, {'bag': str(bag), 'subscriber_timeout': 3600.0})
    graph.until(lambda: chains, 'the chain')
    assert [topic for topic, _ in player.played] == ['/chain']
    assert nudges == []
    frames = graph.hear(interfaces.JOINT_STATES)
    graph.until(lambda: len(frames) == 100, 'the frames')
    assert frames[0] == frame_message(named, 0)
    assert [topic for topic, _ in player.played].count('/chain') == 1
    assert len(player.played) == 102


def test_a_late_analyser_still_gets_the_chain(
    graph: Graph, named: NamedChain, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 2, gap=MINUTE))
    frames = graph.hear(interfaces.JOINT_STATES)
    graph.start(BagPlayer, {'bag': str(bag)})
    graph.until(lambda: frames, 'the first frame')
    chains = graph.hear(interfaces.CHAIN)
    graph.until(lambda: chains, 'the chain')


def test_where_nobody_subscribes_it_plays_to_nobody_and_says_so(
    graph: Graph, named: NamedChain, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 10))
    player = graph.start(TimedPlayer, {'bag': str(bag), 'subscriber_timeout': 0.0})
    graph.until(lambda: player.finished, 'the end of the bag')
    assert len(player.played) == 12
    said = 'nothing subscribes to /joint_states after 0 s; playing to nobody'
    assert said in capfd.readouterr().err


def test_only_the_topics_that_are_asked_for_are_played(
    graph: Graph, named: NamedChain, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 20), namespace='/lab')
    given = {
        'bag': str(bag),
        'topics': ['chain', '/joint_states', 'joint_states'],
        'subscriber_timeout': 0.0,
    }
    player = graph.start(TimedPlayer, given)
    graph.until(lambda: player.finished, 'the end of the bag')
    assert {topic for topic, _ in player.played} == {'/lab/chain', '/lab/joint_states'}
    assert len(player.played) == 21
    figures = values(graph.next_report('bag_player'))
    assert (figures['messages played'], figures['messages']) == ('21', '21')


def test_the_clock_shows_the_recorded_time_where_it_is_asked_for(
    graph: Graph, named: NamedChain, tmp_path: Path
) -> None:
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
        ({'bag': 'RUN', 'topics': ['joints']}, "has no topic 'joints', it holds /chain, "),
        ({'bag': 'NUDGES'}, "has no topic 'joint_states', it holds /nudge"),
        ({'bag': 'FILE'}, 'cannot be read'),
        ({'bag': 'RUN', 'rate': 0.0}, 'rate of bag_player = 0.0 must lie in the range'),
        ({'bag': 'RUN', 'speed': 2.0}, "parameter 'speed' of bag_player is unknown"),
    ],
)
def test_what_cannot_be_played_is_said_in_one_line(
    graph: Graph, named: NamedChain, tmp_path: Path, given: dict[str, Any], complaint: str
) -> None:
    run = run_of(named, 3)
    paths = {
        'RUN': write_bag(tmp_path / 'run', run),
        'NUDGES': write_bag(tmp_path / 'nudges', run[:1]),
        'FILE': tmp_path / 'file.txt',
    }
    paths['FILE'].write_text('no bag')
    asked = dict(given)
    if asked.get('bag') in paths:
        asked['bag'] = str(paths[asked['bag']])
    with pytest.raises(ValueError, match=re.escape(complaint)) as refusal:
        graph.start(BagPlayer, asked)
    assert '\n' not in str(refusal.value)


def test_damage_that_shows_while_playing_ends_it_with_one_line(
    start: Callable[..., Program], named: NamedChain, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 2000))
    data = bag / 'run_0.mcap'
    whole = data.read_bytes()
    place = whole.rindex(b'\x00rotor_7\x00', 0, len(whole) // 2)
    # The length of the record after it: the reader runs beyond the end of the chunk.
    opcode = whole.index(b'\x05', place + 200)
    data.write_bytes(whole[: opcode + 1] + b'\xff' * 7 + whole[opcode + 8 :])
    program = start(
        'bag_player', '--ros-args', '-p', f'bag:={bag}', '-p', 'subscriber_timeout:=0.0'
    )
    assert program.wait() == 1
    assert f"bag '{bag}' is damaged: " in program.said[-1]
    assert 'Traceback' not in ''.join(program.said)


def test_it_ends_by_itself_once_everybody_has_everything(
    graph: Graph, start: Callable[..., Program], named: NamedChain, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 500))
    frames = graph.hear(interfaces.JOINT_STATES)
    program = start('bag_player', '--ros-args', '-p', f'bag:={bag}', '-p', 'rate:=100.0')
    graph.until(lambda: program.process.poll() is not None, 'its end')
    assert program.process.returncode == 0
    assert program.said[-1] == f'played 502 of 502 messages of {bag}'
    graph.until(lambda: len(frames) == 500, 'the frames')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('heard', [True, False])
def test_a_signal_stops_it_while_it_plays_and_while_it_waits(
    graph: Graph,
    start: Callable[..., Program],
    named: NamedChain,
    tmp_path: Path,
    number: signal.Signals,
    heard: bool,
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 2, gap=MINUTE))
    given = ['-p', f'bag:={bag}', '-p', 'subscriber_timeout:=3600.0']
    chains = graph.hear(interfaces.CHAIN)
    frames = graph.hear(interfaces.JOINT_STATES) if heard else chains
    program = start('bag_player', '--ros-args', *given)
    graph.until(lambda: frames, 'what it plays first')
    assert program.stop(number) == 0
