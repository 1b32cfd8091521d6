# SPDX-License-Identifier: Apache-2.0
"""Free motion agrees with the simulation, and its sensitivities with differences."""

import math
from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, read, unequal
from scipy.integrate import solve_ivp

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.identification.free_motion import (
    FreeMotion,
    angles_at,
    states_with_sensitivities,
)
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.lengths import chain_lengths
from soliton_linkage.identification.readings import Readings
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.linkage.gravity import Gravity

PERIOD = 0.004
GRAVITY = Gravity(1.0, 0.3)
DAMPING, FRICTION = 5e-4, 4e-3
"""Over the mean mass [m^2/s], [m^2/s^2]."""


def kicked(rotors: int, speed: float, duration: float) -> tuple[Chain, Array, Array, FreeMotion]:
    """Chain with different springs, times and angles after a kick, and the same motion."""
    chain = unequal(replace(FLIPPER, number_of_rotors=rotors), 7)
    drawn = drawn_deviations(rotors, 5, mass=0.05, stiffness=0.05)
    chain = replace(chain, deviations=chain.deviations.joined(drawn))
    start = leaning(chain, -1).angles
    rates = speed * edge_mode(chain, start, Edge.FIRST)
    record = simulate(chain, start, rates, duration, PERIOD)
    masses = chain.masses.mean()
    motion = FreeMotion(
        chain_lengths(chain), chain.stiffnesses / masses, chain.masses / masses, 0.0, start, rates
    )
    return chain, record.times, record.angles, motion


def pulled(chain: Chain, motion: FreeMotion, times: Array) -> Array:
    """Angles of a motion under gravity and drag, integrated by scipy."""
    mass = chain.masses.mean()

    def derivative(_: float, state: Array) -> Array:
        angles, rates = np.split(state, 2)
        torques = chain.spring_torques(angles) + GRAVITY.torques(chain, angles)
        torques -= mass * (DAMPING * rates + FRICTION * np.tanh(rates / 0.1))
        return np.concatenate([rates, torques / chain.moments_of_inertia])

    begin = np.concatenate([motion.angles, motion.rates])
    motion = solve_ivp(derivative, times[[0, -1]], begin, t_eval=times, rtol=1e-8, atol=1e-8)
    return np.asarray(motion.y[: len(chain.masses)].T)


def test_free_motion_agrees_with_the_simulation():
    _, times, angles, motion = kicked(6, 10.0, 0.5)
    assert np.abs(angles_at(motion, times) - angles).max() < 1e-4


def test_the_bound_of_the_frequencies_holds_for_springs_along_the_motion_of_both_masses():
    # Springs along the motion of both masses act as a chain of masses and springs.
    _, _, _, motion = kicked(40, 10.0, 0.01)
    inverse = motion.masses**-0.5
    matrix = np.zeros((40, 40))
    for n, stiffness in enumerate(motion.stiffnesses):
        pair = inverse[n : n + 2] * (1, -1)
        matrix[n : n + 2, n : n + 2] += stiffness * np.outer(pair, pair)
    fastest = math.sqrt(np.linalg.eigvalsh(matrix)[-1])
    simplest = 2 * math.sqrt(motion.stiffnesses.max() / motion.masses.min())
    assert fastest < motion.fastest < simplest


def test_gravity_and_drag_agree_with_their_equation():
    chain, times, _, motion = kicked(5, 10.0, 0.3)
    drag = {'damping': DAMPING, 'friction': FRICTION}
    falling = replace(motion, gravity=GRAVITY.acceleration, tilt=GRAVITY.tilt, **drag)
    assert np.abs(angles_at(falling, times) - pulled(chain, motion, times)).max() < 1e-4


def test_motion_is_the_same_in_normalised_units():
    _, times, _, motion = kicked(6, 12.0, 0.1)
    drag = {'damping': 1.3 * DAMPING, 'friction': 1.3 * FRICTION}
    others = {'gravity': GRAVITY.acceleration, 'tilt': GRAVITY.tilt, 'masses': 1.3 * motion.masses}
    motion = replace(motion, **drag, **others)
    same = motion.normalised()
    assert same.masses.mean() == pytest.approx(1)
    assert same.lengths.spacings.mean() == pytest.approx(1)
    np.testing.assert_allclose(angles_at(same, times), angles_at(motion, times), atol=1e-10)


def test_sensitivities_agree_with_differences():
    _, times, _, motion = kicked(5, 10.0, 0.12)
    motion = replace(motion, damping=1e-3, friction=5e-3, gravity=5.0, tilt=0.3)
    changes = list(states_with_sensitivities(motion, times))[-1][1][:, -1]
    for unknown in range(motion.size):
        step = np.zeros(motion.size)
        step[unknown] = 1e-5
        ends = [angles_at(motion.changed(sign * step), times)[-1] for sign in (1, -1)]
        numeric = (ends[0] - ends[1]) / 2e-5
        # A step may fall into one more of the integration, which is good to 1e-7 here.
        np.testing.assert_allclose(numeric, changes[unknown], atol=0.02)


def test_masses_stiffnesses_and_drag_of_strained_springs_are_identified():
    chain, times, _, motion = kicked(8, 10.0, 1.0)
    readings, _ = read(pulled(chain, motion, times), 2)
    recorded = Readings(times, readings, gravity=GRAVITY)
    found = identify(recorded, Chain(spacing=0.15), tolerance=0.05, spacing_known=False)
    assert not found.rigid
    scale = math.log(found.chain.spacings.mean() / chain.spacings.mean())
    assert abs(scale) < 3 * found.spacing_deviation < 0.3
    unit = found.chain.masses.mean() * (found.chain.spacing / chain.spacings.mean()) ** 2
    for shown, deviation, true in (
        (found.chain.damping, found.damping_deviation, DAMPING),
        (found.friction, found.friction_deviation, FRICTION),
    ):
        assert abs(shown - true * unit) < 3 * deviation
    assert found.friction > 3 * found.friction_deviation
    assert math.isnan(found.mass_deviation)
    names = {
        'rotor_length': chain.rotor_lengths / chain.spacings.mean(),
        'spacing': chain.spacings / chain.spacings.mean(),
        'mass': chain.masses / chain.masses.mean(),
        'stiffness': chain.stiffnesses / chain.masses.mean(),
    }
    shown = {
        'rotor_length': found.chain.rotor_lengths / found.chain.spacings.mean(),
        'spacing': found.chain.spacings / found.chain.spacings.mean(),
        'mass': found.chain.masses / found.chain.masses.mean(),
        'stiffness': found.chain.stiffnesses / found.chain.masses.mean(),
    }
    for name, true in names.items():
        errors = (shown[name] / true - 1) / found.deviations[name]
        assert np.sqrt(np.mean(errors**2)) < 1.8, name
