# SPDX-License-Identifier: Apache-2.0
"""The command simulates the moves of its settings, tabulates them and draws them."""

import math
from pathlib import Path

import numpy as np
import pytest
from chains import FLIPPER, chain_of
from study_files import results, written

from soliton_linkage.steering.steering import Outcome
from soliton_linkage_studies import moves
from soliton_linkage_studies.moves import Condition, MoveRun, MoveTask, move_table, read_moves
from soliton_linkage_studies.settings import load_settings

CONFIG = Path(__file__).parents[3] / 'config/studies/moves.yaml'
SETTINGS = {
    'seed': 1,
    'frame_rate': 100.0,
    'moves': 1,
    'held': 0.2,
    'torque_limit': 0.1,
    'conditions': {'noisy': {'noise': 0.01, 'decay': 2.5, 'disorder': 0.05}},
    'chains': {'flipper': {'number_of_rotors': 8, 'rotor_length_ratio': 0.5, 'rest_angle': 0.97}},
}


def test_the_command_writes_table_and_picture(tmp_path, capsys):
    results(moves.main, 'moves', SETTINGS, tmp_path)
    lines = (tmp_path / 'new/out/table.md').read_text().splitlines()
    assert len(lines) == 3
    assert lines[2].startswith('| flipper | noisy | 1 of 1 |')
    assert '1 of 1' in capsys.readouterr().out


def test_a_run_covers_the_move_from_its_goal_to_its_end():
    chain = chain_of(FLIPPER, 8)
    task = MoveTask(chain, Condition(0.0, 0.0, 0.0), 2.0, 5.0, 0, 100.0, 0.5, 0.1)
    run = task()
    assert run.outcome is Outcome.REACHED
    assert run.times[0] == 0
    assert run.times[-1] == pytest.approx(run.duration + 0.5, abs=0.25)
    assert (run.positions[0], run.positions[-1]) == pytest.approx((2.0, 5.0), abs=1e-2)
    assert (run.references[0], run.references[-1]) == pytest.approx((2.0, 5.0), abs=1e-2)
    assert np.abs(run.positions - run.references).max() < 0.1
    assert run.error < 0.01
    assert run.energy_left < 1e-6 * run.peak_energy
    assert (run.phonon_energies >= 0).all()


def test_a_rejected_goal_is_reported():
    chain = chain_of(FLIPPER, 8)
    run = MoveTask(chain, Condition(0.0, 0.0, 0.0), 2.0, 9.0, 0, 100.0, 0.0, 0.1)()
    assert run.outcome is Outcome.OUT_OF_CHAIN
    assert math.isnan(run.error)
    assert run.duration == 0


def test_the_table_contains_the_worst_of_the_reached_moves():
    times = np.zeros(1)

    def run(outcome: Outcome, error: float, left: float) -> MoveRun:
        return MoveRun(outcome, 3.0, times, times, times, times, error, left, 2.0)

    runs = [
        run(Outcome.REACHED, 0.01, 1e-6),
        run(Outcome.REACHED, 0.002, 4e-6),
        run(Outcome.SOLITON_LOST, math.nan, 1.0),
    ]
    *_, line, failed = move_table({('a', 'b'): runs, ('c', 'd'): runs[2:]}).splitlines()
    assert line == '| a | b | 2 of 3 | 0.0100 | 4.0e-06 | 2.0e-06 | 3.0 to 3.0 |'
    assert failed == '| c | d | 0 of 1 |  |  |  |  |'


def test_the_installed_settings_are_valid_and_a_quick_study_has_fewer_moves():
    settings = load_settings(CONFIG)
    study, quick = (read_moves(settings, each) for each in (False, True))
    assert study.keys() == quick.keys()
    for key, tasks in study.items():
        assert quick[key] == tasks[: len(quick[key])]
        assert len(quick[key]) < len(tasks)


def test_wrong_settings_are_named(tmp_path, capsys):
    for key, value in [('moves', 0), ('frame_rate', -1.0), ('surprise', 1), ('chains', 3)]:
        path = written(SETTINGS | {key: value}, tmp_path)
        assert moves.main([str(path), '--output', str(tmp_path)]) == 1
        assert key in capsys.readouterr().err
