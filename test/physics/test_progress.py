# SPDX-License-Identifier: Apache-2.0
"""The progress line rewrites itself in a terminal and stays readable in a file."""

from __future__ import annotations

import io

import pytest

from soliton_linkage import progress
from soliton_linkage.progress import ProgressLine


class Screen(io.StringIO):
    """What is written to stderr."""

    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self._terminal = terminal

    def isatty(self) -> bool:
        return self._terminal


class Clock:
    """Stands in for the module time."""

    now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(progress, 'time', clock)
    return clock


def screen(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> Screen:
    screen = Screen(terminal)
    monkeypatch.setattr('sys.stderr', screen)
    return screen


def test_without_a_total_there_is_no_bar(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    written = screen(monkeypatch, terminal=False)
    line = ProgressLine('checking my_run_0', 0)
    line.show(0, '1000 messages')
    clock.now += 3
    line.show(5)
    assert written.getvalue() == 'checking my_run_0: 1000 messages\nchecking my_run_0\n'


def test_in_a_terminal_one_line_is_rewritten(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = screen(monkeypatch, terminal=True)
    line = ProgressLine('playing', 4)
    for done in (0, 1, 4):
        line.show(done)
        clock.now += 1
    line.end('played')
    text = written.getvalue()
    assert text.count('\n') == 1
    assert text.endswith('\r\x1b[Kplayed\n')
    assert [part.strip()[-4:].strip() for part in text.split('\r\x1b[K')[1:4]] == [
        '0%',
        '25%',
        '100%',
    ]


def test_in_a_file_each_state_is_a_line_without_control_characters(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = screen(monkeypatch, terminal=False)
    line = ProgressLine('playing', 4)
    line.show(1)
    line.end('played')
    assert written.getvalue().splitlines() == [
        'playing [########......................]  25% ',
        'played',
    ]


@pytest.mark.parametrize(('terminal', 'interval'), [(True, 0.1), (False, 2.0)])
def test_what_comes_too_soon_is_not_shown(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, terminal: bool, interval: float
) -> None:
    written = screen(monkeypatch, terminal)
    line = ProgressLine('playing', 4)
    line.show(1)
    clock.now += 0.9 * interval
    line.show(2)
    clock.now += 0.2 * interval
    line.show(3)
    assert ['25%' in written.getvalue(), '50%' in written.getvalue()] == [True, False]
    assert '75%' in written.getvalue()


def test_a_line_is_no_longer_than_the_terminal(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = screen(monkeypatch, terminal=True)
    monkeypatch.setattr(progress, 'line_width', lambda: 20)
    line = ProgressLine('playing', 4)
    line.show(1)
    clock.now += 1
    line.show_text(30 * 'x')
    assert written.getvalue().split('\r\x1b[K')[1:] == ['g [##........]  25% ', 20 * 'x']


def test_on_a_short_line_the_remark_is_kept_before_bar_and_title(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = screen(monkeypatch, terminal=True)
    monkeypatch.setattr(progress, 'line_width', lambda: 60)
    line = ProgressLine('playing /a/long/way/to/the/bags/run_0', 4)
    line.show(1, '0.0 of 99.9 s, paused')
    shown = written.getvalue().split('\r\x1b[K')[1]
    assert shown == 'ay/to/the/bags/run_0 [##........]  25% 0.0 of 99.9 s, paused'
    assert len(shown) == 60


def test_a_note_stays_above_the_line_which_can_be_taken_away(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = screen(monkeypatch, terminal=True)
    line = ProgressLine('playing', 4)
    line.show(1)
    line.note('louder now')
    clock.now += 1
    line.show(2)
    line.clear()
    parts = written.getvalue().split('\r\x1b[K')
    assert [parts[2], parts[-1]] == ['louder now\n', '']
