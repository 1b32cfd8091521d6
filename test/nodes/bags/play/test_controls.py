# SPDX-License-Identifier: Apache-2.0
"""Services pause, burst, stop and restart a player, as in rosbag2."""

import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Duration, Time
from graphs import Graph
from rclpy.node import Node
from recordings import MILLISECOND, START, frame_message, frames_of, run_of, write_bag

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.services import service_type
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

Services = dict[str, Callable[[Any, Any], Any]]


@pytest.fixture
def services(monkeypatch):
    """Return the callback of each service of the next player."""
    offered: Services = {}
    create = Node.create_service

    def note(node: Node, kind: Any, name: str, respond: Any, **options: Any) -> Any:
        if name.startswith('~/'):
            offered[name[2:]] = respond
        return create(node, kind, name, respond, **options)

    monkeypatch.setattr(BagPlayer, 'create_service', note)
    return offered


def burst(services: Services, number: int) -> int:
    response = services['burst'](
        SimpleNamespace(num_messages=number), SimpleNamespace(actually_burst=0)
    )
    return int(response.actually_burst)


def play(services: Services, offset: float = 0.0, duration: float = 0.0, until: int = 0) -> bool:
    request = SimpleNamespace(
        start_offset=time_to_msg(round(offset * 1e9)),
        playback_duration=Duration(sec=-1) if duration < 0 else seconds(duration),
        playback_until_timestamp=time_to_msg(until),
    )
    return bool(services['play'](request, SimpleNamespace(success=False)).success)


def seconds(duration: float) -> Duration:
    whole = time_to_msg(round(duration * 1e9))
    return Duration(sec=whole.sec, nanosec=whole.nanosec)


def wait_for_number(graph: Graph, heard: list[Any], number: int) -> None:
    """Wait for so many frames, and then for any that should not be."""
    graph.until(lambda: len(heard) >= number, f'{number} frames')
    graph.next_report('bag_player')


def ready(graph: Graph, services: Services) -> None:
    graph.until(lambda: burst(services, 1), 'the player to be ready')


def test_in_a_pause_messages_are_burst_to_the_end_and_again(graph, named, tmp_path, services):
    bag = write_bag(tmp_path / 'run', run_of(named, 20, gap=10**9)[1:-1])
    heard = graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag), 'start_paused': True})
    ready(graph, services)
    assert burst(services, 5) == 5
    assert burst(services, 0) == 14
    graph.until(lambda: len(heard) == 20, 'all frames')
    assert burst(services, 1) == 0
    assert not services['play_next'](None, SimpleNamespace(success=True)).success
    assert not player.finished
    services['seek'](SimpleNamespace(time=Time(sec=START // 10**9)), SimpleNamespace())
    graph.until(lambda: burst(services, 0), 'the player to begin again')
    graph.until(lambda: len(heard) == 40, 'all frames again')
    assert frames_of(heard) == 2 * list(range(20))
    services['resume'](None, SimpleNamespace())
    graph.until(lambda: player.finished, 'the end')


def test_there_is_no_burst_without_a_pause(graph, named, tmp_path, services, capfd):
    bag = write_bag(tmp_path / 'run', run_of(named, 2, gap=60 * 10**9))
    graph.start(BagPlayer, {'bag': str(bag)})
    assert burst(services, 1) == 0
    assert (
        'rejected ~/burst: the playback is not paused; call ~/pause first'
        in capfd.readouterr().err
    )


def test_a_part_of_the_bag_is_played_after_a_stop(graph, named, tmp_path, services):
    bag = write_bag(tmp_path / 'run', run_of(named, 100)[1:-1])
    heard = graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag), 'start_paused': True, 'stay': True})
    ready(graph, services)
    assert not play(services)
    parts = [
        ({'offset': 0.05}, range(50, 100)),
        ({'offset': 0.02, 'duration': 0.003}, range(20, 24)),
        ({'until': START + 5 * MILLISECOND}, range(6)),
        ({'duration': 0.004, 'until': START + 5 * MILLISECOND}, range(6)),
        ({'offset': 0.09, 'duration': -1.0}, range(90, 100)),
    ]
    services['resume'](None, SimpleNamespace())
    for part, expected in parts:
        services['stop'](None, SimpleNamespace())
        graph.next_report('bag_player')
        heard.clear()
        assert play(services, **part)
        wait_for_number(graph, heard, len(expected))
        assert frames_of(heard) == list(expected)
    assert not player.finished
    assert not play(services, offset=3600.0)


def test_a_stopped_player_restarts_with_its_parameters(graph, named, tmp_path, services):
    bag = write_bag(tmp_path / 'run', run_of(named, 30)[1:-1])
    heard = graph.hear(interfaces.JOINT_STATES)
    given = {'bag': str(bag), 'start_offset': 0.01, 'start_paused': True}
    player = graph.start(BagPlayer, given)
    for name in ('stop', 'stop', 'resume'):
        graph.call(service_type(name.capitalize()), f'bag_player/{name}')
    assert not player.finished
    assert heard == []
    assert services['play'](object(), SimpleNamespace(success=False)).success
    graph.until(lambda: player.finished and len(heard) == 20, 'the end')
    assert frames_of(heard) == list(range(10, 30))


def test_rounds_of_a_loop_are_whole_and_reported(graph, named, tmp_path, capfd):
    bag = write_bag(tmp_path / 'run', run_of(named, 10))
    chains, frames = graph.hear(interfaces.CHAIN), graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag), 'loop': True})
    graph.until(lambda: len(frames) >= 30, 'three rounds')
    report = graph.next_report('bag_player').message
    assert re.fullmatch(r'played \d+ messages in \d+ rounds \(the bag contains 12\)', report)
    graph.stop(player)
    assert frames[:30] == 3 * [frame_message(named, number) for number in range(10)]
    assert len(chains) >= 3
    (line,) = re.findall('played .*', capfd.readouterr().err)
    told = re.fullmatch(
        rf'played (\d+) messages of {bag} in (\d+) rounds \(the bag contains 12\)', line
    )
    assert told
    played, rounds = map(int, told.groups())
    assert 12 * (rounds - 1) <= played <= 12 * rounds


def test_jumps_are_reported(graph, named, tmp_path, capfd):
    bag = write_bag(tmp_path / 'run', run_of(named, 100, gap=50 * MILLISECOND)[1:-1])
    frames = graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag)})
    graph.until(lambda: frames, 'the first frame')
    late = time_to_msg(START + 99 * 50 * MILLISECOND)
    assert graph.call(service_type('Seek'), 'bag_player/seek', time=late).success
    graph.until(lambda: player.finished, 'the end')
    (line,) = re.findall('played .*', capfd.readouterr().err)
    told = rf'played \d+ messages of {bag} in 1 jump \(the bag contains 100\)'
    assert re.fullmatch(told, line)
