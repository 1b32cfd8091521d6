# SPDX-License-Identifier: Apache-2.0
"""Walls of the continuum theories compared with the chain: at rest, in equilibrium, simulated."""

import dataclasses
import math
from itertools import product

import numpy as np
import pytest
from chains import SPINNER, WIDE_SPINNER, chain_of
from continuum_theories import WIDEST_FLIPPER, Theory, theory_of
from linkage_motion import distance, wall_between

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linear.statics import equilibrium
from soliton_linkage.linkage.chain import Array, displacement, staggered
from soliton_linkage.solitons.continuum import FlipperTheory, SpinnerTheory
from soliton_linkage.solitons.static_wall import site_arc
from soliton_linkage.solitons.tanh_fit import (
    charge_of_field,
    find_solitons,
    half_turns,
    topological_charge,
)


def test_flippers_lean_right_before_a_wall_of_charge_1_and_left_after_it():
    for charge in [-1, 1]:
        for sense in [-1, 1]:
            chain = chain_of(WIDEST_FLIPPER, 200)
            theory = FlipperTheory(chain)
            middle, velocity = 100 * chain.spacing, sense * 0.5 * theory.speed_of_sound
            angles, rates = theory.state(middle, velocity, charge)
            later, _ = theory.state(middle + velocity * 1e-6, velocity, charge)
            assert (later - angles) / 1e-6 == pytest.approx(
                rates, rel=0, abs=1e-5 * abs(rates).max()
            )
            assert angles[:10] == pytest.approx(chain.uniform_state(charge)[:10], abs=1e-6)
            assert angles[-10:] == pytest.approx(chain.uniform_state(-charge)[-10:], abs=1e-6)
            assert topological_charge(chain, angles) == charge
            field_charge = charge_of_field(displacement(chain, angles), theory.lean)
            assert field_charge == pytest.approx(charge, abs=1e-6)


def test_spinners_turn_by_half_a_turn_across_a_wall():
    signs, examples = (-1, 1), (SPINNER, WIDE_SPINNER)
    for sense, family, turn, charge, example in product(signs, signs, signs, signs, examples):
        chain = chain_of(example, 60)
        theory = SpinnerTheory(chain, family=family)
        middle, velocity = 30 * chain.spacing, sense * 0.3 * theory.speed_of_sound
        angles, rates = theory.state(middle, velocity, charge, turn)
        later, _ = theory.state(middle + velocity * 1e-6, velocity, charge, turn)
        limit = 1e-4 * abs(rates).max()
        assert (later - angles) / 1e-6 == pytest.approx(rates, rel=0, abs=limit)
        for sublattice in (0, 1):
            positions = chain.spacing * np.arange(60)[sublattice::2]
            wall = sublattice, middle, velocity, charge, turn
            expected = theory.staggered_angles(positions, *wall)
            assert staggered(angles)[sublattice::2] == pytest.approx(expected)
        for image in (angles, -angles[::-1], angles + 4 * np.pi):
            assert topological_charge(chain, image) == charge
            assert half_turns(chain, image) == charge * turn
        soliton = find_solitons(chain, angles, rates)[0]
        assert (soliton.charge, math.copysign(1, soliton.velocity)) == (charge, sense)


def test_extensions_of_a_flipper_wall_agree_with_the_chain():
    for charge, fraction in [(-1, 0.0), (-1, 0.6), (1, 0.6)]:
        errors = []
        for rest_angle in (0.1, 0.05):
            chain = chain_of((0.5, rest_angle), 401)
            theory = FlipperTheory(chain, exact_sound=False)
            velocity = fraction * theory.speed_of_sound
            angles, _ = theory.state(200.3 * chain.spacing, velocity, charge)
            between = chain.spacing * (np.arange(400) + 0.5)
            expected = theory.extensions(between, 200.3 * chain.spacing, velocity, charge)
            found = chain.spring_extensions(angles)
            errors.append(np.abs(found - expected).max() / np.abs(expected).max())
            assert (expected * charge <= 0).all()
        # The continuum is exact to the second order in d.
        assert errors[0] < 3 * FlipperTheory(chain_of((0.5, 0.1), 3)).chain.lean_ratio ** 2
        assert errors[1] == pytest.approx(errors[0] / 4, rel=0.1)


def test_extensions_of_a_spinner_wall_agree_with_the_chain():
    for family in [-1, 1]:
        for turn in [-1, 1]:
            errors = []
            for ratio in (10.0, 20.0):
                chain = chain_of((ratio, 0.9), 401)
                theory = SpinnerTheory(chain, False, family)
                angles, _ = theory.state(200.3 * chain.spacing, 0.0, -1, turn)
                between = chain.spacing * (np.arange(400) + 0.5)
                expected = theory.extensions(between, 200.3 * chain.spacing, 0.0, -1, turn)
                expected = expected * (-1.0) ** np.arange(400)
                found = chain.spring_extensions(angles)
                errors.append(np.abs(found - expected).max() / np.abs(expected).max())
            # The continuum is exact to the first order in a / r.
            assert errors[0] < 0.3
            assert errors[1] == pytest.approx(errors[0] / 2, rel=0.1)


def pair_on_a_ring(rest_angle: float, rotors: int) -> tuple[FlipperTheory, Array]:
    """Equilibrium of a wall and an anti-kink at opposite sites of a ring with r / a = 0.5."""
    chain = dataclasses.replace(chain_of((0.5, rest_angle), rotors), periodic=True)
    theory = FlipperTheory(chain)
    positions = chain.spacing * np.arange(rotors)
    centres = chain.spacing * (rotors / 4 * np.array([1, 3]) - 0.5)
    first = theory.displacements(positions, centres[0])
    second = theory.displacements(positions, centres[1], charge=-1)
    displacements = np.where(np.arange(rotors) < rotors / 2, first, second)
    angles = staggered(np.arcsin(displacements / chain.rotor_length))
    return theory, equilibrium(chain, angles)


def test_the_energy_of_an_anti_kink_converges_to_the_theory_with_the_square_of_d():
    deficits = []
    for sine, rotors in ((0.025, 1200), (0.05, 600), (0.1, 300)):
        theory, angles = pair_on_a_ring(math.asin(sine), rotors)
        cost = float(theory.chain.elastic_energy(angles))
        deficits.append(1 - cost / theory.energy(0.0, -1))
    assert deficits[1] / deficits[0] == pytest.approx(4, rel=0.02)
    assert deficits[2] / deficits[1] == pytest.approx(4, rel=0.02)


def arc_of(example: tuple[float, float]) -> float:
    return site_arc(chain_of(example, 3)) * example[0]


def kicked(
    example: tuple[float, float], rotors: int, kick: float, since: float, until: float
) -> tuple[Theory, float, float, float, float]:
    """Wall that a kick of the edge set going: its theory, speed, width, energies in the whole.

    The kick is in units of a over the time unit, and the wall is measured between two times in
    time units.
    """
    chain = chain_of(example, rotors)
    unit = chain.time_unit
    start = chain.uniform_state(-1)
    rates = mode_towards_last(chain, start) * kick / (example[0] * unit)
    recording = simulate(chain, start, rates, until * unit, (until - since) / 20 * unit, 1e-9)
    late = recording.times >= since * unit
    frames = list(zip(recording.angles[late], recording.rates[late], strict=True))
    walls = [find_solitons(chain, angles, moving)[0] for angles, moving in frames]
    positions = [wall.position for wall in walls]
    speed = float(np.polyfit(recording.times[late], positions, 1)[0])
    springs = float(np.mean([chain.elastic_energy(angles) for angles, _ in frames]))
    motion = float(np.mean([chain.kinetic_energy(moving) for _, moving in frames]))
    width = float(np.mean([wall.width for wall in walls]))
    return theory_of(chain), speed, width, springs, motion


@pytest.mark.parametrize(
    ('example', 'kick', 'since', 'until', 'limits'),
    [
        (WIDEST_FLIPPER, 0.006, 200, 400, (0.005, 0.01)),
        (WIDEST_FLIPPER, 0.016, 100, 200, (0.005, 0.01)),
        (WIDE_SPINNER, 0.2, 200, 500, (0.01, 0.04)),
        (WIDE_SPINNER, 1, 50, 100, (0.01, 0.04)),
    ],
)
def test_a_kick_creates_a_boosted_wall(example, kick, since, until, limits):
    flipper = example == WIDEST_FLIPPER
    theory, speed, width, springs, motion = kicked(
        example, 150 if flipper else 50, kick, since, until
    )
    given = kick * theory.chain.spacing / theory.chain.time_unit
    arc = None if flipper else arc_of(example)
    assert theory.speed_after_kick(given, arc) == pytest.approx(speed, rel=limits[0])
    # The width of this spinner's wall at rest is 0.975 of that in the continuum.
    scale = 1.0 if flipper else 0.975
    assert scale * theory.width(speed) == pytest.approx(width, rel=0.015)
    assert theory.energy(speed) == pytest.approx(springs + motion, rel=limits[1])
    if flipper:
        ratio = theory.elastic_energy(speed) / theory.kinetic_energy(speed)
        assert ratio == pytest.approx(springs / motion, rel=0.03)


def test_the_exact_speed_of_sound_fits_a_fast_flipper_better_than_its_limit():
    theory, speed, _, springs, motion = kicked(WIDEST_FLIPPER, 150, 0.016, 100, 200)
    limiting = dataclasses.replace(theory, exact_sound=False)
    kick = 0.016 * theory.chain.spacing / theory.chain.time_unit
    arc = arc_of(WIDEST_FLIPPER)
    errors = [
        abs(candidate.speed_after_kick(kick, arc) / speed - 1) for candidate in (theory, limiting)
    ]
    assert errors[0] < errors[1] / 3
    whole = springs + motion
    errors = [abs(candidate.energy(speed) / whole - 1) for candidate in (theory, limiting)]
    assert errors[0] < errors[1] / 3
    # A boosted wall that moves freely keeps the width of the theory.
    angles, rates = theory.state(45 * theory.chain.spacing, speed)
    later = simulate(theory.chain, angles, rates, 100 * theory.chain.time_unit, 1.0, 1e-9)
    (wall,) = find_solitons(theory.chain, later.angles[-1], later.rates[-1])
    errors = [
        abs(candidate.width(wall.velocity) / wall.width - 1) for candidate in (theory, limiting)
    ]
    assert errors[0] < errors[1] * 0.75
    assert errors[0] < 0.01


def test_the_exact_wall_between_two_spinners_converges_to_the_theory():
    for turn in [-1, 1]:
        for family in [-1, 1]:
            errors = []
            for ratio in (8.0, 16.0, 32.0):
                # In the first family the masses beside the wall have crossed where it turns
                # backwards.
                chain = chain_of((ratio, 0.9), round(40 * ratio))
                rotor = chain.number_of_rotors // 2 - 1
                wall = wall_between(chain, rotor, family > 0, family * turn < 0)
                theory = SpinnerTheory(chain, family=family)
                angles, _ = theory.state((rotor + 0.5) * chain.spacing, 0.0, 1, turn)
                errors.append(distance(angles, wall))
                assert half_turns(chain, wall) == half_turns(chain, angles) == turn
            assert errors[0] < 0.01
            assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
            assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)
