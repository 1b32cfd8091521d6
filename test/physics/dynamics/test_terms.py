# SPDX-License-Identifier: Apache-2.0
import dataclasses
import math

import numpy as np
import pytest
from chain_motions import MOTIONS, coordinates, lively_state, motor_torques
from chains import EPS, FLIPPER, chain_of
from deviating_chains import any_deviating_configuration, shortest_length
from hypothesis import given

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.terms import (
    DryFriction,
    HeldTorques,
    LinearDamping,
    NonReciprocal,
    QuadraticDamping,
    SpringTorques,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations

DRAG = 2e-6


def drag(_time: float, _angles: Array, rates: Array) -> Array:
    return -DRAG * rates


def by(
    chain: Chain, *forces: object, integrator: str = 'DOP853', tolerance: float = 1e-11
) -> ElasticSimulation:
    simulation = ElasticSimulation(
        chain, chain.uniform_state(-1), tolerance=tolerance, forces=forces, integrator=integrator
    )
    simulation.kick(2e-4 * np.eye(chain.number_of_rotors)[0])
    simulation.record(0.5)
    return simulation


def site_torques(chain: Chain, angles: Array) -> Array:
    order, q = chain.on_site_order, coordinates(chain, angles)
    return -chain.signs * chain.on_site_torques * np.sin(order * (q - chain.on_site_phase))


@pytest.mark.parametrize('name', MOTIONS)
def test_the_derivative_is_the_sum_of_the_terms(name):
    motion = MOTIONS[name]
    state, number, chain = lively_state(motion), motion.rotors, motion.chain
    angles, rates = state[:number], state[number : 2 * number]
    active = motor_torques(chain, angles)
    torques = chain.spring_torques(angles) + motion.gravity.torques(chain, angles) + active
    torques += (0 if motion.torques is None else motion.torques) - chain.dampings * rates
    torques += site_torques(chain, angles)
    expected = [rates, torques / motion.inertias]
    if motion.damped:
        expected.append([float(chain.dampings @ rates**2 - active @ rates)])
    np.testing.assert_allclose(motion(0.0, state), np.concatenate(expected), rtol=0, atol=1e-12)


@given(any_deviating_configuration())
def test_compiled_springs_have_the_torques_of_any_chain(configuration):
    chain, angles = configuration
    torques = np.zeros(chain.number_of_rotors)
    SpringTorques(chain).add(torques, 0.0, angles, 0 * angles)
    # The rounding error of l^2 changes k_e (1 - lbar / l) l by a multiple (lbar / l)^2 of it.
    amplified = max(1.0, float(chain.rest_lengths.max()) / shortest_length(chain, angles)) ** 2
    bent = chain.stiffness * (chain.spacing + chain.rotor_length) * chain.rotor_length * amplified
    expected = chain.spring_torques(angles)
    np.testing.assert_allclose(torques, expected, rtol=0, atol=16 * EPS * bent)


def test_torques_of_terms_with_an_energy_are_its_gradient():
    for name in MOTIONS:
        motion = MOTIONS[name]
        state, number, width = lively_state(motion), motion.rotors, 1e-6
        angles, rates = state[:number], state[number : 2 * number]
        for term in motion.terms:
            if isinstance(term, HeldTorques) or term.dissipative or term.active:
                continue
            torques = np.zeros(number)
            assert term.add(torques, 0.0, angles, rates) == 0
            steps = width * np.eye(number)
            slopes = [term.energy(angles + step) - term.energy(angles - step) for step in steps]
            np.testing.assert_allclose(torques, -np.array(slopes) / (2 * width), rtol=0, atol=1e-8)


def test_a_plain_function_moves_a_chain_as_the_same_law_inside_does():
    chain = chain_of(FLIPPER, 8)
    damped = Chain(8, chain.spacing, chain.rotor_length, chain.rest_angle, damping=DRAG)
    inside, term = by(damped), by(chain, LinearDamping(np.full(8, DRAG)))
    outside = by(chain, drag)
    for other in (term, outside):
        np.testing.assert_allclose(other.angles, inside.angles, rtol=0, atol=1e-9)
        assert other.dissipated == pytest.approx(inside.dissipated, rel=1e-8)
    assert inside.dissipated > 1e-3 * inside.energy
    assert abs(outside.energy_drift) < 1e-8


def test_all_integrators_agree_on_a_compiled_damping_law():
    for law in [
        LinearDamping(np.full(8, DRAG)),
        DryFriction(2e-6, 0.5),
        QuadraticDamping(np.full(8, 1e-7)),
    ]:
        for integrator in ['symplectic', 'DOP853']:
            chain = chain_of(FLIPPER, 8)
            exact, found = by(chain, law, tolerance=1e-13), by(chain, law, integrator=integrator)
            np.testing.assert_allclose(found.angles, exact.angles, rtol=0, atol=2e-9)
            np.testing.assert_allclose(found.rates, exact.rates, rtol=0, atol=2e-7)
            assert found.dissipated == pytest.approx(exact.dissipated, rel=1e-8)
            assert found.dissipated > 1e-3 * found.energy
            assert abs(found.energy_drift) < 1e-8


def test_work_of_motors_between_frames_of_a_long_step():
    chain = dataclasses.replace(chain_of(FLIPPER, 8), non_reciprocity=1e-5)
    start = with_soliton(chain, 3.0, 0.1)
    many = ElasticSimulation(chain, start.angles, start.rates, period=1e-4)
    few = ElasticSimulation(chain, start.angles, start.rates, period=0.1)
    for _ in range(1000):
        many.advance()
        assert abs(many.energy_drift) < 1e-10
    few.advance()
    assert few.dissipated == pytest.approx(many.dissipated, rel=1e-8)


def test_two_active_terms_move_a_chain_as_their_sum_does():
    whole = dataclasses.replace(chain_of(FLIPPER, 8), non_reciprocity=2e-5)
    half = dataclasses.replace(whole, non_reciprocity=1e-5)
    start = with_soliton(whole, 3.0, 0.1)
    ends = []
    for chain, forces in ((whole, ()), (half, (NonReciprocal(half),))):
        simulation = ElasticSimulation(chain, start.angles, start.rates, forces=forces)
        simulation.record(0.5)
        ends.append((*simulation.angles, simulation.dissipated))
        assert abs(simulation.energy_drift) < 1e-8
    assert ends[1] == pytest.approx(ends[0], rel=1e-6)


def test_a_change_of_non_reciprocity_acts_at_the_current_frame():
    chain = chain_of(FLIPPER, 8)
    start = with_soliton(chain, 3.0, 0.1)
    changed = ElasticSimulation(chain, start.angles, start.rates)
    changed.record(0.1)
    changed.set_non_reciprocity(1e-5)
    active = dataclasses.replace(chain, non_reciprocity=1e-5)
    anew = ElasticSimulation(active, changed.angles, changed.rates)
    changed.record(0.2)
    anew.record(0.2)
    np.testing.assert_allclose(changed.angles, anew.angles, rtol=0, atol=1e-12)
    assert abs(changed.energy_drift) < 1e-10
    with pytest.raises(ValueError, match='non_reciprocity = inf must be a finite number'):
        changed.set_non_reciprocity(math.inf)


def test_frictions_of_single_rotors_and_signs_of_single_bonds():
    none_but_first, reversed_bond = (0.0, *[-1.0] * 7), (0.0,) * 3 + (-2.0,) + (0.0,) * 3
    deviations = Deviations(quadratic_damping=none_but_first, non_reciprocity=reversed_bond)
    chain = dataclasses.replace(
        chain_of(FLIPPER, 8), quadratic_damping=1e-7, non_reciprocity=1e-5, deviations=deviations
    )
    assert chain.quadratic_dampings.tolist() == [1e-7] + [0.0] * 7
    assert chain.non_reciprocities.tolist() == [1e-5] * 3 + [-1e-5] + [1e-5] * 3
    with pytest.raises(ValueError, match=r'dry_friction = -1.5 must be .* -1 or more'):
        Deviations(dry_friction=(-1.5,))


def test_forces_see_the_time_since_the_start_after_a_kick_too():
    times = []
    simulation = by(chain_of(FLIPPER, 4), lambda t, _a, r: times.append(t) or 0 * r)
    simulation.kick(np.zeros(4))
    times.clear()
    simulation.advance()
    assert min(times) >= simulation.time - simulation.period - 1e-12


def test_rigid_bars_take_forces_as_they_take_damping():
    chain = chain_of(FLIPPER, 12)
    damped = Chain(12, chain.spacing, chain.rotor_length, chain.rest_angle, damping=DRAG)
    start = with_soliton(chain, 4.0, 0.1)
    inside = RigidSimulation(damped, start.angles, start.rates)
    outside = RigidSimulation(chain, start.angles, start.rates, forces=[drag])
    for simulation in (inside, outside):
        simulation.record(0.3)
    np.testing.assert_allclose(outside.angles, inside.angles, rtol=0, atol=1e-10)
    np.testing.assert_allclose(outside.link_torques, inside.link_torques, rtol=0, atol=1e-9)
    assert outside.dissipated == pytest.approx(inside.dissipated, rel=1e-9)


def test_forces_without_compiled_steps_are_rejected():
    with pytest.raises(
        ValueError, match=r"'symplectic' does not integrate Python functions .*'DOP853'"
    ):
        by(chain_of(FLIPPER, 4), drag, integrator='symplectic')
    with pytest.raises(ValueError, match='regularisation = 0 rad/s'):
        DryFriction(1e-3, 0)


def test_arrays_of_another_shape_are_rejected():
    with pytest.raises(ValueError, match='give one per rotor'):
        EquationOfMotion(Chain(6), np.zeros(5))
    for rotor in (-1, 6, 2.5):
        with pytest.raises(ValueError, match=f'fixed rotor {rotor} must be one of 0 to 5'):
            EquationOfMotion(Chain(6), fixed=(rotor,))
    with pytest.raises(ValueError, match='rate of rotor 1'):
        EquationOfMotion(Chain(3)).state(np.zeros(3), np.array([0, np.nan, 0]))
