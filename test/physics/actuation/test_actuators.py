# SPDX-License-Identifier: Apache-2.0
"""The pneumatic actuator follows its commands; `examples/own_actuator.py` is a custom one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from soliton_linkage.actuation.actuators import PneumaticActuator, actuator_type
from soliton_linkage.actuation.profile import Profile, trapezoid
from soliton_linkage.linkage.chain import Array


def test_the_actuator_model_is_selected_by_name():
    assert actuator_type('pneumatic') is PneumaticActuator
    with pytest.raises(ValueError, match="actuator = 'steam' must be one of 'pneumatic'"):
        actuator_type('steam')


ACTUATOR = PneumaticActuator(filling_time=0.03, venting_time=0.07)
PRESSURES = st.floats(-8e4, 2e5)
SLOPES = st.floats(-3e6, 3e6)
TIMES = st.floats(0, 1)


def integrated(pressure: float, command: Profile, start: float, end: float) -> Array:
    """Integrate the pressure equation in steps; return the final pressure and its integral."""

    def derivative(time: float, state: Array) -> Array:
        lag = float(command.after(time)) - state[0]
        constant = ACTUATOR.filling_time if lag > 0 else ACTUATOR.venting_time
        return np.array([lag / constant, state[0]])

    state = np.array([pressure, 0.0])
    for line in command.segments(start, end):
        solution = solve_ivp(
            derivative, (line.start, line.end), state, rtol=1e-9, atol=1e-6, max_step=0.01
        )
        state = solution.y[:, -1]
    return state


def test_the_exact_response_agrees_with_small_integration_steps():
    for pressure in [0.0, 1.5e5, -5e4]:
        for ramps in [(0.0, 0.0), (0.05, 0.0), (0.02, 0.1)]:
            for value in [2e5, -8e4]:
                command = trapezoid(value, ramps[0], 0.1, ramps[1])
                for end in (0.04, 0.15, 0.4):
                    closed = ACTUATOR.response(pressure, command, 0.0, end)
                    expected = integrated(pressure, command, 0.0, end)
                    np.testing.assert_allclose(closed, expected, rtol=1e-6, atol=1.0)


@given(PRESSURES, PRESSURES, SLOPES, TIMES, TIMES)
def test_two_consecutive_responses_equal_one(pressure, target, slope, first, second):
    whole, area = ACTUATOR.follow(pressure, target, slope, first + second)
    middle, before = ACTUATOR.follow(pressure, target, slope, first)
    end, after = ACTUATOR.follow(middle, target + slope * first, slope, second)
    scale = abs(pressure) + abs(target) + abs(slope) * (first + second) + 1
    assert end == pytest.approx(whole, abs=1e-9 * scale)
    assert before + after == pytest.approx(area, abs=1e-9 * scale)


@pytest.mark.parametrize('slope', [-5e-324, 5e-324])
def test_the_smallest_slope_of_a_command_acts_like_a_constant_command(slope):
    for pressure, target in [(0.0, 1e5), (1e5, 0.0)]:
        constant = ACTUATOR.follow(pressure, target, 0.0, 0.1)
        assert ACTUATOR.follow(pressure, target, slope, 0.1) == pytest.approx(constant, rel=1e-12)


@given(PRESSURES, PRESSURES, TIMES)
def test_the_pressure_never_overshoots_a_constant_command(pressure, target, time):
    reached, area = ACTUATOR.follow(pressure, target, 0.0, time)
    low, high = sorted((pressure, target))
    rounding = 1e-9 * (high - low) + 1e-9
    assert low - rounding <= reached <= high + rounding
    assert low * time - rounding <= area <= high * time + rounding


@given(st.floats(1e-6, 1e-3), st.sampled_from([-1.0, 1.0]), st.floats(0.01, 1.0))
def test_the_pressure_of_a_pulse_gives_its_impulse(size, sign, duration):
    impulse = sign * size
    pressure = ACTUATOR.pulse_command(impulse, duration)
    command = trapezoid(pressure, 0.0, duration, 0.0)
    left, area = ACTUATOR.response(0.0, command, 0.0, duration + 5.0)
    assert ACTUATOR.torque_per_pressure * area == pytest.approx(impulse, rel=1e-9)
    assert abs(left) < 1e-9 * abs(pressure)


def test_the_torque_is_proportional_up_to_saturation():
    actuator = PneumaticActuator(torque_per_pressure=1e-7, saturation_torque=0.01)
    torques = actuator.torque(np.array([0.0, 5e4, -5e4, 1e5, 2e5, -2e5]))
    np.testing.assert_allclose(torques, [0.0, 0.005, -0.005, 0.01, 0.01, -0.01])


def test_pressures_out_of_range_are_rejected():
    for pressure in [2.1e5, -9e4, math.nan, math.inf]:
        with pytest.raises(ValueError, match=r'^pressure = .* Pa must'):
            ACTUATOR.check_command(pressure)


def test_parameters_out_of_range_are_rejected():
    for wrong in [{'filling_time': 0.0}, {'venting_time': -1.0}, {'lowest_pressure': 1.0}]:
        with pytest.raises(ValueError, match='must lie in the range'):
            PneumaticActuator(**wrong)
