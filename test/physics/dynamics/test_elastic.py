# SPDX-License-Identifier: Apache-2.0
"""Laws of motion: energy, time reversal, exact stamps, kicks, torques, ten thousand rotors."""

import math

import numpy as np
import pytest
from chains import CLASSES, EPS, FLIPPER, SPINNER, STRONG_WOBBLER, chain_of
from linkage_motion import wall_between

from soliton_linkage.dynamics.elastic import ElasticSettings, ElasticSimulation, simulate
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.tanh_fit import find_solitons

MOVING = ((FLIPPER, 0.1), (STRONG_WOBBLER, 0.03), (SPINNER, 0.3))
DURATION = 60
UNLIMITED = ElasticSettings(longest_step=math.inf)


def nudged(
    example: tuple[float, float], speed: float, rotors: int = 10
) -> tuple[Chain, Array, Array]:
    """Return a chain, its left-leaning state [rad] and the rates [rad/s] after a kick.

    The speed of the masses, r |phi_dot|, is in units of a / time_unit, as in docs/physics.md.
    """
    chain = chain_of(example, rotors)
    angles = chain.uniform_state(-1)
    rate = speed * chain.spacing / chain.rotor_length / chain.time_unit
    return chain, angles, rate * mode_towards_last(chain, angles)


def moved(chain: Chain, angles: Array, rates: Array, tolerance: float = 1e-9) -> Recording:
    return simulate(chain, angles, rates, DURATION * chain.time_unit, chain.time_unit, tolerance)


def energies(chain: Chain, recording: Recording) -> Array:
    return chain.elastic_energy(recording.angles) + chain.kinetic_energy(recording.rates)


@pytest.mark.parametrize(('example', 'speed'), MOVING)
def test_energy_and_path_are_as_exact_as_the_tolerance_asks(example, speed):
    chain, angles, rates = nudged(example, speed)
    exact = moved(chain, angles, rates, 1e-13)
    tolerances = 10.0 ** -np.arange(3, 12)
    drifts, errors = [], []
    for tolerance in tolerances:
        given = chain, angles, rates, chain.time_unit, float(tolerance)
        simulation = ElasticSimulation(*given, integrator='DOP853', settings=UNLIMITED)
        recording = simulation.record(DURATION * chain.time_unit)
        energy = energies(chain, recording)
        drifts.append(np.abs(energy - energy[0]).max() / energy[0])
        errors.append(np.abs(recording.angles - exact.angles).max())
    # A step of about a time unit may be off by the tolerance, and nothing here is unstable.
    assert (errors <= DURATION * tolerances).all()
    # An angle off by e lets speeds be off by e per time unit, and the energy by twice that share.
    norm = float(np.linalg.norm(rates)) * chain.time_unit
    assert (drifts <= 2 * DURATION * tolerances / norm).all()
    for order in np.polyfit(np.log(tolerances), np.log([errors, drifts]).T, 1)[0]:
        assert order == pytest.approx(1, abs=0.1)


def test_frames_at_two_periods_agree_at_the_instants_that_they_share():
    for example, speed in MOVING:
        chain, angles, rates = nudged(example, speed)
        fine = simulate(chain, angles, rates, 1.0, 1 / 256)
        coarse = simulate(chain, angles, rates, 1.0, 1 / 16)
        assert np.array_equal(fine.times[::16], coarse.times)
        assert np.array_equal(fine.angles[::16], coarse.angles)
        assert np.array_equal(fine.rates[::16], coarse.rates)


@pytest.mark.parametrize(('example', 'speed'), MOVING)
def test_frames_between_the_solvers_steps_are_as_exact_as_those_at_them(example, speed):
    chain, angles, rates = nudged(example, speed)
    period = chain.time_unit / 32
    exact = simulate(chain, angles, rates, 2 * chain.time_unit, period, 1e-13)
    recording = simulate(chain, angles, rates, 2 * chain.time_unit, period, 1e-9)
    assert len(recording.times) == 65
    assert np.abs(recording.angles - exact.angles).max() <= 4e-9
    assert np.abs(recording.rates - exact.rates).max() * chain.time_unit <= 1e-8


def test_the_time_of_a_frame_is_its_number_times_the_period():
    chain, angles, rates = nudged(FLIPPER, 0.1, rotors=2)
    simulation = ElasticSimulation(chain, angles, rates, period=0.003)
    times = [simulation.time]
    for _ in range(1000):
        simulation.advance()
        times.append(simulation.time)
    assert times == [frame * 0.003 for frame in range(1001)]


def test_a_recording_holds_both_ends_of_its_duration():
    chain, angles, rates = nudged(FLIPPER, 0.1, rotors=2)
    assert simulate(chain, angles, rates, 0.3, 0.1).times == pytest.approx([0, 0.1, 0.2, 0.3])
    assert simulate(chain, angles, rates, 0.29, 0.1).times == pytest.approx([0, 0.1, 0.2])
    assert simulate(chain, angles, rates, 0, 0.1).times == pytest.approx([0])


@pytest.mark.parametrize(('example', 'speed'), MOVING)
def test_a_kick_at_a_frame_is_a_start_from_that_frame(example, speed):
    chain, angles, rates = nudged(example, speed)
    impulse = 0.1 * chain.moment_of_inertia * rates[::-1]
    simulation = ElasticSimulation(chain, angles, rates)
    for _ in range(7):
        simulation.advance()
    simulation.kick(impulse)
    restarted = ElasticSimulation(chain, simulation.angles, simulation.rates)
    for _ in range(20):
        simulation.advance()
        restarted.advance()
        assert np.array_equal(simulation.angles, restarted.angles)
        assert np.array_equal(simulation.rates, restarted.rates)
    assert (simulation.frame, restarted.frame) == (27, 20)


def test_the_drift_is_the_share_of_energy_that_nothing_accounts_for():
    chain, angles, rates = nudged(FLIPPER, 0.1)
    simulation = ElasticSimulation(chain, angles, rates)
    assert simulation.energy_drift == 0
    simulation.rates = 2 * simulation.rates
    assert simulation.energy_drift == pytest.approx(3 / 4, rel=8 * EPS)
    assert ElasticSimulation(chain, angles).energy_drift == 0 or np.any(
        chain.spring_extensions(angles) != 0
    )


def test_a_rotor_of_a_chain_with_slack_springs_is_accelerated_evenly():
    chain = Chain(3, stiffness=1e-9)
    torque = 1e-4 * np.array([1.0, 0.0, -2.0])
    simulation = ElasticSimulation(chain, chain.uniform_state(-1), period=0.25)
    for _ in range(4):
        simulation.advance()
    simulation.hold(torque)
    for _ in range(8):
        simulation.advance()
    simulation.hold(0 * torque)
    for _ in range(4):
        simulation.advance()
    acceleration = torque / chain.moment_of_inertia
    assert simulation.rates == pytest.approx(2 * acceleration, rel=1e-6, abs=1e-4)
    travelled = acceleration * (2**2 / 2 + 2 * 1)
    assert simulation.angles - chain.uniform_state(-1) == pytest.approx(
        travelled, rel=1e-6, abs=1e-4
    )


def test_the_simulation_copies_its_arguments():
    chain, angles, rates = nudged(FLIPPER, 0.1)
    torque = np.full(10, 1e-5)
    given = ElasticSimulation(chain, angles, rates)
    given.hold(torque)
    kept = ElasticSimulation(chain, angles.copy(), rates.copy())
    kept.hold(torque.copy())
    for array in (angles, rates, torque):
        array += 1
    for _ in range(5):
        assert np.array_equal(given.angles, kept.angles)
        assert np.array_equal(given.rates, kept.rates)
        assert given.energy_drift == kept.energy_drift
        given.advance()
        kept.advance()


def test_full_turns_of_the_rotors_do_not_reduce_accuracy():
    for turns in [1, 1000]:
        chain, angles, rates = nudged(SPINNER, 0.3)
        turned = moved(chain, angles + 2 * np.pi * turns, rates)
        straight = moved(chain, angles, rates)
        # An angle of 2 pi turns is rounded by EPS of it in each of a few hundred steps.
        limit = 2 * DURATION * 1e-9 + 1000 * EPS * 2 * np.pi * turns
        assert turned.angles - 2 * np.pi * turns == pytest.approx(
            straight.angles, rel=0, abs=limit
        )


def test_the_error_does_not_grow_with_the_rotors_at_rest():
    # By a solver whose step follows its error continuously.
    def end(rotors: int, tolerance: float) -> Array:
        chain, angles, rates = nudged(FLIPPER, 0.1, rotors)
        simulation = ElasticSimulation(
            chain, angles, rates, chain.time_unit, tolerance, integrator='DOP853'
        )
        return simulation.record(DURATION * chain.time_unit).angles[-1, :20]

    exact = end(40, 1e-13)
    errors = [np.abs(end(rotors, 1e-7) - exact).max() for rotors in (40, 2000)]
    assert errors[1] <= 1.5 * errors[0]


def unseen(chain: Chain, spacings: int) -> float:
    """Deviation at some spacings from a wall [rad]: its tail, and the solver's errors."""
    return 4 * math.exp(-spacings * chain.spacing / penetration_depth(chain)) + 1e-8


@pytest.mark.parametrize('example', CLASSES)
def test_a_wall_in_ten_thousand_rotors_moves_as_in_forty(example):
    tracks = []
    for rotors, rotor in ((40, 20), (10_000, 5000)):
        chain = chain_of(example, rotors)
        wall = wall_between(chain, rotor)
        rate = 0.1 * chain.spacing / chain.rotor_length / chain.time_unit
        simulation = ElasticSimulation(
            chain, wall, rate * mode_towards_last(chain, wall), period=chain.time_unit
        )
        for _ in range(8):
            simulation.advance()
        core = slice(rotor - 8, rotor + 9)
        soliton = find_solitons(chain, simulation.angles, simulation.rates)[0]
        tracks.append(
            [
                *(simulation.angles - wall)[core],
                *simulation.rates[core] * chain.time_unit,
                soliton.rotor - rotor,
            ]
        )
        far = np.r_[: rotor - 17, rotor + 20 : rotors]
        assert np.abs((simulation.angles - wall)[far]).max() <= unseen(chain, 16)
        assert soliton.rotor > rotor + 0.5
    assert tracks[1] == pytest.approx(tracks[0], rel=0, abs=unseen(chain, 16))


def test_a_simulation_rejects_by_name_and_value():
    for arguments, complaint in [
        ({'period': 0.0}, 'period = 0.0 s'),
        ({'period': math.nan}, 'period = nan s'),
        ({'tolerance': 1e-14}, 'tolerance = 1e-14 rad must lie in the range 1e-13 to 0.01'),
        ({'tolerance': math.nan}, 'tolerance = nan rad'),
        ({'angles': np.zeros(3)}, r'angles of shape \(3,\) do not fit a chain of 4 rotors'),
        ({'rates': np.array([0, math.inf, 0, 0])}, 'rate of rotor 1 = inf must be a finite'),
    ]:
        chain = chain_of(FLIPPER, 4)
        with pytest.raises(ValueError, match=complaint):
            ElasticSimulation(chain, **{'angles': chain.uniform_state(-1), **arguments})


def test_a_command_with_a_bad_value_is_rejected_whole():
    for command, what in [('kick', 'impulse'), ('hold', 'torque')]:
        chain, angles, rates = nudged(FLIPPER, 0.1, rotors=4)
        simulation = ElasticSimulation(chain, angles, rates)
        with pytest.raises(ValueError, match=f'{what} of rotor 2 = nan must be a finite number'):
            getattr(simulation, command)(np.array([1e-5, 0, math.nan, 0]))
        with pytest.raises(ValueError, match=rf'{what}s of shape \(3,\) do not fit'):
            getattr(simulation, command)(np.zeros(3))
        untouched = ElasticSimulation(chain, angles, rates)
        simulation.advance()
        untouched.advance()
        assert np.array_equal(simulation.angles, untouched.angles)
        assert simulation.energy_drift == untouched.energy_drift


def test_a_duration_that_is_no_time_is_rejected():
    for duration in [-1.0, math.nan, math.inf]:
        chain, angles, rates = nudged(FLIPPER, 0.1, rotors=2)
        with pytest.raises(ValueError, match=f'duration = {duration} s must be'):
            simulate(chain, angles, rates, duration, 0.1)


def test_a_chain_too_fast_to_follow_is_given_up_by_rotor_and_limit():
    chain, settings = chain_of(FLIPPER, 4), ElasticSettings(max_steps=100)
    simulation = ElasticSimulation(
        chain, chain.uniform_state(-1), period=chain.time_unit / 2, settings=settings
    )
    simulation.kick(chain.moment_of_inertia * 1e100 * np.eye(4)[2])
    complaint = r't = 0 s, where rotor 2 turns at 1e\+100 rad/s: .* more than 150 steps; apply'
    with pytest.raises(ArithmeticError, match=complaint):
        simulation.advance()
    assert np.array_equal(simulation.angles, chain.uniform_state(-1))
    assert simulation.frame == 0
