# SPDX-License-Identifier: Apache-2.0
import asyncio
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from soliton_linkage_msgs.msg import LastKick
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder
from soliton_linkage_nodes.live_view.commands import ChainCommands
from soliton_linkage_nodes.live_view.moves import Move
from soliton_linkage_nodes.runtime import interfaces

ACTIONS: dict[str, Callable[[ChainCommands], Any]] = {
    'nudge': lambda commands: commands.nudge(1.0),
    'drive': lambda commands: commands.drive('kick', 'nearest', 1.0, (0.0, 0.0, 0.0)),
    'tilt': lambda commands: commands.tilt(0.1),
    'pause': lambda commands: commands.pause(True),
    'step': lambda commands: commands.step(1),
    'reset': lambda commands: commands.reset('initial'),
    'release': lambda commands: commands.release(),
    'move_to': lambda commands: commands.move_to(3.0, 0.0, 1.0),
    'identify': lambda commands: commands.call_identifier('identify'),
}


def done(action: Callable[[ChainCommands], Any], commands: ChainCommands) -> None:
    async def act() -> None:
        await action(commands)

    asyncio.run(act())


def test_a_read_only_page_sends_no_command(graph):
    for name in ACTIONS:
        commands = ChainCommands(graph.user, '/', True, ChainFinder(graph.user, '/'))
        with pytest.raises(ValueError, match='this page is read-only'):
            done(ACTIONS[name], commands)
        commands.close()


def test_a_command_without_a_receiver_is_rejected_with_a_remedy(graph):
    for name in ACTIONS:
        commands = ChainCommands(graph.user, '/', False, ChainFinder(graph.user, '/'))
        with pytest.raises(
            ValueError, match=r'^no node (subscribes to|serves) .*; start|^no node serves '
        ):
            done(ACTIONS[name], commands)
        commands.close()


def test_a_late_report_of_another_command_is_not_the_answer(graph):
    chain = SimpleNamespace(kick=None, kicks=0)
    finder = SimpleNamespace(chains={'/': chain}, reports={})
    commands = ChainCommands(graph.user, '/', False, finder)
    heard = graph.hear(interfaces.NUDGE)
    graph.until(lambda: commands.subscribers('nudge'), 'the subscriber')

    async def act() -> str:
        sent = asyncio.create_task(commands.nudge(1.0))
        for source in ('/edge_command', '/edge_command, /nudge'):
            await asyncio.sleep(0.1)
            assert not sent.done()
            chain.kick, chain.kicks = LastKick(source=source, name=[source]), chain.kicks + 1
        return await sent

    assert '/nudge' in asyncio.run(act())
    graph.until(lambda: heard, 'the nudge')
    commands.close()


def test_progress_is_the_completed_fraction_of_the_distance():
    move = Move('under way', goal=10.0, start=4.0)
    assert move.progress == 0.0
    move.rotor = 7.0
    assert move.progress == pytest.approx(0.5)
    move.rotor = 11.0
    assert move.progress == 1.0


def reported(
    started: int, ended: str = '', ends: tuple[float, float] | None = None
) -> dict[str, str]:
    start, goal = ends or (math.nan, math.nan)
    figures = {'moves begun': started, 'move from rotor': start, 'move to rotor': goal}
    texts = {'last move': ended, 'holding': 'True'}
    return {name: str(value) for name, value in figures.items()} | texts


@pytest.fixture
def commands(graph):
    made = ChainCommands(graph.user, '/', True, ChainFinder(graph.user, '/'))
    yield made
    made.close()


def test_a_move_of_another_client_is_followed(commands):
    commands.follow(1.0, reported(3, 'reached: there'))
    assert commands.move.state == ''
    commands.follow(2.0, reported(4, 'reached: there', (2.0, 10.0)))
    assert (commands.move.state, commands.move.foreign) == ('under way', True)
    commands.move.rotor = 4.0
    assert commands.move.progress == pytest.approx(0.25)
    commands.follow(2.0, reported(9, '', (0.0, 1.0)))
    assert commands.move.goal == 10.0
    commands.follow(3.0, reported(4, 'stopped: at rotor 6'))
    assert (commands.move.state, commands.move.message) == ('stopped', 'at rotor 6')
    commands.follow(4.0, reported(6, 'reached: at rotor 7'))
    assert (commands.move.state, commands.move.message) == ('reached', 'at rotor 7')


def test_a_move_of_this_page_is_not_foreign(commands):
    commands.follow(1.0, reported(3))
    commands.move = Move('under way', goal=5.0, start=1.0)
    commands.follow(2.0, reported(4, '', (1.0, 5.0)))
    assert not commands.move.foreign
    commands.move.state = 'reached'
    commands.follow(3.0, reported(4, '', (1.0, 5.0)))
    assert (commands.move.state, commands.move.foreign) == ('reached', False)


def test_an_outcome_disappears_when_the_steering_releases_the_soliton(commands):
    commands.move = Move('reached', goal=5.0, start=1.0, message='held', ended_at=2.0)
    commands.follow(3.0, reported(4) | {'holding': 'True'})
    assert (commands.move.state, commands.holding) == ('reached', True)
    commands.follow(4.0, reported(4) | {'holding': 'False'})
    assert (commands.move.state, commands.holding) == ('', False)


def test_invalid_reports_are_ignored(commands):
    for text in ['', 'nan', 'inf', 'nonsense']:
        commands.follow(1.0, {})
        commands.follow(2.0, {'moves begun': text, 'move to rotor': text, 'move from rotor': text})
        assert repr(commands.move) == repr(Move())
