# SPDX-License-Identifier: Apache-2.0
"""A profile agrees with its points, and its integrals are exact."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from soliton_linkage.actuation.profile import Profile, trapezoid

TIMES = st.floats(0, 3)
VALUES = st.floats(-5, 5)


@st.composite
def profiles(draw: st.DrawFn) -> Profile:
    times = sorted(draw(st.lists(TIMES, min_size=1, max_size=6)))
    values = [[draw(VALUES), draw(VALUES)] for _ in times]
    return Profile(np.array(times), np.array(values))


@given(profiles(), st.tuples(TIMES, TIMES, TIMES))
def test_integrals_add_up(profile, instants):
    first, middle, last = sorted(instants)
    whole = profile.integral(first, last)
    parts = profile.integral(first, middle) + profile.integral(middle, last)
    np.testing.assert_allclose(parts, whole, atol=1e-12)


@given(st.lists(st.tuples(st.floats(0.01, 1), VALUES), min_size=1, max_size=5), TIMES, TIMES)
def test_the_integral_agrees_with_the_values(points, start, length):
    times = np.cumsum([step for step, _ in points])
    profile = Profile(times, np.array([value for _, value in points]))
    expected, _ = quad(
        lambda time: float(profile.after(time)),
        start,
        start + length,
        points=times,
        epsabs=1e-10,
        limit=200,
    )
    assert float(profile.integral(start, start + length)) == pytest.approx(expected, abs=1e-8)


@given(profiles(), TIMES, st.floats(1e-6, 1.0))
def test_a_mean_times_the_time_is_the_integral(profile, start, length):
    end = start + length
    expected = profile.integral(start, end) / (end - start)
    np.testing.assert_allclose(profile.mean(start, end), expected, atol=1e-9)


@given(VALUES, TIMES, st.floats(1e-6, 1.0))
def test_the_mean_of_a_constant_is_exact(value, start, length):
    profile = Profile(np.array([-1.0]), np.array([value]))
    assert float(profile.mean(start, start + length)) == value


@given(profiles())
def test_a_profile_is_zero_before_its_points_and_holds_the_last_value(profile):
    first, last = profile.times[0], profile.times[-1]
    assert not profile.before(first).any()
    assert not profile.integral(first - 2, first).any()
    np.testing.assert_array_equal(profile.after(last), profile.values[-1])
    np.testing.assert_allclose(profile.integral(last, last + 2), 2 * profile.values[-1])


def test_two_points_at_one_instant_form_a_jump():
    profile = Profile(np.array([0.0, 1.0, 1.0, 2.0]), np.array([1.0, 2.0, -3.0, 0.0]))
    assert (float(profile.before(1.0)), float(profile.after(1.0))) == (2.0, -3.0)
    assert [float(line.last) for line in profile.segments(0.5, 1.5)] == [2.0, -1.5]


def test_the_integral_of_a_trapezoid_is_its_area():
    for duration in [0.0, 1.0]:
        for ramp_down in [0.0, 0.3]:
            for ramp_up in [0.0, 0.2]:
                profile = trapezoid(4.0, ramp_up, duration, ramp_down)
                area = 4.0 * (duration + (ramp_up + ramp_down) / 2)
                assert float(profile.integral(-1.0, 5.0)) == pytest.approx(area)
                assert profile.end == pytest.approx(ramp_up + duration + ramp_down)
                assert not profile.held


def test_an_infinite_trapezoid_holds_its_value():
    profile = trapezoid(4.0, 1.0, math.inf, 0.0)
    assert profile.held
    assert float(profile.after(0.25)) == 1.0
    assert float(profile.integral(0.0, 10.0)) == pytest.approx(4.0 * 9.5)


def test_invalid_profiles_are_rejected():
    for times, values, complaint in [
        ([], [], 'have the same number of both'),
        ([0.0], [1.0, 2.0], 'the same number of both'),
        ([0.0, math.nan], [1.0, 2.0], 'finite'),
        ([0.0, 1.0], [1.0, math.inf], 'finite'),
        ([1.0, 0.0], [1.0, 2.0], 'must not decrease'),
    ]:
        with pytest.raises(ValueError, match=complaint):
            Profile(np.array(times), np.array(values))
