# SPDX-License-Identifier: Apache-2.0
"""Every part of the benchmark runs, and what it measured is possible."""

import json
import statistics
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from comparison import Comparison, Figure

Found = dict[str, Any]


def part(output: Path) -> Found:
    """Return a part whose table shows its comparisons and figures."""
    (found,) = json.loads(output.read_text()).values()
    table = output.with_suffix('.md').read_text()
    for row in (
        *(Comparison(**each).row() for each in found['comparisons']),
        *(Figure(**each).row() for each in found['figures']),
    ):
        assert row in table
    return dict(found)


def measured(found: Found) -> dict[str, list[float]]:
    return {each['what']: each['values'] for each in found['figures']}


def test_both_analyses_find_the_wall_and_ours_no_worse_than_its_noise(run_part):
    found = part(run_part('analyse'))
    for sides in found['details']['runs'].values():
        for name, farthest in (('theirs', 0.1), ('ours', 0.02)):
            assert all(0 < run['error'] < farthest for run in sides[name])
    used = found['details']['in_use']
    assert 0 < used['analysed'] <= used['sent'] == 1000
    assert used['cpu'] > 0


def test_growth_is_measured_at_every_size(run_part):
    output = run_part('growth', '--frames', '100', '--rotors', '20', '400')
    found = part(output)
    for work, by_size in found['details']['seconds'].items():
        assert list(by_size) == ['20', '400']
        growth = np.divide(by_size['400'], by_size['20'])
        exponents = measured(found)[f'{work}: exponent, 20 to 400']
        np.testing.assert_allclose(exponents, np.log(growth) / np.log(20))
    assert output.with_name('benchmark_growth.png').stat().st_size > 10_000


def test_the_identification_of_every_class_is_near_its_bound(run_part):
    output = run_part('identification')
    assert len(list((output.parent / 'identification_draws').iterdir())) == 6
    figures = measured(part(output))
    for name in ('flipper', 'wobbler', 'spinner'):
        assert 0.7 < figures[f'{name}: error / bound'][0] < 1.3
        assert figures[f'{name}: position error / bound'][0] < 1.3


def test_errors_of_integrators_fall_and_compilation_is_slower_than_loading(run_part):
    for needed in ('heyoka', 'mujoco', 'numba'):
        pytest.importorskip(needed, reason=f'needs {needed}: run make benchmark once')
    output = run_part('integrate', '--rotors', '20', '30')
    found = part(output)
    for curve in found['details']['curves']['flipper of 20'].values():
        errors = [setting['error'] for setting in curve]
        assert errors[-1] <= errors[0] < 1
    compiling, loading = (
        values for what, values in measured(found).items() if what.startswith('numba')
    )
    assert compiling[0] > loading[0] > 0
    assert output.with_name('benchmark_integrate.png').stat().st_size > 10_000


def test_memory_does_not_grow_for_a_browser_that_reads_nothing(run_part):
    figures = measured(part(run_part('live', '--only', 'silent')))
    assert figures['memory for a browser that reads nothing for 3 s'][0] < 20


def test_a_hundred_times_as_many_joints_take_longer_to_publish(run_part):
    found = part(run_part('publish', '--rounds', '3', '--rotors', '20', '2000'))
    seconds = found['details']['seconds']
    for way in ('idiomatic', 'ours', 'floor'):
        few, many = (seconds[f'{rotors} rotors, no subscriber'][way] for rotors in (20, 2000))
        assert statistics.median(many) > statistics.median(few) > 0


def test_both_simulators_run_at_a_rate(run_part):
    runs = part(run_part('rate'))['details']['runs']
    for side in ('ours', 'theirs'):
        (run,) = runs[side]
        assert 0 <= run['missed'] <= run['frames']
        assert run['real_time_factor'] > 0
        assert sorted(run['jitter']) == run['jitter']


def test_every_nudge_is_followed_by_impulses_a_frame_and_a_state(run_part):
    rounds = part(run_part('react', '--rounds', '2', '--nudges', '12'))['details']['seconds']
    assert len(rounds) == 2
    for seconds in rounds:
        order = [seconds[what] for what in ('rotor_impulses', 'joint_states', 'soliton_state')]
        assert np.shape(order) == (3, 12)
        assert (np.diff([np.zeros(12), *order], axis=0) > 0).all()


def test_recorders_are_sent_more_and_more_and_bags_are_analysed(run_part):
    pytest.importorskip('mcap', reason='needs mcap: pip install mcap')
    output = run_part('record')
    found = part(output)
    for kind in ('ours', 'raw', 'typed'):
        ((*bursts,),) = found['details'][f'N = 100, {kind}']
        asked = [burst['asked'] for burst in bursts]
        assert asked == [1000.0, 2000.0, 8000.0, 32000.0][: len(asked)]
        for burst in bursts:
            assert 0 <= burst['lost'] <= burst['sent']
            assert 0 < burst['sending'] <= burst['working']
    assert {path.name for path in output.parent.iterdir()} == {'benchmark.json', 'benchmark.md'}
