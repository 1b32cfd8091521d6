# SPDX-License-Identifier: Apache-2.0
"""The measurement of cost against size runs, and prints a fit of its measurements."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SIZES = (20, 400)
WORKS = (
    'right-hand side',
    'compiled force',
    'zero mode',
    'analysis',
    'published message',
    'recorded message',
)


@pytest.fixture(scope='module')
def output(run_part: Callable[..., Path]) -> Path:
    return run_part('growth', '--frames', '100', '--rotors', *map(str, SIZES))


@pytest.fixture(scope='module')
def part(output: Path) -> dict[str, Any]:
    return json.loads(output.read_text())['growth']


def values(part: dict[str, Any], what: str) -> list[float]:
    (found,) = [each['values'] for each in part['figures'] if each['what'] == what]
    return found


def test_every_work_is_timed_at_every_size(part: dict[str, Any]) -> None:
    seconds = part['details']['seconds']
    assert tuple(seconds) == WORKS
    for work, by_size in seconds.items():
        assert tuple(map(int, by_size)) == SIZES
        for size, rounds in by_size.items():
            assert len(rounds) == 2
            assert min(rounds) > 0
            assert values(part, f'{work}, N = {size}') == rounds


def test_twenty_times_the_rotors_take_more_time(part: dict[str, Any]) -> None:
    seconds = part['details']['seconds']
    for work in ('right-hand side', 'compiled force', 'zero mode'):
        assert max(seconds[work]['400']) > min(seconds[work]['20'])


def test_exponents_are_those_of_the_times(part: dict[str, Any]) -> None:
    for work, by_size in part['details']['seconds'].items():
        expected = [
            math.log(large / small, 20.0)
            for small, large in zip(by_size['20'], by_size['400'], strict=True)
        ]
        assert values(part, f'{work}: exponent, 20 to 400') == pytest.approx(expected)


def test_memory_is_that_of_processes(part: dict[str, Any]) -> None:
    assert 10 < values(part, 'simulator resident, N = 400')[0] < 10_000
    assert 10 < values(part, 'analyse_bag resident, N = 100, 100 frames')[0] < 10_000


def test_a_picture_and_the_table_are_left(output: Path) -> None:
    assert output.with_name('benchmark_growth.png').stat().st_size > 10_000
    assert {path.name for path in output.parent.iterdir()} == {
        'benchmark.json',
        'benchmark.md',
        'benchmark_growth.png',
    }
