# SPDX-License-Identifier: Apache-2.0
"""The conclusion of an experiment is correct; parallel experiments use separate folders."""

import math
from pathlib import Path
from typing import Any

from soliton_linkage_nodes.programs.experiment.program import claimed, conclusion, other_scenarios

SUMMARY: dict[str, Any] = {
    'motion': 'flipper',
    'rotors': 40,
    'crossings': 2,
    'first_sites': [24.0, 12.0],
    'last_sites': [51.94],
    'speed_rotors_per_s': 9.7,
    'recorded_messages': 4734,
    'lost_messages': 0,
    'replayed_messages': 2344,
    'frames_missing_in_replay': 0,
    'largest_replay_difference_rotors': 0.0,
}


def test_the_end_is_described():
    for changed, said in [
        ({}, 'A soliton crossed the chain of 40 rotors (flipper) 2 times at 9.70 rotors/s.'),
        ({'speed_rotors_per_s': None}, '(flipper) 2 times.'),
        ({'crossings': 0}, 'were first at rotors 24.0, 12.0, and last at 51.9.'),
        ({}, '4734 messages were recorded, none lost.'),
        ({'lost_messages': 3}, '4734 messages were recorded, 3 lost.'),
        ({}, 'Live and replayed positions agree to the last digit in all 2344 frames.'),
        ({'largest_replay_difference_rotors': 0.125}, 'differ by up to 0.12 rotor spacings.'),
        ({'largest_replay_difference_rotors': math.inf}, 'differ by up to inf rotor spacings.'),
        (
            {'frames_missing_in_replay': 7},
            '7 frames of the live analysis are missing in the replay.',
        ),
    ]:
        assert said in conclusion({**SUMMARY, **changed}, Path('out'), Path('out/flipper_0'))


def test_only_other_files_with_a_scenario_are_suggested(tmp_path):
    (tmp_path / 'a.yaml').write_text('[')
    (tmp_path / 'b.yaml').write_text('experiment: {ros__parameters: {scenario: c}}')
    (tmp_path / 'c.yaml').write_text('/**/experiment: {ros__parameters: {scenario: c}}')
    (tmp_path / 'mine.yaml').write_text('/**/experiment: {ros__parameters: {scenario: mine}}')
    (tmp_path / 'd.yaml').mkdir()
    assert other_scenarios(tmp_path / 'mine.yaml') == [tmp_path / 'c.yaml']


def test_a_folder_in_use_is_not_changed(tmp_path, capsys):
    demo = tmp_path / 'out' / 'demo'
    with claimed(demo) as first:
        assert first == demo
        with claimed(demo) as second, claimed(demo) as third:
            assert (second.name, third.name) == ('demo_1', 'demo_2')
        said = capsys.readouterr().out.splitlines()
    assert said[0] == f'Another experiment writes to {demo}; this one writes to {demo}_1.'
    with claimed(demo) as again:
        assert again == demo


def test_results_of_an_earlier_experiment_do_not_remain(tmp_path):
    (tmp_path / 'notes.txt').write_text('of the user')
    with claimed(tmp_path) as folder:
        (folder / 'index.html').write_text('film')
        (folder / 'filmed_0').mkdir()
        (folder / 'filmed_0' / 'metadata.yaml').write_text('bag')
    with claimed(tmp_path) as folder:
        assert [path.name for path in folder.iterdir()] == ['notes.txt']
