# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from chains import EPS
from deviating_chains import any_deviating_configuration
from hypothesis import given

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.gravity import Gravity


@given(any_deviating_configuration())
def test_the_compiled_loop_sums_the_torques_of_each_rotor(given_chain):
    chain, angles = given_chain
    rotors, gravity = np.arange(chain.number_of_rotors), Gravity(3.0, 0.2)
    torques = (rotors - 1.0) * gravity.scale(chain)
    motion = EquationOfMotion(chain, torques, gravity)
    rates = (2.0 - rotors) / chain.time_unit
    friction = chain.dampings * rates
    parts = chain.spring_torques(angles), gravity.torques(chain, angles), torques, -friction
    slope = motion(0.0, motion.state(angles, rates))
    # The rounding error of l^2 changes k_e (1 - lbar / l) l by a multiple (lbar / l)^2 of it.
    shortest = (chain.spring_extensions(angles) + chain.rest_lengths).min(initial=np.inf)
    amplified = max(1.0, float(chain.rest_lengths.max() / shortest)) ** 2
    bent = chain.stiffness * (chain.spacing + chain.rotor_length) * chain.rotor_length * amplified
    rounding = 16 * EPS * (bent + max(np.abs(part).max() for part in parts[1:]))
    turning = chain.moments_of_inertia * slope[rotors + len(rotors)]
    np.testing.assert_allclose(turning, sum(parts), rtol=0, atol=rounding)
    np.testing.assert_array_equal(slope[rotors], rates)
    if motion.damped:
        assert slope[-1] == pytest.approx(friction @ rates, rel=1e-13)


def test_torques_and_fixed_rotors_act_on_their_own_rotor_alone():
    chain = Chain(6)
    angles, rates = chain.uniform_state(1), np.zeros(6)
    torques = np.array([0, 0, 1.0, 0, 2.0, 0])
    motion = EquationOfMotion(chain, torques, fixed=(4,))
    slope = motion(0.0, motion.state(angles, rates))
    expected = torques / chain.moment_of_inertia
    expected[4] = 0
    np.testing.assert_allclose(slope[6:], expected, rtol=0, atol=1e-9 * expected.max())


def test_arrays_of_another_shape_are_rejected():
    with pytest.raises(ValueError, match='give one per rotor'):
        EquationOfMotion(Chain(6), np.zeros(5))
    for rotor in (-1, 6, 2.5):
        with pytest.raises(ValueError, match=f'fixed rotor {rotor} must be one of 0 to 5'):
            EquationOfMotion(Chain(6), fixed=(rotor,))
    with pytest.raises(ValueError, match='rate of rotor 1'):
        EquationOfMotion(Chain(3)).state(np.zeros(3), np.array([0, np.nan, 0]))
