# SPDX-License-Identifier: Apache-2.0
"""Gravity: work against a field, torques as its gradient, tilt, invalid values."""

import math

import numpy as np
import pytest
from chains import EPS
from deviating_chains import any_deviating_configuration
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.linkage.gravity import Gravity

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
    largest = field.acceleration * chain.masses @ chain.rotor_lengths
    assert field.scale(chain) == pytest.approx(largest, rel=8 * EPS)


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


def test_values_that_no_field_has_are_rejected():
    for acceleration in [-9.81, math.nan, math.inf]:
        with pytest.raises(ValueError, match=r'acceleration = .* in the range 0 to 1e\+06 m/s\^2'):
            Gravity(acceleration)
    for tilt in [math.nan, -math.inf]:
        with pytest.raises(ValueError, match=rf'Gravity\.tilt = {tilt} must be a finite number'):
            Gravity(9.81, tilt)
