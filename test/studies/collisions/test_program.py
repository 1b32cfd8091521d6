# SPDX-License-Identifier: Apache-2.0
"""The command simulates, draws and tabulates the collisions."""

import csv

from study_files import pictures, written

from soliton_linkage_studies.collisions import program as collisions

RING = {'rotor_length_ratio': 0.5, 'rest_angle': 0.3}
SETTINGS = {
    'collision': {'length': 40, 'step': 1.0, 'patience': 60},
    'sweeps': {'flipper': {**RING, 'speeds': {'from': 0.2, 'to': 0.4, 'points': 3}}},
    'variations': {
        **RING,
        'speeds': {'from': 0.3, 'to': 0.4, 'points': 2},
        'changes': {'base': {}, 'longer': {'length': 60}},
        'edges': {'some speed': {'collisions': 1, 'inside': 0.4, 'outside': 0.18}},
    },
    'critical_speeds': {
        'inside': 0.5,
        'outside': 0.3,
        'rings': {'r/a = 0.5': {'rotor_length_ratio': 0.5, 'lean_ratios': [0.4]}},
    },
    'pictures': {
        'one': {**RING, 'speed': 0.4},
        'turning': {'rotor_length_ratio': 8, 'rest_angle': 0.9, 'speed': 0.6},
    },
}
FILES = pictures('collisions', 'collision_windows', 'collision_pictures')


def test_it_draws_and_tabulates(tmp_path, capsys):
    path, output = written(SETTINGS, tmp_path), tmp_path / 'out'
    command = [str(path), '--output', str(output), '--quick', '--workers', '1']
    assert collisions.main(command) == 0
    assert {each.name for each in output.iterdir()} == FILES | {'table.md', 'quick'}
    told = capsys.readouterr()
    assert (output / 'table.md').read_text(encoding='utf-8') in told.out
    # At 0.3 c the walls separate, so that no edge lies above it.
    assert '1 of 4 collisions failed' in told.out
    with (output / 'collisions.csv').open(newline='', encoding='utf-8') as file:
        points = list(csv.DictReader(file))
    assert [(point['panel'], point['series']) for point in points] == [('flipper', 'captured')]
