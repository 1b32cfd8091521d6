# SPDX-License-Identifier: Apache-2.0
"""Gravity: work against a field, torques as its gradient, tilt, invalid values."""

import dataclasses
import math

import numpy as np
import pytest
from chains import EPS, FLIPPER, chain_of
from deviating_chains import any_deviating_chain, any_deviating_configuration
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

FIELDS = st.builds(Gravity, st.just(0.0) | st.floats(1e-3, 1e3), st.floats(-7, 7))
# An angle of up to 16 rad is rounded to EPS of it, and its sine as much.
ROUNDING = 40 * EPS


@given(any_deviating_configuration(), FIELDS)
def test_energy_is_the_work_of_lifting_each_mass_against_the_field(configuration, field):
    chain, angles = configuration
    pull = field.acceleration * np.array([math.sin(field.tilt), -math.cos(field.tilt)])
    places = np.stack(chain.positions(angles))
    work = -math.fsum(chain.masses * (pull @ places))
    limit = ROUNDING * field.scale(chain)
    assert field.energy(chain, angles) == pytest.approx(work, rel=0, abs=limit)


@given(any_deviating_configuration(), FIELDS)
def test_torques_are_levers_crossed_with_weights(configuration, field):
    chain, angles = configuration
    horizontal, vertical = chain.positions(angles)
    across = field.acceleration * math.sin(field.tilt) * chain.masses
    up = -field.acceleration * math.cos(field.tilt) * chain.masses
    limit = ROUNDING * field.scale(chain)
    assert field.torques(chain, angles) == pytest.approx(
        vertical * across - horizontal * up, rel=0, abs=limit
    )


@given(any_deviating_chain(), st.floats(1e-3, 1e3))
def test_level_gravity_pulls_down_and_a_quarter_turn_pulls_to_the_last_rotor(chain, acceleration):
    down, across = Gravity(acceleration), Gravity(acceleration, math.pi / 2)
    rotors = chain.number_of_rotors
    scale = down.scale(chain)
    limit = ROUNDING * scale
    assert scale == pytest.approx(acceleration * chain.masses @ chain.rotor_lengths, rel=8 * EPS)
    for field, lowest in ((down, np.pi), (across, np.pi / 2)):
        hanging = np.full(rotors, lowest)
        assert field.energy(chain, hanging) == pytest.approx(-scale, rel=0, abs=limit)
        assert np.abs(field.torques(chain, hanging)).max() <= limit
        assert field.energy(chain, hanging + np.pi) == pytest.approx(scale, rel=0, abs=limit)


@given(any_deviating_configuration(), FIELDS, st.floats(-3, 3))
def test_turning_the_field_is_turning_all_rotors(configuration, field, turn):
    chain, angles = configuration
    turned = dataclasses.replace(field, tilt=field.tilt + turn)
    limit = 2 * ROUNDING * field.scale(chain)
    assert turned.energy(chain, angles) == pytest.approx(
        float(field.energy(chain, angles + turn)), rel=0, abs=limit
    )


@given(any_deviating_configuration(), FIELDS)
def test_the_mirrored_chain_in_the_mirrored_field_has_the_same_energy(configuration, field):
    chain, angles = configuration
    mirrored = dataclasses.replace(field, tilt=-field.tilt)
    assert mirrored.energy(chain, -angles) == field.energy(chain, angles)
    assert np.array_equal(mirrored.torques(chain, -angles), -field.torques(chain, angles))


def test_many_frames_at_once_give_the_results_of_single_frames():
    chain, field = chain_of(FLIPPER, 7), Gravity(9.81, 0.4)
    frames = np.random.default_rng(1).normal(size=(2, 3, 7))
    for law in (field.energy, field.torques):
        alone = [[law(chain, frame) for frame in row] for row in frames]
        assert np.array_equal(law(chain, frames), np.array(alone))


def test_no_gravity_does_nothing():
    chain = chain_of(FLIPPER, 4)
    angles = np.array([1.0, -2.0, 3.0, 0.5])
    assert NO_GRAVITY.scale(chain) == NO_GRAVITY.energy(chain, angles) == 0
    assert not NO_GRAVITY.torques(chain, angles).any()


def test_values_that_no_field_has_are_rejected():
    for acceleration in [-9.81, math.nan, math.inf]:
        with pytest.raises(ValueError, match=r'acceleration = .* in the range 0 to 1e\+06 m/s\^2'):
            Gravity(acceleration)
    for tilt in [math.nan, -math.inf]:
        with pytest.raises(ValueError, match=rf'Gravity\.tilt = {tilt} must be a finite number'):
            Gravity(9.81, tilt)
