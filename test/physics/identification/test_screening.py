# SPDX-License-Identifier: Apache-2.0
"""Noise of readings while a soliton passes some rotors, and slips of encoders."""

import numpy as np
import pytest
from passages import NAMES, SPINNER, passage, read, unequal

from soliton_linkage.identification.mounting import check_mounting
from soliton_linkage.identification.readings import Readings
from soliton_linkage.identification.screening import (
    check_common_gain,
    check_jumps,
    check_slips,
    noise_of,
    without_outliers,
)
from soliton_linkage.linkage.chain import Array

TIMES = np.arange(1000)[:, None]
SPREADS = np.full((1000, 12), 2.0)


def passing() -> Array:
    """Angles of rotors that turn one after the other [rad], (T, N)."""
    return np.asarray(0.97 * np.tanh((TIMES - 80 * np.arange(12)) / 10))


def test_turning_rotors_do_not_bias_the_noise():
    noise = 0.01 * np.random.default_rng(0).standard_normal(SPREADS.shape)
    assert noise_of(passing() + noise, SPREADS) == pytest.approx(0.01 / 2, rel=0.03)


def test_the_noise_is_at_least_the_rounding_noise():
    for step in [2 * np.pi / 4096, 0.01]:
        rounded = step * np.rint(passing() / step)
        assert noise_of(rounded, SPREADS) == pytest.approx(step / np.sqrt(12) / 2, rel=1e-9)
        assert noise_of(rounded[:40, 6:], SPREADS[:40, 6:]) == 0


def test_a_step_of_the_residuals_is_a_slip_only_if_the_rotor_turns():
    random = np.random.default_rng(1)
    angles = np.concatenate([np.zeros((400, 4)), 0.1 * random.standard_normal((400, 4))])
    some = Readings(0.004 * np.arange(800), angles)
    left = np.concatenate([np.full((400, 4), 0.8), random.standard_normal((400, 4))])
    check_slips(some, left, 1.0)
    left[600:, 1] += 3.0
    with pytest.raises(ValueError, match='rotor 1'):
        check_slips(some, left, 1.0)


def deviating(values: Array, frames: list[int], rotor: int, error: float) -> Readings:
    readings = values + 0.01 * np.random.default_rng(3).standard_normal(values.shape)
    readings[frames, rotor] += error
    return Readings(0.004 * np.arange(len(values)), readings)


@pytest.mark.parametrize('error', [0.5, -1.2, np.pi, -3.1, 2 * np.pi - 0.4])
def test_wrong_readings_are_removed_and_leave_no_turn_behind(error):
    values = passing()
    for frames in ([0], [1], [500, 501], [500, 502], [450, 451, 452, 470], [998], [999]):
        used = without_outliers(deviating(values, frames, 6, error))
        wrong = np.zeros(values.shape, dtype=bool)
        wrong[frames, 6] = True
        np.testing.assert_array_equal(np.isnan(used.angles), wrong)
        assert np.abs(used.filled - values).max() < 0.15


def test_a_lasting_step_is_not_removed():
    values = passing()
    used = without_outliers(deviating(values, [*range(500, 1000)], 6, 0.3))
    assert np.isfinite(used.angles).all()


def test_a_jump_of_fifteen_deviations_is_a_slip_and_one_wrong_reading_is_not():
    for frame in (200, 480, 700):
        slipping = deviating(passing(), [*range(frame, 1000)], 6, 0.15)
        with pytest.raises(ValueError, match=r'rotor 6 slips by about 0\.1'):
            check_jumps(slipping, 0.01)
        check_jumps(deviating(passing(), [frame], 6, 0.15), 0.01)


@pytest.mark.parametrize('rotor', [0, 6, 11])
def test_a_force_is_named_as_another_cause_of_a_step_in_the_residuals_of_an_edge_rotor(rotor):
    recording = deviating(passing(), [], 6, 0.0)
    residuals = 0.01 * np.random.default_rng(4).standard_normal(recording.angles.shape)
    residuals[500:, rotor] += 0.05
    with pytest.raises(ValueError, match=f'encoder of rotor {rotor} slips') as error:
        check_slips(recording, residuals, 0.01)
    assert ('a rotor that is missing before rotor 0' in str(error.value)) == (rotor != 6)


def test_a_rotor_that_turns_during_a_gap_between_frames_does_not_slip():
    for frames in (9, 30):
        recording = deviating(passing(), [], 6, 0.0)
        first = 480 - frames // 2
        check_jumps(
            recording.select(np.delete(np.arange(1000), slice(first, first + frames))), 0.01
        )


def test_turning_rotors_have_no_outliers_and_slips_where_few_frames_were_selected():
    recording = deviating(passing(), [], 6, 0.0)
    for interval in (5, 10, 15):
        frames = np.append(np.arange(100), np.arange(100, 1000, interval))
        used = without_outliers(recording.select(frames))
        assert np.isfinite(used.angles).all()
        check_jumps(used, 0.01)


def test_a_common_wrong_gain_is_named_and_single_errors_are_not_mistaken_for_it():
    odd = np.arange(12) % 2
    readings = deviating(odd * np.pi + (1 - 2 * odd) * passing(), [], 0, 0.0).angles
    readings += 0.05 * np.random.default_rng(4).standard_normal(12)
    with pytest.raises(ValueError, match=r'^each rotor has a wrong gain, .* 9% too large'):
        check_common_gain(1.1 * readings)
    with pytest.raises(ValueError, match=r'^each rotor has a wrong gain, .* too small'):
        check_common_gain(readings / 1.1)
    for error in (0.0, 0.8, np.pi):
        wrong = readings.copy()
        wrong[:, 5] += error
        check_common_gain(wrong)
    check_common_gain(readings[:, :6] + 0.09 * (1 - 2 * odd[:6]))


def test_exchanging_joints_is_recommended_only_if_they_then_move_like_neighbours():
    readings = read(passage(unequal(SPINNER, 2)), 2)[0]
    nonlinear = readings.copy()
    nonlinear[:, 5] += 0.3 * np.sin(2 * readings[:, 5])
    check_mounting(nonlinear, NAMES)
    readings[:, [4, 5]] = readings[:, [5, 4]]
    with pytest.raises(ValueError, match='rotor_5 is before rotor_4; swap them'):
        check_mounting(readings, NAMES)
