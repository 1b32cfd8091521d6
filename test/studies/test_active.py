# SPDX-License-Identifier: Apache-2.0
"""Walls in active chains move as the theory along their orbits states."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from study_files import results

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.initial_states import with_pair
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_studies.active import program
from soliton_linkage_studies.active.runs import (
    ActiveTask,
    coordinates,
    motorised,
    moving,
    outcome,
    stability_limit,
    terminal_velocity,
    wall_drive,
    wall_sites,
)

CONFIG = Path(__file__).parents[2] / 'config/studies/active.yaml'
FLIPPER = Chain(50, rotor_length=0.03)
SPINNER = Chain(50, rotor_length=0.2, rest_angle=1.4)


def test_wide_walls_move_at_twice_the_ratio_whatever_their_charge():
    deviations = []
    for rotor_length in (0.05, 0.03, 0.02):
        chain = Chain(60, rotor_length=rotor_length)
        deviations.append([abs(wall_drive(chain, charge).ratio - 2) for charge in (1, -1)])
    assert np.all(np.diff(deviations, axis=0) < 0)
    assert np.max(deviations[-1]) < 0.03


@pytest.mark.parametrize(('chain', 'charge'), [(FLIPPER, 1), (FLIPPER, -1), (SPINNER, 1)])
@pytest.mark.parametrize('decay', [4.0, 10.0])
def test_the_terminal_velocity_is_that_of_the_orbit(chain, charge, decay):
    drive, active = wall_drive(chain, charge), motorised(chain, decay, 2.0)
    expected = 2 * drive.ratio
    angles, rates = moving(active, 10.5, charge, expected)
    task = ActiveTask(active, angles, rates, 8.0, 0.02, charge, fixed=charge < 0)
    run = task()
    velocity, error = terminal_velocity(run)
    assert velocity == pytest.approx(expected, rel=2e-3, abs=3 * error)
    assert outcome(run) == 'runs'
    assert run.imbalance < 1e-7
    end = slice(len(run.injected) // 2, len(run.injected) * 3 // 4)
    power = active.damping * expected**2 * drive.squares
    assert run.dissipated[end].mean() == pytest.approx(power, rel=0.02)
    assert run.injected[end].mean() == pytest.approx(power, rel=0.02)


def test_an_anti_kink_stays_below_the_pinning_threshold_and_leaves_above():
    chain = Chain(40, rotor_length=0.05)
    pinning = wall_drive(chain, -1).pinning
    decay = 4.0
    threshold = pinning / (decay * chain.moment_of_inertia)
    found = {}
    for ratio in (0.5 * threshold, 2.0 * threshold):
        active = motorised(chain, decay, ratio)
        angles, rates = moving(active, 12.5, -1, 0.0)
        task = ActiveTask(active, angles, rates, 12.0, 0.02, -1, fixed=True)
        found[ratio > threshold] = outcome(task())
    assert found == {False: 'is pinned', True: 'runs'}


def test_waves_in_a_uniform_ring_grow_beyond_the_limit():
    chain = Chain(60, rotor_length=0.03, periodic=True)
    limit = stability_limit(chain)
    growths = []
    for ratio in (0.97 * limit, 1.1 * limit):
        active = motorised(chain, 0.5, ratio)
        motion, rest = EquationOfMotion(active), active.uniform_state(1)
        shifts = 1e-6 * np.eye(60)
        columns = [motion.accelerations(rest + s) - motion.accelerations(rest - s) for s in shifts]
        stiffness = np.array(columns).T / 2e-6
        decay = -np.diag(motion.decay_rates)
        matrix = np.block([[np.zeros((60, 60)), np.eye(60)], [stiffness, decay]])
        growths.append(float(np.linalg.eigvals(matrix).real.max()))
    assert growths[0] < 1e-4 < 1e-2 < growths[1]


def test_the_walls_of_a_pair_are_found_with_their_charges():
    angles = with_pair(FLIPPER, 30.0, 15.5).angles
    (first, charge), (second, other) = wall_sites(FLIPPER, angles)
    assert (charge, other) == (-1, 1)
    assert first == pytest.approx(15.5, abs=0.2)
    assert second == pytest.approx(30.0, abs=0.2)
    turned = coordinates(FLIPPER, angles)[1::2] + angles[1::2]
    np.testing.assert_allclose(turned, math.pi)


def test_the_program_writes_page_table_and_data(tmp_path):
    settings = yaml.safe_load(CONFIG.read_text(encoding='utf-8'))
    settings['chains'] = {'flipper': settings['chains']['flipper'] | {'number_of_rotors': 40}}
    settings |= {'ratios': [4.0], 'diagram': {'ratios': [0.25, 4.0], 'decays': [4.0]}}
    rows = results(program.main, 'active', settings, tmp_path)
    assert {row['panel'] for row in rows} == set('abcdef')
    assert {row['series'] for row in rows if row['panel'] == 'd'} == {'runs', 'is pinned'}
