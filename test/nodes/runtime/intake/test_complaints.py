# SPDX-License-Identifier: Apache-2.0
"""Each distinct complaint is said at once, floods of one are said once a while."""

from __future__ import annotations

import pytest

from soliton_linkage_nodes.runtime.intake import complaints
from soliton_linkage_nodes.runtime.intake.complaints import MOST_LINES, Complaints


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(complaints.time, 'monotonic', lambda: now[0])
    return now


@pytest.mark.usefixtures('clock')
def test_each_reason_gets_a_line() -> None:
    said: list[str] = []
    teller = Complaints(said.append, 1.0)
    reasons = [f'nudge: {chr(97 + n)} is wrong' for n in range(26)]
    for reason in reasons:
        teller.tell(reason)
    assert said == reasons


def test_a_reason_with_other_numbers_is_the_same_until_a_while_is_over(
    clock: list[float],
) -> None:
    said: list[str] = []
    teller = Complaints(said.append, 1.0)
    for speed in range(1000):
        teller.tell(f'speed = {speed}.5e-3 rad/s of rotor_{speed} is too fast')
    clock[0] += 1.0
    teller.tell('speed = inf rad/s of rotor_3 is too fast')
    assert said == [
        'speed = 0.5e-3 rad/s of rotor_0 is too fast',
        'speed = inf rad/s of rotor_3 is too fast (and 999 more like it)',
    ]


def test_a_flood_of_reasons_is_bounded_in_lines_and_memory(clock: list[float]) -> None:
    said: list[str] = []
    teller = Complaints(said.append, 1.0)
    names = [''.join(chr(97 + n // 26**k % 26) for k in range(4)) for n in range(20_000)]
    for name in names:
        teller.tell(f'no joint {name}')
    assert len(said) == MOST_LINES
    assert len(teller) <= MOST_LINES
    clock[0] += 1.0
    teller.tell('no joint at all')
    assert said[MOST_LINES] == (
        f'no joint at all (and {20_000 - MOST_LINES} other complaints in the second before)'
    )
