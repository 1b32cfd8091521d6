# SPDX-License-Identifier: Apache-2.0
"""The line in the terminal tells where the soliton is and how fast it goes."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from graphs import Graph

from soliton_linkage import progress
from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.programs.watch_soliton import WatchSoliton
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg


@pytest.fixture
def shown(
    graph: Graph,
    named: NamedChain,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Callable[[SolitonState, str], None]:
    """Publish a state again and again until somebody who watches is shown it."""
    monkeypatch.setattr(progress, '_LOG_INTERVAL', 0.0)
    graph.start(WatchSoliton)
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, time_to_msg(0)))
    states = graph.speak(interfaces.SOLITON_STATE)

    def show(state: SolitonState, expected: str) -> None:
        def seen() -> bool:
            states.publish(state)
            return expected in capsys.readouterr().err

        graph.until(seen, expected)

    return show


def test_it_shows_place_and_velocity_of_the_first_soliton(
    named: NamedChain, shown: Callable[[SolitonState, str], None]
) -> None:
    soliton = Soliton(rotor=3.5, velocity=-1.25 * named.chain.spacing, charge=1)
    state = SolitonState(solitons=[soliton, Soliton(rotor=6.0)])
    shown(state, f'rotor [{">" * 14}O{"<" * 15}]   3.50    -1.25 rotors/s')


def test_it_says_that_there_is_no_soliton(shown: Callable[[SolitonState, str], None]) -> None:
    shown(SolitonState(motion_name='flipper', solitons=[]), 'no soliton, flipper')
