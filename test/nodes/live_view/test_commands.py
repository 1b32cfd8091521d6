# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from graphs import Graph

from soliton_linkage_nodes.live_view.commands import ChainCommands, Move

ACTIONS: dict[str, Callable[[ChainCommands], Any]] = {
    'nudge': lambda commands: commands.nudge(1.0),
    'drive': lambda commands: commands.drive('kick', 'nearest', 1.0, (0.0, 0.0, 0.0)),
    'tilt': lambda commands: commands.tilt(0.1),
    'pause': lambda commands: commands.pause(True),
    'step': lambda commands: commands.step(1),
    'reset': lambda commands: commands.reset('initial'),
    'release': lambda commands: commands.release(),
    'carry': lambda commands: commands.carry(3.0, 0.0, 1.0),
}


def done(action: Callable[[ChainCommands], Any], commands: ChainCommands) -> None:
    async def act() -> None:
        answer = action(commands)
        if not isinstance(answer, str):
            await answer

    asyncio.run(act())


@pytest.mark.parametrize('name', ACTIONS)
def test_a_read_only_page_does_nothing(graph: Graph, name: str) -> None:
    commands = ChainCommands(graph.user, '/', read_only=True)
    with pytest.raises(ValueError, match='this page is read-only'):
        done(ACTIONS[name], commands)
    commands.close()


@pytest.mark.parametrize('name', ACTIONS)
def test_what_nobody_hears_is_said_with_who_would(graph: Graph, name: str) -> None:
    commands = ChainCommands(graph.user, '/', read_only=False)
    with pytest.raises(ValueError, match=r'^nothing (subscribes to|serves) '):
        done(ACTIONS[name], commands)
    commands.close()


def test_progress_is_the_share_of_the_way() -> None:
    move = Move('under way', goal=10.0, begun=4.0)
    assert move.progress == 0.0
    move.rotor = 7.0
    assert move.progress == pytest.approx(0.5)
    move.rotor = 11.0
    assert move.progress == 1.0
