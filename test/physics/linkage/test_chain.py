# SPDX-License-Identifier: Apache-2.0
"""Laws of the chain: geometry, symmetries, bad input.

Here all rotors and springs are alike; those that differ have laws of their own.
"""

import dataclasses
import math
import re
from functools import partial

import numpy as np
import pytest
from chains import EPS, EXAMPLES, FLIPPER, any_chain, any_configuration, chain_of
from hypothesis import assume, given
from hypothesis import strategies as st

from soliton_linkage.linkage.chain import Chain, Motion, displacement, staggered, wrapped
from soliton_linkage.linkage.gravity import Gravity

LEANS = (-1, 1)


def rounding_of_extensions(chain: Chain) -> float:
    """Rounding error of an extension [m], e_n / (l_n + lbar) with l_n + lbar >= lbar.

    The terms of e_n, of the sizes 2 r^2, 4 a r and 2 r^2, are each rounded up to four times, by
    EPS / 2 of their size.
    """
    a, r = chain.spacing, chain.rotor_length
    return 2 * EPS * (4 * r**2 + 4 * a * r) / chain.rest_length


def test_a_rotor_at_0_points_up_and_at_a_quarter_turn_to_the_last_rotor():
    chain = chain_of(FLIPPER, 2)
    horizontal, vertical = chain.positions(np.array([0, np.pi / 2]))
    assert horizontal == pytest.approx([0, chain.rotor_length], abs=EPS)
    assert vertical == pytest.approx([chain.rotor_length, 0], abs=EPS)


@given(any_chain(), st.sampled_from(LEANS))
def test_every_rotor_of_a_uniform_state_leans_by_the_rest_angle(chain, lean):
    angles = chain.uniform_state(lean)
    horizontal, vertical = chain.positions(angles)
    assert angles[0] == lean * chain.rest_angle
    lean_of_rotors = lean * chain.rotor_length * math.sin(chain.rest_angle)
    rounding = 4 * EPS * chain.rotor_length
    assert horizontal == pytest.approx(lean_of_rotors, abs=rounding, rel=0)
    upright = chain.rotor_length * math.cos(chain.rest_angle)
    signs = (-1.0) ** np.arange(chain.number_of_rotors)
    assert vertical == pytest.approx(upright * signs, abs=rounding, rel=0)


@given(any_chain(), st.sampled_from(LEANS))
def test_uniform_states_are_relaxed(chain, lean):
    angles = chain.uniform_state(lean)
    extensions = chain.spring_extensions(angles)
    # Angles pi - phi are rounded to EPS * pi / 2, and turn masses by as much.
    limit = rounding_of_extensions(chain) + 4 * EPS * chain.rotor_length
    assert np.abs(extensions).max() <= limit
    bonds = chain.number_of_rotors - 1
    assert chain.elastic_energy(angles) <= bonds * chain.stiffness / 2 * limit**2
    assert np.abs(chain.spring_torques(angles)).max() <= (
        2 * chain.stiffness * limit * chain.rotor_length * (1 + 4 * EPS)
    )


def test_many_frames_at_once_give_the_results_of_single_frames():
    for example in EXAMPLES:
        chain, field = chain_of(example, 7), Gravity(9.81, 0.4)
        frames = np.random.default_rng(1).normal(size=(2, 3, 7))
        for law in (
            chain.spring_extensions,
            chain.elastic_energy,
            chain.kinetic_energy,
            chain.spring_torques,
            staggered,
            partial(field.energy, chain),
            partial(field.torques, chain),
        ):
            alone = [[law(frame) for frame in row] for row in frames]
            assert np.array_equal(law(frames), np.array(alone))


def test_masses_that_meet_have_a_spring_of_no_length_and_no_direction():
    chain = dataclasses.replace(chain_of(FLIPPER, 3), rotor_length=0.05, spacing=0.1)
    angles = np.array([np.pi / 2, -np.pi / 2, -np.pi / 2])
    extensions, first, second = chain.springs(angles)
    assert extensions[0] == pytest.approx(-chain.rest_length, rel=4 * EPS)
    assert abs(first[0]) <= chain.rotor_length
    assert abs(second[0]) <= chain.rotor_length
    assert np.isfinite(chain.spring_torques(angles)).all()


@given(any_chain())
def test_rotors_spin_exactly_where_the_springs_are_shorter_than_2r_less_a(chain):
    margin = 2 * chain.rotor_length - chain.spacing - chain.rest_length
    assume(abs(margin) > 1e-12 * chain.rotor_length)
    assert (chain.motion is Motion.SPINNER) == (margin > 0)


@given(any_chain())
def test_rotors_wobble_where_they_reach_beyond_half_the_spacing(chain):
    assume(chain.motion is not Motion.SPINNER)
    reach = chain.rotor_length * math.sin(chain.rest_angle)
    assert (chain.motion is Motion.WOBBLING_FLIPPER) == (2 * reach / chain.spacing > 1)


@given(any_configuration())
def test_staggering_twice_gives_the_angles_back(configuration):
    _, angles = configuration
    once = staggered(angles)
    assert np.array_equal(once[::2], angles[::2])
    assert np.array_equal(once[1::2], np.pi - angles[1::2])
    assert staggered(once) == pytest.approx(angles, rel=0, abs=4 * EPS * 9)


def test_a_chain_rejects_a_parameter_by_name_value_and_limit():
    for name, value, limit in [
        ('number_of_rotors', 1, '2 to 100000'),
        ('number_of_rotors', 2.5, 'whole number'),
        ('spacing', 0.0, '1e-06 to 1000 m'),
        ('rotor_length', -0.05, '1e-06 to 1000 m'),
        ('rest_angle', math.pi / 2, '0.001 to 1.57 rad'),
        ('rest_angle', math.nan, 'finite'),
        ('mass', math.inf, 'finite'),
        ('stiffness', '50', 'number'),
    ]:
        with pytest.raises(ValueError, match=rf'Chain\.{name} = .*{limit}') as refusal:
            Chain(**{name: value})
        assert repr(value) in str(refusal.value)


def test_a_lean_that_is_neither_right_nor_left_is_rejected():
    for lean in [0, 2, -3]:
        with pytest.raises(ValueError, match=f'lean = {lean} must be'):
            chain_of(FLIPPER, 2).uniform_state(lean)


def test_angles_that_do_not_fit_are_rejected_with_their_shape():
    for shape in [(), (3,), (5,), (1, 4), (4, 1)]:
        complaint = re.escape(f'angles of shape {shape} do not fit a chain of 4 rotors')
        with pytest.raises(ValueError, match=complaint):
            chain_of(FLIPPER, 4).check_angles(np.zeros(shape))


def test_a_value_that_is_not_finite_is_rejected_by_rotor_and_name():
    for value in [math.nan, math.inf, -math.inf]:
        with pytest.raises(
            ValueError, match=f'torque of rotor 2 = {value} must be a finite number'
        ):
            chain_of(FLIPPER, 4).check_angles([0, 1, value, math.nan], 'torque')


@given(st.floats(-3.1, 3.1), st.integers(-5, 5))
def test_wrapped_differences_lose_whole_turns_and_nothing_else(angle, turns):
    found = wrapped([angle + 2 * math.pi * turns, math.nan])
    assert found[0] == pytest.approx(angle, abs=1e-13)
    assert math.isnan(found[1])


@given(any_configuration())
def test_the_displacement_is_how_far_a_rotor_leans(configuration):
    chain, angles = configuration
    leaning = chain.rotor_lengths * np.sin(staggered(angles))
    limit = 64 * EPS * float(chain.rotor_lengths.max())
    assert displacement(chain, angles) == pytest.approx(leaning, rel=0, abs=limit)
    assert displacement(chain, np.stack([angles, angles])).shape == (2, chain.number_of_rotors)
