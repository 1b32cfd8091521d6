# SPDX-License-Identifier: Apache-2.0
"""The comparison of recorders runs, and every figure that it prints is measured."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

KINDS = ('ours', 'raw', 'typed')


@pytest.fixture(scope='module')
def output(run_part: Callable[..., Path]) -> Path:
    pytest.importorskip('mcap', reason='needs mcap: pip install mcap')
    return run_part('record')


@pytest.fixture(scope='module')
def part(output: Path) -> dict[str, Any]:
    return json.loads(output.read_text())['record']


def comparisons(part: dict[str, Any], words: str) -> list[dict[str, Any]]:
    return [each for each in part['comparisons'] if words in each['work']]


def taken(bursts: list[dict[str, Any]]) -> float:
    rates = []
    for burst in bursts:
        if burst['lost']:
            break
        rates.append(burst['sent'] / burst['working'])
    return max(rates, default=0.0)


def test_every_recorder_was_sent_more_and_more(part: dict[str, Any]) -> None:
    for kind in KINDS:
        ((*bursts,),) = part['details'][f'N = 100, {kind}']
        asked = [burst['asked'] for burst in bursts]
        assert asked == [1000.0, 2000.0, 8000.0, 32000.0][: len(asked)]
        for burst in bursts:
            assert 0 <= burst['lost'] <= burst['sent']
            assert burst['sent'] <= burst['asked'] * burst['sending'] + 1
            assert 0 < burst['sending'] <= burst['working']
            assert burst['processor'] > 0


def test_rates_and_shares_are_those_of_the_bursts(part: dict[str, Any]) -> None:
    trials = {kind: part['details'][f'N = 100, {kind}'][0] for kind in KINDS}
    for kind, each in zip(KINDS[1:], comparisons(part, 'without loss'), strict=True):
        for side, name in ((each['theirs'], kind), (each['ours'], 'ours')):
            rate = taken(trials[name])
            assert side == ([rate] if rate else [])
    for kind, each in zip(KINDS[1:], comparisons(part, 'at 1000 Hz'), strict=True):
        for side, name in ((each['theirs'], kind), (each['ours'], 'ours')):
            first = trials[name][0]
            assert side == pytest.approx([100 * first['processor'] / first['working']])


def test_bags_are_read_and_analysed(part: dict[str, Any]) -> None:
    decoded, analysed = comparisons(part, 'decode')[0], comparisons(part, 'analyse')[0]
    assert decoded['theirs'] == analysed['theirs']
    assert 0 < analysed['ours'][0] < decoded['ours'][0]


def test_the_table_contains_the_measurements(output: Path, part: dict[str, Any]) -> None:
    table = output.with_suffix('.md').read_text()
    for each in part['comparisons']:
        if not (each['theirs'] and each['ours']):
            continue
        pairs = zip(each['theirs'], each['ours'], strict=True)
        ratios = [o / t if each['more_is_better'] else t / o for t, o in pairs]
        (row,) = [
            line
            for line in table.splitlines()
            if line.startswith(f'| {each["peer"]} | {each["work"]} |')
        ]
        assert f'| {statistics.median(ratios):.3g} (' in row


def test_nothing_is_left_behind(output: Path, part: dict[str, Any]) -> None:
    assert part['name'] == 'record'
    assert {path.name for path in output.parent.iterdir()} == {'benchmark.json', 'benchmark.md'}
