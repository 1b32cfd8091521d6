# SPDX-License-Identifier: Apache-2.0
"""Configurations at rest: second derivatives, relaxed springs, balance, and chains without any."""

import dataclasses
import math
import re

import numpy as np
import pytest
from chains import EPS, EXAMPLES, FLIPPER, SPINNER, any_chain, chain_of
from deviating_chains import (
    any_deviating_configuration,
    deviating,
    reach,
    rounding,
    shortest_length,
)
from hypothesis import assume, given
from hypothesis import strategies as st

from soliton_linkage.linear.rigidity import Edge, rigidity_matrix, zero_mode
from soliton_linkage.linear.statics import (
    equilibrium,
    length_rounding,
    min_norm_change,
    rest_state,
    stiffness_matrix,
    toggled_angle,
    unstretched,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.solitons.anti_kink import continuum_anti_kink
from soliton_linkage.solitons.static_wall import static_wall

LEANS = (-1, 1)


def relaxed(chain: Chain, angles: Array) -> bool:
    return bool(np.abs(chain.spring_extensions(angles)).max() <= length_rounding(chain))


@given(any_deviating_configuration())
def test_the_stiffness_matrix_is_symmetric_and_minus_the_gradient_of_the_torques(configuration):
    chain, angles = configuration
    size = reach(chain)
    curvature = size / shortest_length(chain, angles)
    assume(curvature < 10)
    step = EPS ** (1 / 3) / curvature
    shifts = step * np.eye(chain.number_of_rotors)
    difference = chain.spring_torques(angles + shifts) - chain.spring_torques(angles - shifts)
    # Fourth derivatives of the energy k l^2 / 2, by products of up to four curvatures.
    scale = float(chain.stiffnesses.max()) * size**2
    truncation = 20 * scale * curvature**3 * step**2
    of_torques = 4 * scale * (rounding(chain) / size + 16 * EPS * curvature)
    matrix = stiffness_matrix(chain, angles).toarray()
    assert np.array_equal(matrix, matrix.T)
    assert matrix == pytest.approx(
        -difference / (2 * step), rel=0, abs=truncation + of_torques / step
    )


@given(any_deviating_configuration(), st.integers(0, 2**32))
def test_the_smallest_change_is_that_of_the_pseudo_inverse(configuration, seed):
    chain, angles = configuration
    matrix = rigidity_matrix(chain, angles).toarray()
    singular = np.linalg.svd(matrix, compute_uv=False)
    assume(singular[-1] > 1e-3 * singular[0])
    condition = singular[0] / singular[-1]
    lengthening = np.random.default_rng(seed).normal(size=chain.number_of_springs)
    change = min_norm_change(chain, angles, lengthening)
    # The matrix R R^T has the square of the condition of R.
    limit = 100 * EPS * condition**2 * float(np.linalg.norm(lengthening))
    assert matrix @ change == pytest.approx(lengthening, rel=0, abs=limit)
    assert change == pytest.approx(
        np.linalg.pinv(matrix) @ lengthening, rel=0, abs=limit / singular[-1]
    )


def test_unstretched_relaxes_every_spring_and_moves_nothing_that_is():
    for example in EXAMPLES:
        for periodic in [False, True]:
            for rotors in (2, 4, 30):
                bare = dataclasses.replace(chain_of(example, rotors), periodic=periodic)
                chain = deviating(bare, rotors, 0.01)
                near = chain.uniform_state(-1) + 0.02 * np.sin(np.arange(rotors))
                found = unstretched(chain, near)
                assert relaxed(chain, found)
                again = unstretched(chain, found)
                assert np.array_equal(again, found)
                assert again is not found


@pytest.mark.parametrize('example', EXAMPLES)
def test_unstretched_is_the_nearest_configuration_to_first_order(example):
    chain = deviating(chain_of(example, 8), 5, 0.01)
    rest = rest_state(chain, -1)
    away = np.cos(3 * np.arange(8))
    away /= np.linalg.norm(away)
    mode = zero_mode(chain, rest)
    strays = []
    for distance in (1e-3, 1e-4, 1e-5):
        found = unstretched(chain, rest + distance * away)
        strays.append(abs(mode @ (found - rest) - distance * (mode @ away)))
        normal = found - rest - mode * (mode @ (found - rest))
        assert np.linalg.norm(normal) <= 1e4 * distance**2
    # Ten times nearer, it strays a hundred times less along the zero mode.
    assert strays[1] == pytest.approx(strays[0] / 100, rel=0.2)
    assert strays[2] == pytest.approx(strays[1] / 100, rel=0.2)


@given(any_chain(), st.booleans(), st.sampled_from(LEANS))
def test_without_deviations_the_rest_state_is_the_uniform_state(chain, periodic, lean):
    rotors = chain.number_of_rotors + chain.number_of_rotors % 2
    chain = dataclasses.replace(chain, number_of_rotors=rotors, periodic=periodic)
    assert np.array_equal(rest_state(chain, lean), chain.uniform_state(lean))


def test_rest_states_move_in_proportion_to_small_deviations():
    for example in EXAMPLES:
        for lean in LEANS:
            chain = chain_of(example, 20)
            moves = []
            for largest in (1e-4, 1e-5):
                drawn = deviating(chain, 9, largest)
                rest = rest_state(drawn, lean)
                assert relaxed(drawn, rest)
                moves.append((rest - chain.uniform_state(lean)) / largest)
            size = float(np.abs(moves[1]).max())
            # The second order: (1 + size)^2 times the fraction, and curvatures of the smaller
            # gaps.
            assert moves[0] == pytest.approx(moves[1], rel=0, abs=100 * 1e-4 * (1 + size) ** 2)
            assert size > 0.1


def test_a_free_chain_near_rest_is_balanced_with_every_spring_relaxed():
    for example in EXAMPLES:
        for lean in LEANS:
            chain = deviating(chain_of(example, 8), 2, 0.01)
            start = rest_state(chain, lean) + 0.01 * np.sin(5 * np.arange(8))
            found = equilibrium(chain, start)
            # Torques below 1e-12 leave extensions of that over the levers, none under a tenth of r
            # here.
            scale = (
                1e-12
                * chain.rest_lengths.max()
                / chain.stiffnesses.min()
                * chain.stiffnesses.max()
            )
            assert np.abs(chain.spring_extensions(found)).max() <= 100 * scale
            assert np.abs(found - start).max() <= 0.1


def test_balance_is_found_at_second_order():
    for example in [FLIPPER, SPINNER]:
        chain = dataclasses.replace(chain_of(example, 6), periodic=True)
        chain = deviating(chain, 3, 0.02)
        rest = rest_state(chain, 1)
        for distance in (1e-2, 1e-3):
            found = equilibrium(chain, rest + distance * np.sin(np.arange(6)))
            assert found == pytest.approx(rest, rel=0, abs=1e-9)


def test_a_spring_that_cannot_be_relaxed_is_named():
    for rotors in [2, 5]:
        for fraction in [-0.6, 1.0]:
            spring = rotors - 2
            fractions = (0.0,) * spring + (fraction,)
            chain = Chain(rotors, rotor_length=0.01, deviations=Deviations(rest_length=fractions))
            longest = chain.spacing + 2 * chain.rotor_length
            assert not longest - 4 * chain.rotor_length < chain.rest_lengths[spring] < longest
            complaint = (
                rf'spring {spring} between rotors {spring} and {spring + 1} .*: no configuration'
            )
            with pytest.raises(ValueError, match=complaint):
                rest_state(chain, 1)


def test_a_ring_with_a_state_of_self_stress_is_not_relaxed():
    for angle in [0.0, np.pi / 2]:
        # Whether a singular matrix is found to be one is up to rounding.
        complaint = r'self-stress at \[.*\] rad|spring \d .* stays .*: no configuration'
        with pytest.raises(ValueError, match=complaint):
            unstretched(Chain(4, periodic=True), np.full(4, angle))


def test_a_chain_with_a_motion_that_nothing_resists_has_no_balance():
    # Parallel rotors turn together to first order, and neither springs nor their tension mind.
    with pytest.raises(ValueError, match=r'stiffness matrix is singular at \[0\. .*\] rad'):
        equilibrium(Chain(4), np.zeros(4))


def test_torques_are_in_balance_or_rejected_by_rotor():
    # Next to the one balance of an anti-kink Newton's method finds it or does not, by rounding.
    chain = chain_of(FLIPPER, 20)
    start = continuum_anti_kink(dataclasses.replace(chain, number_of_rotors=40), 9.5)[:20]
    refusals = []
    for seed in range(20):
        noise = 1e-9 * np.random.default_rng(seed).standard_normal(20)
        try:
            found = equilibrium(chain, start + noise)
        except ValueError as refusal:
            refusals.append(str(refusal))
        else:
            scale = chain.stiffness * chain.rest_length * chain.rotor_length
            assert np.abs(chain.spring_torques(found)).max() <= 1e-12 * scale
    assert refusals
    for refusal in refusals:
        assert re.match(r'the torque on rotor \d+ stays .* N m: there is no equilibrium', refusal)


def test_angles_that_do_not_fit_are_rejected():
    for law in [unstretched, equilibrium]:
        with pytest.raises(
            ValueError, match=r'angles of shape \(3,\) do not fit a chain of 4 rotors'
        ):
            law(Chain(4), np.zeros(3))
        with pytest.raises(ValueError, match='angle of rotor 1 = nan must be a finite number'):
            law(Chain(4), np.array([0, math.nan, 0, 0]))


def test_a_toggled_edge_rotor_keeps_its_bar_and_toggles_back():
    for example in EXAMPLES:
        for edge in [Edge.FIRST, Edge.LAST]:
            lengths = Deviations(rest_length=(0.02, -0.01, 0.01, 0.0, 0.02, -0.02, 0.01))
            for chain in (
                chain_of(example, 8),
                dataclasses.replace(chain_of(example, 8), deviations=lengths),
            ):
                angles = rest_state(chain, 1)
                toggled, rotor = angles.copy(), 0 if edge is Edge.FIRST else -1
                toggled[rotor] = toggled_angle(chain, angles, edge)
                assert np.abs(chain.spring_extensions(toggled)).max() <= 4 * length_rounding(chain)
                again = math.remainder(
                    toggled_angle(chain, toggled, edge) - angles[rotor], math.tau
                )
                assert abs(again) < 1e-11


def test_toggling_an_edge_rotor_leads_to_the_leg_beyond_its_reflection():
    for rotors in [20, 21]:
        for turned in [False, True]:
            chain = chain_of(FLIPPER, rotors)
            # Leg 0 ends at the last rotor, 1 at the first, 2 at the last and 3 at the first.
            for leg, edge in enumerate([Edge.LAST, Edge.FIRST, Edge.LAST, Edge.FIRST]):
                angles = static_wall(chain, 9.3, leg, turned)
                angles[0 if edge is Edge.FIRST else -1] = toggled_angle(chain, angles, edge)
                following = static_wall(chain, 9.3, (leg + 1) % 4, turned)
                assert np.cos(angles - following) == pytest.approx(1.0, abs=1e-15)
