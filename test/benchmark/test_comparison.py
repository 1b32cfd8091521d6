# SPDX-License-Identifier: Apache-2.0
"""The tables of a benchmark contain its measurements."""

import json
from importlib.metadata import requires
from pathlib import Path

import pytest
from comparison import Comparison, Figure, Part, write

ROOT = Path(__file__).parents[2]


def test_a_ratio_is_taken_within_a_round():
    cost = Comparison('peer', 'work', 's', [2.0, 30.0, 4.0], [1.0, 10.0, 1.0])
    assert cost.ratios() == [2.0, 3.0, 4.0]
    assert cost.row() == '| peer | work | 4 s | 1 s | 3 (2 to 4) |'


def test_higher_rates_are_better():
    rate = Comparison('peer', 'work', 'Hz', [10.0], [25.0], more_is_better=True)
    assert rate.row() == '| peer | work | 10 Hz | 25 Hz | 2.5 (2.5 to 2.5) |'


def test_missing_measurements_of_a_peer_have_no_ratio():
    assert Comparison('peer', 'work', 's', [], [0.5e-3]).row() == (
        '| peer | work | not reached | 500 µs |  |'
    )


def test_rounds_must_be_as_many_of_both():
    with pytest.raises(ValueError, match='shorter'):
        Comparison('peer', 'work', 's', [1.0, 2.0], [1.0]).ratios()


def test_figures_stand_with_their_spread_and_goal():
    assert Figure('latency', 's', [2e-3, 1e-3, 3e-3], 'below 4 ms').row() == (
        '| latency | 2 ms (1 ms to 3 ms) | below 4 ms |'
    )
    assert Figure('memory', 'MB', [120.0]).row() == '| memory | 120 MB |  |'


def test_parts_stand_beside_each_other_in_their_order(tmp_path):
    output = tmp_path / 'benchmark.json'
    write(Part('publish', [Comparison('peer', 'work', 's', [2.0], [1.0])]), output)
    write(Part('integrate', figures=[Figure('memory', 'MB', [120.0])]), output)
    write(Part('publish', [Comparison('peer', 'work', 's', [3.0], [1.0])]), output)
    stored = json.loads(output.read_text())
    assert stored['publish']['comparisons'][0]['theirs'] == [3.0]
    table = output.with_suffix('.md').read_text()
    assert table.index('## integrate') < table.index('## publish')
    assert '3 (3 to 3)' in table
    assert '2 (2 to 2)' not in table


def test_the_extra_has_the_packages_of_the_benchmark():
    lines = (ROOT / 'setup/requirements-benchmark.txt').read_text().splitlines()
    installed = {line.partition(';')[0] for line in lines if not line.startswith('#')}
    extra = [each for each in requires('soliton_linkage') or [] if '"benchmark"' in each]
    assert {each.partition(';')[0] for each in extra} == installed
