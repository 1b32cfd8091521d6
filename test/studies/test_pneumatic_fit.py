# SPDX-License-Identifier: Apache-2.0
"""The fit recovers the parameters of an actuator from simulated records."""

import numpy as np
import pytest

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage_studies.pneumatic_fit import StepResponse, fit_step_response, fit_torque


def steps(
    actuator: PneumaticActuator, noise: float, generator: np.random.Generator, rate: float = 200.0
) -> StepResponse:
    """Simulate a step to 1e5 Pa and back to 0, sampled at a rate [Hz] with noise [Pa]."""
    times = np.arange(0.0, 1.5, 1 / rate)
    commands = np.where((times >= 0.1) & (times < 0.8), 1e5, 0.0)
    pressures = actuator.responses(0.0, times, commands)
    return StepResponse(times, commands, pressures + noise * generator.normal(size=len(times)))


def test_the_time_constants_of_an_exact_record_are_recovered():
    for times in [(0.03, 0.05), (0.2, 0.05), (0.01, 0.15)]:
        actuator = PneumaticActuator(filling_time=times[0], venting_time=times[1])
        fit = fit_step_response(steps(actuator, 0.0, np.random.default_rng(1)))
        assert (fit.filling_time, fit.venting_time) == pytest.approx(times, rel=1e-6)
        assert fit.residual < 1e-2


def test_errors_with_noise_agree_with_the_stated_deviations():
    actuator = PneumaticActuator(filling_time=0.03, venting_time=0.08)
    generator = np.random.default_rng(2)
    errors = []
    for _ in range(60):
        fit = fit_step_response(steps(actuator, 2e3, generator, rate=100.0))
        assert fit.residual == pytest.approx(2e3, rel=0.3)
        errors.append((fit.filling_time - 0.03) / fit.filling_deviation)
        errors.append((fit.venting_time - 0.08) / fit.venting_deviation)
    assert np.mean(errors) == pytest.approx(0.0, abs=4 / np.sqrt(len(errors)))
    assert np.std(errors) == pytest.approx(1.0, abs=4 / np.sqrt(2 * len(errors)))


def test_without_falling_pressure_the_venting_time_is_rejected():
    record = steps(PneumaticActuator(), 0.0, np.random.default_rng(3))
    rising = record.times < 0.7
    columns = (record.times[rising], record.commands[rising], record.pressures[rising])
    with pytest.raises(ValueError, match='the venting time cannot be estimated'):
        fit_step_response(StepResponse(*columns))


def test_torques_give_their_slope_and_saturation():
    actuator = PneumaticActuator(torque_per_pressure=1e-7, saturation_torque=0.012)
    pressures = np.linspace(-1.8e5, 2e5, 39)
    slope, limit = fit_torque(pressures, actuator.torque(pressures))
    assert (slope, limit) == pytest.approx((1e-7, 0.012), rel=1e-9)
    generator = np.random.default_rng(4)
    noisy = actuator.torque(pressures) + 1e-4 * generator.normal(size=len(pressures))
    slope, limit = fit_torque(pressures, noisy)
    assert (slope, limit) == pytest.approx((1e-7, 0.012), rel=0.02)


def test_torques_that_do_not_saturate_have_no_limit():
    pressures = np.linspace(0.0, 1e5, 11)
    noise = 1e-5 * np.random.default_rng(6).normal(size=11)
    for torques, tolerance in ((3e-8 * pressures, 1e-12), (3e-8 * pressures + noise, 0.01)):
        assert fit_torque(pressures, torques) == pytest.approx((3e-8, np.inf), rel=tolerance)
    with pytest.raises(ValueError, match='at two pressures or more'):
        fit_torque(np.zeros(3), np.zeros(3))


def test_invalid_records_are_rejected():
    for times, complaint in [
        ([0.0, 1.0, 2.0], 'must have at least 4'),
        ([0.0, 1.0, 1.0, 2.0], 'must increase'),
    ]:
        column = np.zeros(len(times))
        with pytest.raises(ValueError, match=complaint):
            StepResponse(np.array(times), column, column)
