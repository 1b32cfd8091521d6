# SPDX-License-Identifier: Apache-2.0
"""Laws of rigid bars: one freedom, bars that keep their length, energy exact to rounding."""

import dataclasses
import math

import numpy as np
import pytest
from chains import CLASSES, EPS, EXAMPLES, FLIPPER, SPINNER, chain_of
from deviating_chains import deviating
from linkage_motion import distance, rigid_motion, wall_between
from scipy.integrate import solve_ivp

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.rigid import RigidSettings, RigidSimulation
from soliton_linkage.linear.rigidity import mode_towards_last, rigidity_matrix, zero_mode
from soliton_linkage.linear.statics import rest_state
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

# Flippers, wobblers and spinners with rotors much shorter and much longer than the spacing.
EXTREMES = ((0.1, 0.97), (10, 0.04), (0.6, 1.2), (10, 0.2), (1.1, 1.4), (10, 0.9))
TILTED = Gravity(9.81, 0.5)
TORQUES = 1e-3 * np.array([1.0, -2.0, 3.0, 0.5, -1.0, 2.0])


def pushed(
    chain: Chain,
    rate: float = 3.0,
    tolerance: float = 1e-9,
    gravity: Gravity = NO_GRAVITY,
    period: float = 0.05,
) -> RigidSimulation:
    """Start at rest state, left-leaning, with rates along the zero mode of a norm [rad/s]."""
    angles = rest_state(chain, -1)
    rates = rate * mode_towards_last(chain, angles)
    return RigidSimulation(chain, angles, rates, period, tolerance, gravity)


def stretch(simulation: RigidSimulation) -> float:
    """Largest extension of a bar over the spacing [1]."""
    chain = simulation.chain
    return float(np.abs(chain.spring_extensions(simulation.angles)).max()) / chain.spacing


def speed(simulation: RigidSimulation) -> float:
    """Norm of the rates in the metric of the inertia, sqrt(2 T) [J^(1/2)]."""
    return math.sqrt(2 * float(simulation.chain.kinetic_energy(simulation.rates)))


@pytest.mark.parametrize('example', EXAMPLES + EXTREMES)
def test_without_forces_the_speed_and_the_lengths_of_bars_are_kept(example):
    for largest in [0.0, 0.02]:
        simulation = pushed(deviating(chain_of(example, 6), 4, largest * min(1, example[1])))
        start = speed(simulation)
        for _ in range(40):
            simulation.advance()
            assert stretch(simulation) <= 1e-12
            assert speed(simulation) == pytest.approx(start, rel=16 * EPS)
            assert abs(simulation.energy_drift) <= 16 * EPS
        assert distance(simulation.angles, rest_state(simulation.chain, -1)) > 0.1


@pytest.mark.parametrize('example', CLASSES)
def test_motion_is_that_of_constrained_masses_with_tensions_as_multipliers(example):
    chain = dataclasses.replace(deviating(chain_of(example, 6), 8, 0.02), damping=2e-5)
    simulation = pushed(chain, tolerance=1e-11, gravity=TILTED)
    simulation.hold(TORQUES)
    inertia = chain.moments_of_inertia

    def derivative(_: float, state: Array) -> Array:
        angles, rates = state[:6], state[6:]
        levers = rigidity_matrix(chain, angles).toarray()
        ahead, behind = (
            rigidity_matrix(chain, angles + sign * 1e-5 * rates).toarray() for sign in (1, -1)
        )
        turning = (ahead - behind) @ rates / 2e-5
        bare = (TORQUES + TILTED.torques(chain, angles) - chain.dampings * rates) / inertia
        tensions = np.linalg.solve(levers / inertia @ levers.T, -turning - levers @ bare)
        return np.concatenate([rates, bare + levers.T @ tensions / inertia])

    start = np.concatenate([simulation.angles, simulation.rates])
    twin = solve_ivp(
        derivative, (0, 0.5), start, method='DOP853', rtol=1e-9, atol=1e-9, t_eval=[0.25, 0.5]
    )
    recording = simulation.record(0.5)
    # The twin's bars give way by its tolerance in a hundred steps, and grow with the time.
    assert recording.angles[[5, 10]] == pytest.approx(twin.y[:6].T, rel=0, abs=1e-5)
    assert recording.rates[[5, 10]] == pytest.approx(twin.y[6:].T, rel=0, abs=1e-4)


def test_neither_energy_nor_bars_drift_in_thousands_of_steps():
    chain = chain_of(FLIPPER, 3)
    start = chain.uniform_state(-1)
    simulation = RigidSimulation(chain, start, period=0.1, tolerance=1e-10, gravity=TILTED)
    drifts, stretches, turns = [], [], 0
    steps = 0
    while steps < 2000:
        while not simulation.ready:
            simulation.step()
            steps += 1
        before = zero_mode(chain, simulation.angles) @ simulation.rates
        simulation.advance()
        turns += before * (zero_mode(chain, simulation.angles) @ simulation.rates) < 0
        drifts.append(abs(simulation.energy_drift))
        stretches.append(stretch(simulation))
    assert turns > 10
    half = len(drifts) // 2
    for values in (drifts, stretches):
        assert max(values) <= 32 * EPS
        assert np.mean(values[half:]) <= 2 * np.mean(values[:half])


@pytest.mark.parametrize('example', CLASSES)
def test_errors_are_of_the_order_of_the_tolerance(example):
    chain = chain_of(example, 6)
    exact = pushed(chain, tolerance=1e-13, gravity=TILTED).record(1.0)
    tolerances = 10.0 ** -np.arange(4, 12, 2)
    errors = []
    for tolerance in tolerances:
        recording = pushed(chain, tolerance=float(tolerance), gravity=TILTED).record(1.0)
        errors.append(np.abs(recording.angles - exact.angles).max())
    assert np.polyfit(np.log(tolerances), np.log(errors), 1)[0] == pytest.approx(1, abs=0.2)
    assert (errors <= 100 * tolerances).all()


@pytest.mark.parametrize('example', CLASSES)
def test_frames_do_not_depend_on_the_period_nor_on_the_stiffness(example):
    chain = chain_of(example, 6)
    expected = pushed(chain, gravity=TILTED).record(1.0).angles
    fine = pushed(chain, gravity=TILTED, period=0.05 / 16).record(1.0).angles
    assert fine[::16] == pytest.approx(expected, rel=0, abs=1e-11)
    for stiffness in (1e-9, 1e12):
        other = dataclasses.replace(chain, stiffness=stiffness)
        angles = pushed(other, gravity=TILTED).record(1.0).angles
        assert angles == pytest.approx(expected, rel=0, abs=100 * 1e-9)


def test_the_same_start_gives_the_same_motion_to_the_last_bit():
    for example in CLASSES:
        first, second = (
            pushed(chain_of(example, 6), gravity=TILTED).record(1.0) for _ in range(2)
        )
        assert np.array_equal(first.angles, second.angles)
        assert np.array_equal(first.rates, second.rates)


@pytest.mark.parametrize('example', CLASSES)
def test_bars_bear_a_kick_except_its_part_along_the_zero_mode(example):
    chain = deviating(chain_of(example, 6), 3, 0.05)
    simulation = pushed(chain)
    simulation.advance()
    before, angles = simulation.rates, simulation.angles
    simulation.kick(TORQUES)
    mode = zero_mode(chain, angles)
    # Impulses of bars are along R^T and do nothing along t: I (t . t) ds = t . J.
    mass = float(mode @ (chain.moments_of_inertia * mode))
    expected = before + mode * float(mode @ TORQUES) / mass
    limit = 64 * EPS * float(np.abs(expected).max() + np.abs(TORQUES).sum() / mass)
    assert simulation.rates == pytest.approx(expected, rel=0, abs=limit)
    borne = chain.moments_of_inertia * (simulation.rates - before) - TORQUES
    levers = rigidity_matrix(chain, angles).toarray()
    tensions = np.linalg.lstsq(levers.T, borne, rcond=None)[0]
    assert levers.T @ tensions == pytest.approx(borne, rel=0, abs=1e-10 * np.abs(TORQUES).max())
    simulation.advance()
    assert abs(simulation.energy_drift) <= 32 * EPS


def test_rates_that_the_bars_do_not_allow_are_projected():
    chain = deviating(chain_of(FLIPPER, 6), 3, 0.05)
    angles = rest_state(chain, 1)
    levers = rigidity_matrix(chain, angles).toarray()
    simulation = RigidSimulation(chain, angles, levers.T @ np.ones(5) / chain.moments_of_inertia)
    limit = 1e-12 * float(np.abs(levers.T @ np.ones(5) / chain.moments_of_inertia).max())
    assert np.abs(simulation.rates).max() <= limit


@pytest.mark.parametrize('example', CLASSES)
def test_damping_dissipates_the_stated_energy(example):
    chain = dataclasses.replace(chain_of(example, 6), damping=1e-5)
    chain = deviating(chain, 5, 0.02)
    simulation = pushed(chain, gravity=TILTED, period=1 / 512)
    total = simulation.energy
    recording = simulation.record(1.0)
    power = (recording.rates**2) @ chain.dampings
    weights = np.full(len(power), 2.0)
    weights[1::2], weights[0], weights[-1] = 4, 1, 1
    assert simulation.dissipated == pytest.approx(float(weights @ power) / 3 / 512, rel=1e-6)
    assert simulation.dissipated > 0.1 * float(power[0])
    assert simulation.energy + simulation.dissipated == pytest.approx(total, rel=64 * EPS)
    assert abs(simulation.energy_drift) <= 32 * EPS


@pytest.mark.parametrize('example', CLASSES)
def test_the_books_stay_exact_through_commands_in_a_damped_chain(example):
    chain = deviating(dataclasses.replace(chain_of(example, 6), damping=1e-5), 5, 0.02)
    simulation = pushed(chain, tolerance=1e-7, gravity=TILTED)
    for turn in range(6):
        for _ in range(5):
            simulation.advance()
            assert abs(simulation.energy_drift) <= 64 * EPS
            assert stretch(simulation) <= 1e-12
        dissipated, angles = simulation.dissipated, simulation.angles
        simulation.kick(1e-2 * (-1) ** turn * TORQUES)
        simulation.hold(turn * TORQUES)
        simulation.set_gravity(Gravity(2.0 * turn, 0.3 * turn))
        assert simulation.dissipated == dissipated > 0
        assert simulation.angles is angles
        assert abs(simulation.energy_drift) <= 64 * EPS


@pytest.mark.parametrize('example', CLASSES)
def test_even_damping_slows_the_closed_orbit_exponentially(example):
    bare = chain_of(example, 5)
    decay = 2.0
    chain = dataclasses.replace(bare, damping=decay * bare.moment_of_inertia)
    recording = pushed(chain, period=0.125, tolerance=1e-10).record(2.0)
    rates = np.linalg.norm(recording.rates, axis=1)
    assert rates == pytest.approx(3 * np.exp(-decay * recording.times), rel=1e-7)
    arcs = 3 * (1 - np.exp(-decay * recording.times)) / decay
    start = chain.uniform_state(-1)
    sense = float(np.sign(zero_mode(chain, start) @ mode_towards_last(chain, start)))
    expected = rigid_motion(chain, start, arcs, sense)
    assert recording.angles == pytest.approx(expected, rel=0, abs=1e-7)


@pytest.mark.parametrize('example', CLASSES)
def test_a_wall_in_the_middle_of_three_thousand_rotors_moves_as_in_sixty(example):
    tracks = []
    for rotors, rotor in ((60, 30), (3000, 1500)):
        chain = chain_of(example, rotors)
        wall = wall_between(chain, rotor)
        rates = 5 * mode_towards_last(chain, wall)
        simulation = RigidSimulation(chain, wall, rates, 0.1, gravity=Gravity(0.05, 0.5))
        for _ in range(3):
            simulation.advance()
            assert stretch(simulation) <= 1e-12
            assert abs(simulation.energy_drift) <= 32 * EPS
        core = slice(rotor - 12, rotor + 13)
        tracks.append((simulation.angles - wall)[core])
    assert np.abs(tracks[0]).max() > 0.1
    # What the tail of the wall does beyond thirty spacings is lost.
    assert tracks[1] == pytest.approx(tracks[0], rel=0, abs=1e-7)


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_springs_of_growing_stiffness_move_as_bars_to_first_order_in_their_softness(example):
    chain = chain_of(example, 6)
    angles = chain.uniform_state(-1)
    rates = 4 * mode_towards_last(chain, angles)
    bars = RigidSimulation(chain, angles, rates, 0.02, gravity=TILTED).record(0.6)
    stiffnesses = 4000 * 4.0 ** np.arange(3)
    errors = []
    for stiffness in stiffnesses:
        springs = dataclasses.replace(chain, stiffness=float(stiffness))
        simulation = ElasticSimulation(springs, angles, rates, 0.02, 1e-9, TILTED)
        errors.append(np.abs(simulation.record(0.6).angles - bars.angles).max())
    order = np.polyfit(np.log(stiffnesses), np.log(errors), 1)[0]
    assert order == pytest.approx(-1, abs=0.1)
    assert np.abs(bars.angles[-1] - angles).max() > 1


def test_a_chain_at_rest_without_forces_stays_to_the_last_bit():
    chain = chain_of(FLIPPER, 6)
    simulation = RigidSimulation(chain, chain.uniform_state(1))
    for _ in range(20):
        simulation.advance()
    assert np.array_equal(simulation.angles, chain.uniform_state(1))
    assert not simulation.rates.any()
    assert simulation.energy_drift == 0


def test_the_smallest_chains_move_at_the_border_of_spinning():
    for offset in [0, 1e-10, -1e-10, 1e-5]:
        for rotors in [2, 3]:
            chain = Chain(
                rotors, rotor_length=0.1 / math.sin(0.9) ** 2 * (1 + offset), rest_angle=0.9
            )
            simulation = pushed(chain)
            for _ in range(100):
                simulation.advance()
                assert stretch(simulation) <= 1e-12
                assert abs(simulation.energy_drift) <= 16 * EPS


def test_angles_that_the_bars_do_not_allow_are_rejected_by_bar():
    chain = chain_of(FLIPPER, 4)
    angles = chain.uniform_state(-1)
    angles[3] += 0.1
    complaint = r'bar 2 between rotors 2 and 3 would be -?0\.\d+ m longer than its rest length'
    with pytest.raises(ValueError, match=complaint):
        RigidSimulation(chain, angles)


def test_angles_off_by_less_than_the_play_of_a_bar_are_brought_onto_them():
    chain = chain_of(FLIPPER, 4)
    given = chain.uniform_state(-1) + 1e-7 * np.array([1.0, -2.0, 0.5, 3.0])
    simulation = RigidSimulation(chain, given)
    assert stretch(simulation) <= 8 * EPS
    assert 0 < np.abs(simulation.angles - given).max() <= 1e-6


def test_bars_between_periodic_ends_are_rejected():
    chain = Chain(4, periodic=True)
    with pytest.raises(
        ValueError, match='rigid bars with periodic ends cannot move; set periodic'
    ):
        RigidSimulation(chain, chain.uniform_state(1))


def test_an_impulse_without_finite_energy_is_rejected():
    simulation = pushed(chain_of(FLIPPER, 6))
    with pytest.raises(ValueError, match=r'impulse of rotor 2 = 1e\+200 N m s gives an energy'):
        simulation.kick(1e200 * np.eye(6)[2])


def test_jammed_bars_are_reported():
    for rate in [1.0, 100.0]:
        chain = Chain(2)
        # A bar as long as both rotors and the spacing in one line can move to neither side.
        fraction = (chain.spacing + 2 * chain.rotor_length) / chain.rest_length - 1
        chain = dataclasses.replace(chain, deviations=Deviations(rest_length=(fraction,)))
        angles = np.array([-np.pi / 2, np.pi / 2])
        settings = RigidSettings(max_steps=50)
        simulation = RigidSimulation(chain, angles, np.full(2, rate), settings=settings)
        with pytest.raises(ArithmeticError, match=r'beyond t = 0 s, .*: the bars jam \('):
            simulation.advance()
        assert np.array_equal(simulation.angles, angles)


def test_a_kick_too_hard_to_follow_is_given_up_and_not_taken_for_a_jam():
    simulation = pushed(chain_of(FLIPPER, 6))
    simulation.kick(np.full(6, 1e120))
    with pytest.raises(ArithmeticError, match=r'rad/s: (?!.*jam).*; apply smaller impulses'):
        simulation.advance()
    assert simulation.frame == 0


@pytest.mark.parametrize('example', CLASSES)
def test_bars_and_forces_together_accelerate_the_rotors(example):
    for damping in [0.0, 1e-4]:
        chain = dataclasses.replace(chain_of(example, 6), damping=damping)
        chain = deviating(chain, 4, 0.02 * min(1, example[1]))
        period = 1e-4
        simulation = pushed(chain, 3.0, 1e-12, TILTED, period)
        simulation.hold(TORQUES)
        simulation.advance()
        before = simulation.rates
        simulation.advance()
        now = simulation.link_torques
        others = (
            TORQUES + TILTED.torques(chain, simulation.angles) - chain.dampings * simulation.rates
        )
        simulation.advance()
        turning = chain.moments_of_inertia * (simulation.rates - before) / (2 * period)
        # The error of the difference is the jerk times the squared time scale, 1 / (30 rad/s).
        assert now + others == pytest.approx(turning, rel=0, abs=1e-4 * float(np.abs(now).max()))


def test_a_fixed_rotor_that_would_stop_the_bars_is_rejected():
    chain = chain_of(FLIPPER, 6)
    with pytest.raises(ValueError, match='cannot move with rotor 3 fixed; fix no rotor, or'):
        RigidSimulation(chain, chain.uniform_state(1), fixed=(3,))
