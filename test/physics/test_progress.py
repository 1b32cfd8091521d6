# SPDX-License-Identifier: Apache-2.0
"""Tests of the progress line in a terminal and in a file."""

import io

import pytest

from soliton_linkage import progress
from soliton_linkage.progress import ProgressLine


class Screen(io.StringIO):
    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self._terminal = terminal

    def isatty(self) -> bool:
        return self._terminal


class Clock:
    now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(progress, 'time', clock)
    return clock


def screen(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> Screen:
    screen = Screen(terminal)
    monkeypatch.setattr('sys.stderr', screen)
    return screen


def test_a_file_contains_plain_lines_and_no_bar_without_a_total(clock, monkeypatch):
    written = screen(monkeypatch, terminal=False)
    line = ProgressLine('checking my_run_0', 0)
    line.show(0, '1000 messages')
    clock.now += 3
    line.show(5)
    bar = ProgressLine('playing', 4)
    bar.show(1)
    bar.end('played')
    assert written.getvalue().splitlines() == [
        'checking my_run_0: 1000 messages',
        'checking my_run_0',
        'playing [########......................]  25% ',
        'played',
    ]


def test_a_terminal_shows_one_updated_line_below_permanent_notes(clock, monkeypatch):
    written = screen(monkeypatch, terminal=True)
    line = ProgressLine('playing', 4)
    for done in (0, 1, 4):
        line.show(done)
        clock.now += 1
    line.note('louder now')
    line.clear()
    line.end('played')
    parts = written.getvalue().split('\r\x1b[K')[1:]
    assert [part.strip()[-4:].strip() for part in parts[:3]] == ['0%', '25%', '100%']
    assert parts[3:] == ['louder now\n', '', 'played\n']


@pytest.mark.parametrize(('terminal', 'interval'), [(True, 0.1), (False, 2.0)])
def test_updates_within_the_interval_are_skipped(clock, monkeypatch, terminal, interval):
    written = screen(monkeypatch, terminal)
    line = ProgressLine('playing', 4)
    for done in (1, 2, 3):
        line.show(done)
        clock.now += (0.9, 0.2, 0.0)[done - 1] * interval
    shown = [f'{share}%' in written.getvalue() for share in (25, 50, 75)]
    assert shown == [True, False, True]


@pytest.mark.parametrize(
    ('width', 'title', 'remark', 'expected'),
    [
        (20, 'playing', '', 'g [##........]  25% '),
        (
            60,
            'playing /a/long/way/to/the/bags/run_0',
            '0.0 of 99.9 s, paused',
            'ay/to/the/bags/run_0 [##........]  25% 0.0 of 99.9 s, paused',
        ),
    ],
)
def test_a_short_line_keeps_the_remark_and_cuts_bar_and_title(
    clock, monkeypatch, width, title, remark, expected
):
    written = screen(monkeypatch, terminal=True)
    monkeypatch.setattr(progress, 'line_width', lambda: width)
    line = ProgressLine(title, 4)
    line.show(1, remark)
    clock.now += 1
    line.show_text(2 * width * 'x')
    assert written.getvalue().split('\r\x1b[K')[1:] == [expected, width * 'x']
