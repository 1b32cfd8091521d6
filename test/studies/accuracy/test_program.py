# SPDX-License-Identifier: Apache-2.0
"""The command writes the results of its settings."""

from pathlib import Path

import pytest
from study_files import pictures, written

from soliton_linkage_studies.accuracy import program as accuracy
from soliton_linkage_studies.settings import load_settings

CONFIG = Path(__file__).parents[3] / 'config/studies/accuracy.yaml'

FLIPPER = {'number_of_rotors': 12, 'rotor_length_ratio': 0.5, 'rest_angle': 0.97}
SPINNER = {'number_of_rotors': 14, 'rotor_length_ratio': 2.0, 'rest_angle': 1.18}
SETTINGS = {
    'single_frame': {
        'seed': 1,
        'frames': 60,
        'cold_every': 10,
        'coarse_start': 0.5,
        'noises': [0.05],
        'chains': {'flipper': FLIPPER, 'spinner': SPINNER},
    },
    'contraction': {
        'seed': 2,
        'noise': 0.01,
        'frames': 100,
        'chains': {
            'flipper': {
                'chain': FLIPPER | {'number_of_rotors': 20},
                'kicks': [0.1],
                'reference': {'kicks': [0.1], 'speeds': [0.193], 'widths': [0.9]},
            }
        },
    },
    'record': {
        'seed': 3,
        'noise': 0.05,
        'frame_rate': 1000.0,
        'frames': 30,
        'speed': 5.0,
        'runs': 2,
        'chains': {'flipper': FLIPPER},
    },
    'rigid_steps': {
        'steps': 100,
        'speed': 0.05,
        'acceleration': 9.81,
        'tilt': 0.5,
        'chains': {'flipper': FLIPPER | {'number_of_rotors': 5}},
    },
}
CELLS = {'cells': {'count': 2, 'frames': 30}}
FILES = {
    'table.md',
    'table.csv',
    'contraction_simulated.md',
    'record.md',
    'rigid_steps.md',
    *pictures(
        'single_frame', 'bias_by_position', 'contraction_simulated', 'record', 'rigid_steps'
    ),
}


def test_all_files_are_written(tmp_path, capsys):
    config = written(SETTINGS, tmp_path)
    folder = tmp_path / 'new/folder'
    assert accuracy.main([str(config), '--output', str(folder), '--workers', '1']) == 0
    assert {path.name for path in folder.iterdir()} == FILES
    lines = (folder / 'table.md').read_text(encoding='utf-8').splitlines()
    assert len(lines) == 2 + 4 + 5
    assert [line.split('|')[7] for line in lines if 'without a guess' in line] == [' 0 of 6 '] * 2
    assert 'are in' in capsys.readouterr().out


def test_cells_are_measured_alone_and_compared_with_an_earlier_table(tmp_path, capsys):
    config = written(SETTINGS | CELLS, tmp_path)
    chosen = [str(config), '--cells', '0', '--frames', '12', '--output', str(tmp_path)]
    assert accuracy.main([*chosen, '--seed', '7', '--workers', '1']) == 0
    folder = tmp_path / 'cells_7'
    table = folder / 'cells.csv'
    assert {path.name for path in folder.iterdir()} == {
        'configuration.yaml',
        'cells.csv',
        'table.md',
        *pictures('normalised_errors'),
    }
    assert len(table.read_text(encoding='utf-8').splitlines()) == 2
    assert 'seed 7' in capsys.readouterr().out

    # An existing table is not measured again.
    marked = table.read_text(encoding='utf-8').replace(',12,', ',1200,')
    table.write_text(marked, encoding='utf-8')
    assert accuracy.main([*chosen, '--seed', '7', '--workers', '1', '--against', str(table)]) == 0
    assert table.read_text(encoding='utf-8') == marked
    assert '0 of 1 cells are worse' in capsys.readouterr().out
    assert accuracy.main([*chosen, '--seed', '7', '--frames', '13']) == 1
    assert 'differs in frames' in capsys.readouterr().err


def test_the_installed_settings_contain_every_part_and_quick_parts_have_fewer_tasks():
    settings = load_settings(CONFIG)
    assert set(settings.values) == {*accuracy.PARTS, accuracy.CELLS}
    full, quick = (accuracy.read_parts(settings, quick) for quick in (False, True))
    assert len(full) == len(accuracy.PARTS)
    for all_of_it, less in zip(full, quick, strict=True):
        assert 0 < len(less.tasks()) < len(all_of_it.tasks())


def test_invalid_settings_are_named(tmp_path, capsys):
    for part, key, value, complaint in [
        ('single_frame', 'frames', 1, 'single_frame.frames = 1 must be a whole number'),
        ('single_frame', 'noises', [0.0], 'single_frame.noises = [0.0] must be a list of numbers'),
        ('single_frame', 'frame', 10, 'single_frame.frame = 10 is not known'),
        (
            'single_frame',
            'chains',
            {'short': FLIPPER | {'number_of_rotors': 5}},
            'short.number_of_rotors = 5 leaves no position at a distance of two wall widths (2.42 '
            'spacings) from both edges; use 6 or more',
        ),
        ('contraction', 'noise', -1, 'contraction.noise = -1 must be a number'),
        (
            'contraction',
            'chains',
            {
                'mine': {
                    'chain': FLIPPER,
                    'kicks': [0.1],
                    'reference': {'kicks': [0.1], 'speeds': [0.1, 0.2], 'widths': [0.9]},
                }
            },
            'reference.speeds = [0.1, 0.2] must have one value per kick (1)',
        ),
        ('record', 'runs', 1, 'record.runs = 1 must be a whole number'),
    ]:
        settings = {**SETTINGS, part: {**SETTINGS[part], key: value}}
        config = written(settings, tmp_path)
        assert accuracy.main([str(config), '--output', str(tmp_path / 'out')]) == 1
        said = capsys.readouterr().err
        assert complaint in said
        assert said.count('\n') == 1
        assert not (tmp_path / 'out').exists()


def test_a_file_without_parts_or_with_unknown_parts_is_rejected(tmp_path):
    with pytest.raises(ValueError, match='is empty; give one or more of single_frame'):
        accuracy.read_parts(load_settings(written({}, tmp_path)), False)
    with pytest.raises(ValueError, match='other = 1 is not known; known keys are single_frame'):
        accuracy.read_parts(load_settings(written({'other': 1}, tmp_path)), False)
