# SPDX-License-Identifier: Apache-2.0
"""A sweep file defines a grid, or is rejected with file, key, value, limit and remedy."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage_studies.measures import SweepTrial
from soliton_linkage_studies.sweep.config import Axis, SweepStudy, read_sweep_study, trial_of
from soliton_linkage_studies.workers import measure_chunk

CONFIGS = sorted((Path(__file__).parents[3] / 'config/studies').glob('*.yaml'))
SWEEPS = [path for path in CONFIGS if 'sweep:' in path.read_text(encoding='utf-8')]
GRID = 'sweep: {rest_angle: [0.5, 0.97]}'


def study_of(tmp_path: Path, content: str) -> SweepStudy:
    path = tmp_path / 'mine.yaml'
    path.write_text(content, encoding='utf-8')
    return read_sweep_study(path, quick=False)


@given(st.lists(st.integers(1, 4), min_size=1, max_size=3), st.integers(1, 3))
def test_rows_have_the_order_of_nested_loops_over_the_grid(sizes, seeds):
    names = ('rest_angle', 'rotor_length_ratio', 'kick')
    axes = [
        Axis(name, tuple(0.1 * (1 + number) for number in range(size)))
        for name, size in zip(names, sizes, strict=False)
    ]
    study = SweepStudy('any', 'motion', {}, tuple(axes), tuple(range(5, 5 + seeds)))
    loops = itertools.product(*(axis.values for axis in axes), study.seeds)
    positions = [study.point(row) for row in range(study.rows)]
    assert [(*values.values(), seed) for values, seed in positions] == list(loops)


def test_ranges_include_both_ends_and_have_equal_steps_on_their_scale(tmp_path):
    study = study_of(
        tmp_path,
        """
        measure: motion
        sweep:
          rotor_length_ratio: {from: 0.1, to: 10.0, points: 5, scale: log}
          rest_angle: {from: 0.2, to: 1.0, points: 5}
          number_of_rotors: {from: 10, to: 20, points: 3}
        """,
    )
    ratios, angles, rotors = study.axes
    assert ratios.values == pytest.approx([0.1, math.sqrt(0.1), 1, math.sqrt(10), 10], rel=1e-14)
    assert angles.values == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0], rel=1e-14)
    assert rotors.values == (10, 15, 20)
    assert ratios.logarithmic
    assert not angles.logarithmic


def test_parameters_become_the_chain_its_deviations_and_the_trial():
    parameters = {
        'number_of_rotors': 12,
        'spacing': 0.2,
        'rotor_length_ratio': 1.5,
        'rest_angle': 0.7,
        'deviations.mass': 0.1,
        'deviations.spacing': 0.2,
        'deviations.scale': 0.5,
        'kick': 0.3,
        'mechanics': 'rigid',
    }
    chain, trial = trial_of(parameters, 7)
    deviations = drawn_deviations(12, 7, mass=0.05, spacing=0.1)
    assert chain == Chain(12, 0.2, 1.5 * 0.2, 0.7, deviations=deviations)
    assert trial == SweepTrial(kick=0.3, mechanics='rigid')


def test_axis_values_override_fixed_parameters(tmp_path):
    study = study_of(
        tmp_path,
        """
        measure: motion
        chain: {rotor_length: 0.07, rest_angle: 0.4}
        sweep: {rotor_length_ratio: [3.0], rest_angle: [1.1]}
        """,
    )
    values, seed = study.point(0)
    chain, _ = trial_of({**study.parameters, **values}, seed)
    assert (chain.rotor_length, chain.rest_angle) == (3.0 * chain.spacing, 1.1)


def test_the_installed_sweeps_are_valid_and_a_quick_sweep_is_coarser():
    for path in SWEEPS:
        whole, quick = read_sweep_study(path), read_sweep_study(path, quick=True)
        assert quick.name == f'{whole.name}-quick'
        assert quick.rows < whole.rows
        for axis, thinned in zip(whole.axes, quick.axes, strict=True):
            assert set(thinned.values) <= set(axis.values)
            assert (thinned.values[0], thinned.values[-1]) == (axis.values[0], axis.values[-1])
        assert set(quick.seeds) <= set(whole.seeds)


def test_seeds_are_counted_or_listed(tmp_path):
    assert study_of(tmp_path, f'measure: motion\nseeds: 3\n{GRID}').seeds == (0, 1, 2)
    assert study_of(tmp_path, f'measure: motion\nseeds: [4, 2]\n{GRID}').seeds == (4, 2)
    assert study_of(tmp_path, f'measure: motion\n{GRID}').seeds == (0,)


def test_an_impossible_chain_gives_a_row_with_its_error():
    axis = Axis('deviations.rotor_length', (0.0, 1.0))
    study = SweepStudy('any', 'motion', {'number_of_rotors': 40}, (axis,), (0,))
    assert study.cells(0) == ['0', '0.0', '0', 'flipper', '0', '']
    number, value, seed, motion, obstacles, failure = study.cells(1)
    assert (number, value, seed, motion, obstacles) == ('1', '1.0', '0', '', '')
    assert 'must be a finite number above -1' in failure


def test_a_row_does_not_depend_on_the_rows_of_its_chunk():
    chain = {'number_of_rotors': 12, 'deviations.rotor_length': 0.02, 'tolerance': 1e-6}
    axes = (Axis('mechanics', ('elastic', 'rigid')), Axis('kick', (0.1, 0.2)))
    for measure in ('speed', 'survival'):
        study = SweepStudy('any', measure, {**chain, 'time_limit': 300.0}, axes, (0, 1))
        chunked, remaining = list[list[str]](), list(range(study.rows))
        while remaining:
            cells, remaining, _ = measure_chunk(study, remaining)
            chunked += cells
        assert chunked == [study.cells(row) for row in reversed(range(study.rows))][::-1]


def test_floats_are_written_without_loss_of_digits():
    values = tuple(np.geomspace(0.1, 1, 7).tolist())
    study = SweepStudy('any', 'motion', {}, (Axis('rest_angle', values),), (0,))
    assert tuple(float(study.cells(row)[1]) for row in range(study.rows)) == values


def test_errors_in_a_file_are_reported(tmp_path):
    for content, complaint in [
        (f'measure: colour\n{GRID}', "measure = 'colour' must be one of motion, speed, survival"),
        (GRID, 'measure is missing; give one of motion'),
        (f'measure: motion\nspeed: 3\n{GRID}', 'speed = 3 is not known; known keys are measure'),
        ('measure: motion\nsweep: 3', 'sweep = 3 must contain one or more parameters'),
        ('measure: motion\nsweep: {length: [1]}', r'sweep.length = \[1\] is not known'),
        ('measure: motion\nsweep: {kick: 3}', 'sweep.kick = 3 must be a list of 1 to 10000'),
        (
            'measure: motion\nsweep: {rest_angle: [0.5, 2.0]}',
            'sweep.rest_angle.1 = 2.0 must be a number in the range 0.001 to 1.57',
        ),
        ('measure: motion\nsweep: {kick: [0.1, 0.1]}', 'has duplicate values; remove them or'),
        (
            'measure: motion\nsweep: {kick: {from: 0.1, to: 1.0}}',
            'sweep.kick.points is missing; give a whole number in the range 2 to 10000',
        ),
        (
            'measure: motion\nsweep: {kick: {from: 0.1, to: 1.0, points: 3, scale: cubic}}',
            "sweep.kick.scale = 'cubic' must be one of linear, log",
        ),
        (
            'measure: motion\n'
            'sweep: {deviations.mass: {from: 0.0, to: 0.1, points: 3, scale: log}}',
            'deviations.mass.from = 0.0 must be above 0 on a log scale; write scale: linear',
        ),
        (
            'measure: motion\nsweep: {mechanics: {from: 0, to: 1, points: 2}}',
            r'sweep.mechanics.from = 0 must be a list; write \[elastic, rigid\]',
        ),
        (
            'measure: motion\nsweep: {mechanics: [soft]}',
            "sweep.mechanics.0 = 'soft' must be one of elastic, rigid",
        ),
        (
            'measure: motion\nsweep: {rotor_length: [0.1], rotor_length_ratio: [1.0]}',
            'contains rotor_length and rotor_length_ratio; remove one',
        ),
        (
            'measure: motion\nchain: {spacing: 1000.0}\nsweep: {rotor_length_ratio: [2.0]}',
            'sweep.rotor_length_ratio = 2.0 gives Chain.rotor_length = 2000.0 must lie in the '
            'range 1e-06 to 1000 m; change this value or a parameter of the chain',
        ),
        (
            'measure: motion\nchain: {periodic: true}\n' + GRID,
            'chain.periodic = True is not known, because sweeps use chains with free ends; '
            'remove it',
        ),
        (f'measure: motion\nseeds: 0\n{GRID}', 'seeds = 0 must be a whole number in the range 1'),
        (f'measure: motion\nseeds: [1, 1]\n{GRID}', 'must be a list of different seeds, or'),
        (
            'measure: motion\nseeds: 10000\nsweep: {kick: {from: 0.1, to: 1.0, points: 5000}}',
            'gives 50000000 rows, more than 10000000; reduce the points or the seeds',
        ),
    ]:
        with pytest.raises(ValueError, match=f'mine.yaml: .*{complaint}'):
            study_of(tmp_path, content)
