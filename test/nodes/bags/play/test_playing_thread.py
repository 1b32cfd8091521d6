# SPDX-License-Identifier: Apache-2.0
"""What was played more than once is counted as such."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from graphs import Graph
from recordings import MILLISECOND, START, run_of, write_bag

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.services import service_type
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg


def test_rounds_are_told(
    graph: Graph, named: NamedChain, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 10))
    frames = graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag), 'loop': True})
    graph.until(lambda: len(frames) >= 30, 'three rounds')
    report = graph.next_report('bag_player').message
    assert re.fullmatch(r'played \d+ messages in \d+ rounds \(the bag holds 12\)', report)
    graph.stop(player)
    (line,) = re.findall('played .*', capfd.readouterr().err)
    told = re.fullmatch(
        rf'played (\d+) messages of {bag} in (\d+) rounds \(the bag holds 12\)', line
    )
    assert told
    played, rounds = map(int, told.groups())
    assert 12 * (rounds - 1) <= played <= 12 * rounds


def test_jumps_are_told(
    graph: Graph, named: NamedChain, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 100, gap=50 * MILLISECOND)[1:-1])
    frames = graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag)})
    graph.until(lambda: frames, 'the first frame')
    late = time_to_msg(START + 99 * 50 * MILLISECOND)
    assert graph.call(service_type('Seek'), 'bag_player/seek', time=late).success
    graph.until(lambda: player.finished, 'the end')
    (line,) = re.findall('played .*', capfd.readouterr().err)
    told = rf'played \d+ messages of {bag} in 1 jump \(the bag holds 100\)'
    assert re.fullmatch(told, line)
