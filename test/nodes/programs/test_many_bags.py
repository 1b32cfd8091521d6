# SPDX-License-Identifier: Apache-2.0
"""The table of several bags is complete even if worker processes die."""

import csv

import pytest
from pretended_analysis import pretend
from recordings import run_of, write_bag

from soliton_linkage_nodes.programs import analyse_bag
from soliton_linkage_nodes.programs.analyse_bag import COLUMNS, BagBatch, analyse_many, named_bags


def test_the_table_is_complete_though_a_worker_is_killed(tmp_path, capsys):
    (tmp_path / 'bag_20.deadly').touch()
    bags = [tmp_path / f'bag_{n}' for n in range(40)]
    assert analyse_many(BagBatch(named_bags(bags), tmp_path, pretend), 1) == 1
    rows = list(csv.DictReader((tmp_path / 'bags.csv').open()))
    assert [row['bag'] for row in rows] == [str(bag) for bag in bags]
    assert [row['failure'] for row in rows if row['failure']] == ['bag_7 has no frame']
    assert {row['mean noise [rad]'] for row in rows if not row['failure']} == {'0.001'}
    assert capsys.readouterr().err.count('new processes continue') == 1
    assert not (tmp_path / 'bag_20.deadly').exists()


def test_several_bags_give_the_results_of_each_and_failures_are_reported(named, tmp_path, capsys):
    bag = write_bag(tmp_path / 'run', run_of(named, 50))
    given = [str(bag), str(tmp_path / 'none'), '--workers', '1']
    with pytest.raises(SystemExit) as ended:
        analyse_bag.main([*given, '--output', str(tmp_path / 'many')])
    assert ended.value.code == 1
    analyse_bag.main([str(bag), '--output', str(tmp_path / 'alone')])
    states = [tmp_path / folder / 'soliton_state.csv' for folder in ('many/run_0', 'alone')]
    assert states[0].read_text() == states[1].read_text()
    rows = list(csv.DictReader((tmp_path / 'many/bags.csv').open()))
    assert tuple(rows[0]) == COLUMNS
    assert rows[0]['failure'] == ''
    assert int(rows[0]['frames']) == len(states[1].read_text().splitlines()) - 1
    assert 'does not exist' in rows[1]['failure'] or 'cannot be read' in rows[1]['failure']
    assert '1 of 2 bags in ' in capsys.readouterr().out


def test_bags_of_one_name_are_distinguished_and_none_is_analysed_twice(tmp_path):
    paths = [tmp_path / 'a/run_0', tmp_path / 'b/run_0', tmp_path / 'run_1']
    assert [name for name, _ in named_bags(paths)] == ['a_run_0', 'b_run_0', 'run_1']
    with pytest.raises(ValueError, match='run_1 is given twice'):
        named_bags([*paths, paths[-1]])
