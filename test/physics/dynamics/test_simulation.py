# SPDX-License-Identifier: Apache-2.0
"""Laws of motion with gravity, damping, deviations and periodic ends, shown on springs."""

import dataclasses
import math

import numpy as np
import pytest
from chains import CLASSES, EPS, FLIPPER, chain_of
from deviating_chains import deviating
from scipy.integrate import DOP853

from soliton_linkage.dynamics.elastic import ElasticSettings, ElasticSimulation
from soliton_linkage.dynamics.integrators import INTEGRATORS
from soliton_linkage.linear.rigidity import dynamical_matrix
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

TILTED = Gravity(9.81, 0.5)
TOLERANCE = 1e-9
UNITS = 40


def shaken(
    example: tuple[float, float],
    gravity: Gravity = TILTED,
    periodic: bool = False,
    damping: float = 0.0,
) -> ElasticSimulation:
    """Start a chain of eight unlike rotors with rates of all sorts; period is a time unit."""
    bare = chain_of(example, 8)
    resisting = damping * bare.moment_of_inertia / bare.time_unit
    chain = dataclasses.replace(bare, periodic=periodic, damping=resisting)
    chain = deviating(chain, 7, 0.05)
    angles = chain.uniform_state(-1)
    rates = 0.2 * np.cos(2 * np.arange(8)) / chain.time_unit
    return ElasticSimulation(chain, angles, rates, chain.time_unit, TOLERANCE, gravity)


def largest_drift(simulation: ElasticSimulation) -> float:
    """Bound of the drift [1] that the tolerance allows in all time units together.

    An error of the rates by the tolerance in each time unit changes the energy by this error times
    the momenta, sqrt(2 T I). The angles contribute as much against the forces.
    """
    chain = simulation.chain
    inertia = float(chain.moments_of_inertia.max())
    energy = simulation._largest_energy
    return 4 * UNITS * TOLERANCE * math.sqrt(2 * inertia / energy) / chain.time_unit


@pytest.mark.parametrize('example', CLASSES)
def test_normal_modes_decay_at_half_the_damping_over_the_inertia(example):
    for damping in [0.02, 0.3]:
        for periodic in [False, True]:
            bare = dataclasses.replace(chain_of(example, 6), periodic=periodic)
            decay = damping / bare.time_unit
            chain = dataclasses.replace(bare, damping=decay * bare.moment_of_inertia)
            rest = chain.uniform_state(1)
            squares, shapes = np.linalg.eigh(dynamical_matrix(chain, rest).toarray())
            amplitude = 1e-7
            for mode in (1, 5):
                omega = math.sqrt(squares[mode] - decay**2 / 4)
                simulation = ElasticSimulation(
                    chain, rest + amplitude * shapes[:, mode], None, chain.time_unit / 2, 1e-13
                )
                recording = simulation.record(15 * chain.time_unit)
                phases = omega * recording.times
                wave = np.exp(-decay * recording.times / 2) * (
                    np.cos(phases) + decay / (2 * omega) * np.sin(phases)
                )
                # Springs yield with the square of the amplitude, by a factor of the size of r /
                # lbar.
                assert recording.angles - rest == pytest.approx(
                    amplitude * np.outer(wave, shapes[:, mode]), rel=0, abs=1000 * amplitude**2
                )


@pytest.mark.parametrize('example', CLASSES)
def test_gravity_turned_at_a_frame_is_a_start_from_that_frame(example):
    simulation = shaken(example, NO_GRAVITY)
    for _ in range(5):
        simulation.advance()
    for gravity in (TILTED, Gravity(3.0, -1.0), NO_GRAVITY):
        energy = simulation.energy
        lifted = gravity.energy(simulation.chain, simulation.angles)
        lifted -= simulation.gravity.energy(simulation.chain, simulation.angles)
        simulation.set_gravity(gravity)
        assert simulation.energy - energy == pytest.approx(
            float(lifted), rel=0, abs=8 * EPS * simulation._largest_energy
        )
        chain, angles, rates = simulation.chain, simulation.angles, simulation.rates
        fresh = ElasticSimulation(chain, angles, rates, chain.time_unit, TOLERANCE, gravity)
        for _ in range(5):
            simulation.advance()
            fresh.advance()
            assert np.array_equal(simulation.angles, fresh.angles)
            assert np.array_equal(simulation.rates, fresh.rates)
            assert abs(simulation.energy_drift) <= largest_drift(simulation)


def test_repeating_the_present_gravity_and_torques_changes_nothing():
    once, again = shaken(FLIPPER), shaken(FLIPPER)
    torques = np.full(8, 1e-5)
    once.hold(torques)
    for _ in range(10):
        again.set_gravity(Gravity(9.81, 0.5))
        again.hold(torques.copy())
        once.advance()
        again.advance()
    assert np.array_equal(once.angles, again.angles)
    assert once.energy_drift == again.energy_drift


def test_a_kick_turns_each_rotor_by_its_own_inertia():
    simulation = shaken(FLIPPER)
    before = simulation.rates
    simulation.kick(np.full(8, 1e-5))
    expected = 1e-5 / (simulation.chain.masses * simulation.chain.rotor_lengths**2)
    assert simulation.rates - before == pytest.approx(expected, rel=1e-12)


def test_a_chain_at_rest_stays_there_however_it_is_damped():
    for damping in [0.0, 30.0]:
        for periodic in [False, True]:
            bare = dataclasses.replace(chain_of(FLIPPER, 20), periodic=periodic)
            resisting = damping * bare.moment_of_inertia / bare.time_unit
            chain = dataclasses.replace(bare, damping=resisting)
            simulation = ElasticSimulation(
                chain, chain.uniform_state(1), period=20 * chain.time_unit
            )
            for _ in range(5):
                simulation.advance()
                # The springs' forces are off by their rounding, eps k_e r, for up to 100 time
                # units.
                assert np.abs(simulation.rates).max() * chain.time_unit <= 100 * 4 * EPS


def test_a_chain_that_hangs_at_rest_stays_there_up_to_rounding():
    chain = Chain(2, rotor_length=1e-3, stiffness=1e-9)
    simulation = ElasticSimulation(
        chain,
        np.full(2, np.pi),
        period=1.6e-2,
        tolerance=1e-5,
        gravity=Gravity(1e6),
        settings=ElasticSettings(max_steps=2),
    )
    for _ in range(5):
        simulation.advance()
    # It would swing with sqrt(g / r) = 3e4 rad/s, far from the time unit of its slack springs;
    # each of some 500 steps rounds the angle.
    assert np.abs(simulation.angles - np.pi).max() <= 500 * 4 * EPS


FIXED = (2, 5)


@pytest.mark.parametrize('fixed', [(), FIXED])
@pytest.mark.parametrize('example', CLASSES)
def test_energy_changes_by_work_and_dissipation_and_fixed_rotors_stay(example, fixed):
    for periodic in [False, True]:
        for damping in [0.0, 0.05]:
            loose = shaken(example, TILTED, periodic, damping)
            chain, angles = loose.chain, loose.angles
            simulation = ElasticSimulation(
                chain, angles, loose.rates, chain.time_unit, TOLERANCE, TILTED, fixed
            )
            assert (simulation.energy < loose.energy) == bool(fixed)
            for frame in range(UNITS):
                if frame == 10:
                    simulation.kick(np.full(8, 1e-6))
                    simulation.hold(np.full(8, 1e-4))
                if frame == 20:
                    simulation.set_gravity(Gravity(9.81, -0.5))
                simulation.advance()
                assert np.array_equal(simulation.angles[[*fixed]], angles[[*fixed]])
                assert not simulation.rates[[*fixed]].any()
                assert abs(simulation.energy_drift) <= largest_drift(simulation)
            assert (simulation.dissipated > 0) == (damping > 0)


def test_rates_of_an_energy_beyond_numbers_are_rejected():
    rates = np.array([0.0, 0.0, -1e300, 0.0])
    with pytest.raises(ValueError, match=r'rate of rotor 2 = -1e\+300 rad/s gives an energy'):
        ElasticSimulation(Chain(4), np.zeros(4), rates)


def test_torques_of_springs_are_those_of_the_chain():
    for example in CLASSES:
        simulation = shaken(example)
        simulation.advance()
        expected = simulation.chain.spring_torques(simulation.angles)
        assert np.array_equal(simulation.link_torques, expected)
        assert np.abs(expected).max() > 0


def test_the_solver_restarts_once_per_frame_for_any_number_of_commands(monkeypatch):
    starts = []

    class Counted(DOP853):
        def __init__(self, *arguments: object, **others: object) -> None:
            starts.append(simulation.frame)
            super().__init__(*arguments, **others)

    monkeypatch.setitem(INTEGRATORS, 'symplectic', Counted)
    simulation = shaken(FLIPPER)
    simulation.advance()
    for torque in range(1, 6):
        simulation.kick(np.full(8, 1e-6))
        simulation.hold(np.full(8, 1e-5 * torque))
        simulation.set_gravity(Gravity(9.81, 0.1 * torque))
    simulation.advance()
    simulation.advance()
    assert starts == [0, 1]
