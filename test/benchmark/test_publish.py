# SPDX-License-Identifier: Apache-2.0
"""The comparison of publishing runs, and its table contains the measured times."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

WORKS = ('20 rotors, no subscriber', '2000 rotors, no subscriber', '20 rotors, one subscriber')


@pytest.fixture(scope='module')
def output(run_part: Callable[..., Path]) -> Path:
    return run_part('publish', '--rounds', '3', '--rotors', '20', '2000')


@pytest.fixture(scope='module')
def part(output: Path) -> dict[str, Any]:
    return json.loads(output.read_text())['publish']


def test_every_way_is_timed_in_every_round(part: dict[str, Any]) -> None:
    seconds = part['details']['seconds']
    assert set(WORKS) < set(seconds)
    for times in seconds.values():
        assert set(times) == {'idiomatic', 'ours', 'floor'}
        for rounds in times.values():
            assert len(rounds) == 3
            assert min(rounds) > 0


def test_a_hundred_times_as_many_joints_take_longer(part: dict[str, Any]) -> None:
    few, many = (part['details']['seconds'][work] for work in WORKS[:2])
    for way in few:
        assert statistics.median(many[way]) > statistics.median(few[way])


def test_the_table_is_made_of_these_times(part: dict[str, Any], output: Path) -> None:
    table = output.with_suffix('.md').read_text()
    for work in WORKS:
        times = part['details']['seconds'][work]
        ours, floor, theirs = times['ours'], times['floor'], times['idiomatic']
        against = statistics.median(t / o for t, o in zip(theirs, ours, strict=True))
        assert f'| {against:.3g} (' in row_of(table, f'| JointState of lists | {work} |')
        over = statistics.median(o / f for o, f in zip(ours, floor, strict=True))
        assert f'| {over:.4g} (' in row_of(table, f'| ours / constant bytes, {work} |')


def row_of(table: str, beginning: str) -> str:
    (row,) = [line for line in table.splitlines() if line.startswith(beginning)]
    return row
