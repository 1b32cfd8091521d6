# SPDX-License-Identifier: Apache-2.0
"""The line in the terminal tells where the soliton is and how fast it goes."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from graphs import Graph

from soliton_linkage.studies import progress
from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg, time_to_msg
from soliton_linkage_nodes.programs.watch_soliton import WatchSoliton
from soliton_linkage_nodes.runtime import interfaces


@pytest.fixture
def show(
    graph: Graph, named: NamedChain, monkeypatch: pytest.MonkeyPatch
) -> Callable[[SolitonState], None]:
    """Publish a state to somebody who watches."""
    monkeypatch.setattr(progress, '_LOG_INTERVAL', 0.0)
    watcher = graph.start(WatchSoliton)
    chain = graph.speak(interfaces.CHAIN)
    chain.publish(chain_to_msg(named, time_to_msg(0)))
    state = graph.speak(interfaces.SOLITON_STATE)
    graph.until(lambda: watcher._line.total, 'the chain')
    return state.publish


def test_it_shows_place_and_velocity_of_the_first_soliton(
    graph: Graph,
    named: NamedChain,
    show: Callable[[SolitonState], None],
    capsys: pytest.CaptureFixture[str],
) -> None:
    soliton = Soliton(rotor=3.5, velocity=-1.25 * named.chain.spacing, charge=1)
    show(SolitonState(solitons=[soliton, Soliton(rotor=6.0)]))
    said = ''

    def seen() -> bool:
        nonlocal said
        said += capsys.readouterr().err
        return '3.50' in said

    graph.until(seen, 'a line')
    assert f'rotor [{">" * 14}O{"<" * 15}]   3.50    -1.25 rotors/s' in said


def test_it_says_that_there_is_no_soliton(
    graph: Graph, show: Callable[[SolitonState], None], capsys: pytest.CaptureFixture[str]
) -> None:
    show(SolitonState(motion_name='flipper', solitons=[]))
    said = ''

    def seen() -> bool:
        nonlocal said
        said += capsys.readouterr().err
        return 'no soliton, flipper' in said

    graph.until(seen, 'a line')
