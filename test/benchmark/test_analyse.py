# SPDX-License-Identifier: Apache-2.0
"""The comparison of analyses runs, and every figure that it prints is measured."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import pytest

ROUNDS = 2


@pytest.fixture(scope='module')
def output(run_part: Callable[..., Path]) -> Path:
    return run_part('analyse')


@pytest.fixture(scope='module')
def found(output: Path) -> dict[str, Any]:
    stored: dict[str, Any] = json.loads(output.read_text())['analyse']
    return stored


def test_comparisons_are_those_of_the_runs(found: dict[str, Any], output: Path) -> None:
    compared = iter(found['comparisons'])
    table = output.with_suffix('.md').read_text()
    for rotors, sides in found['details']['runs'].items():
        rates, costs, errors = next(compared), next(compared), next(compared)
        for name, side in sides.items():
            assert len(side) == ROUNDS
            assert rates[name] == [run['frames'] / run['wall'] for run in side]
            assert costs[name] == [run['cpu'] / run['frames'] for run in side]
            assert errors[name] == [run['error'] for run in side]
        for each in (rates, costs, errors):
            assert each['work'].startswith(f'N = {rotors}: ')
        ratio = median(o / t for o, t in zip(rates['ours'], rates['theirs'], strict=True))
        assert f'| {rates["work"]} | {median(rates["theirs"]):.4g} 1/s |' in table
        assert f'| {ratio:.3g} (' in table
    assert next(compared, None) is None


def test_both_find_the_wall_and_ours_no_worse_than_its_noise(found: dict[str, Any]) -> None:
    for sides in found['details']['runs'].values():
        for name, farthest in (('theirs', 0.1), ('ours', 0.02)):
            assert all(0 < run['error'] < farthest for run in sides[name])


def test_the_node_is_sent_every_frame_and_its_share_is_of_the_time(found: dict[str, Any]) -> None:
    used = found['details']['in_use']
    analysed, share = found['figures'][:2]
    assert used['sent'] == 1000
    assert 0 < used['analysed'] <= used['sent']
    assert analysed['values'] == [100 * used['analysed'] / used['sent']]
    assert share['values'] == [used['cpu'] / used['seconds']]
    assert used['cpu'] > 0
    assert used['seconds'] > 0.99 * (used['sent'] - 1) / 1000


def test_each_record_has_its_median_and_its_slowest_frames(found: dict[str, Any]) -> None:
    times = found['details']['times']
    assert len(times) == 8
    figures = iter(found['figures'][2:])
    for name, seen in times.items():
        assert len(seen) == 20
        median_of, nearly_all, largest = (next(figures) for _ in range(3))
        assert median_of['what'].startswith(f'{name}: ')
        assert median_of['values'] == [median(seen)]
        assert largest['values'] == [max(seen)]
        assert median(seen) <= nearly_all['values'][0] <= max(seen)
    assert next(figures, None) is None
