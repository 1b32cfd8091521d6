# SPDX-License-Identifier: Apache-2.0
"""Energies, topology and edge rotors of a state against closed forms."""

import dataclasses
import math

import numpy as np
import pytest
from chains import CLASSES, EXAMPLES, FLIPPER, SPINNER, WIDE_FLIPPER, WOBBLER, chain_of
from continuum_theories import WIDEST_FLIPPER, theory_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from sampled_orbit import closed_orbit

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.estimation.state_report import (
    EXACT,
    ArcRate,
    EdgeRotors,
    Energies,
    FrameErrors,
    StateReporter,
    Topology,
    energy_reach,
)
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linear.statics import length_rounding
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.solitons.continuum import FlipperTheory
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage.solitons.tanh_fit import topological_charge

ROTORS = 60
TOGGLED = ((False, False), (False, True), (True, True), (True, False))
PLACES = st.floats(5, ROTORS - 6)
ANY_EXAMPLE = st.sampled_from(EXAMPLES)
BOTH = (False, True)


def energies(
    chain: Chain,
    angles: Array,
    rates: Array | ArcRate | None,
    sites: ArrayLike,
    errors: FrameErrors = EXACT,
) -> Energies:
    return StateReporter(chain).report(angles, sites, rates, errors).energies


def topology(chain: Chain, angles: Array, sites: ArrayLike) -> Topology:
    found = StateReporter(chain).report(angles, sites).topology
    assert found is not None
    return found


def edge_rotors(chain: Chain, angles: Array) -> EdgeRotors:
    return StateReporter(chain).report(angles, math.nan).edge_rotors


def rounding_of_energies(chain: Chain) -> float:
    return chain.number_of_rotors * float(chain.stiffnesses.max()) * length_rounding(chain) ** 2


@settings(deadline=None)
@given(ANY_EXAMPLE, st.integers(0, 10**6), st.lists(PLACES, max_size=3))
def test_energies_sum_to_the_total_for_any_walls(example, seed, sites):
    random = np.random.default_rng(seed)
    chain = chain_of(example, ROTORS)
    angles, rates = random.uniform(-3, 3, ROTORS), random.standard_normal(ROTORS)
    found = energies(chain, angles, rates, sites)
    whole = float(chain.elastic_energy(angles) + chain.kinetic_energy(rates))
    assert found.kinetic == pytest.approx(float(chain.kinetic_energy(rates)))
    assert found.elastic == pytest.approx(float(chain.elastic_energy(angles)))
    assert found.whole == pytest.approx(whole)
    assert found.wall + found.wake == pytest.approx(whole)
    assert found.wall > -1e-9 * whole
    if not sites:
        assert found.wake == pytest.approx(whole)


@settings(deadline=None, max_examples=30)
@given(ANY_EXAMPLE, PLACES, st.sampled_from([0, 1]))
def test_a_free_wall_at_rest_has_no_energy(example, site, leg):
    chain = chain_of(example, ROTORS)
    found = energies(chain, static_wall(chain, site, leg), np.zeros(ROTORS), site)
    assert found.kinetic == found.kinetic_wake == 0
    assert 0 <= found.elastic_wake <= found.elastic <= rounding_of_energies(chain)


def test_a_moving_wall_of_the_continuum_has_its_energy_in_the_wall():
    for share in [0.2, 0.5, 0.8]:
        chain = chain_of(WIDEST_FLIPPER, 200)
        theory = FlipperTheory(chain, exact_sound=False)
        velocity = share * theory.speed_of_sound
        angles, rates = theory.state(99.3 * chain.spacing, velocity)
        found = energies(chain, angles, rates, 99.3)
        # The theory holds for small d, with errors of order d.
        assert found.wall == pytest.approx(theory.energy(velocity), rel=chain.lean_ratio / 2)
        assert found.kinetic == pytest.approx(theory.kinetic_energy(velocity), rel=0.02)
        assert abs(found.wake) < 1e-4 * found.wall


@pytest.mark.parametrize('example', CLASSES)
def test_a_moving_wall_without_radiation_has_no_wake(example):
    chain = chain_of(example, ROTORS)
    angles = static_wall(chain, 29.6)
    rates = 0.3 * mode_towards_last(chain, angles)
    found = energies(chain, angles, rates, 29.6)
    assert found.kinetic == pytest.approx(0.5 * chain.moment_of_inertia * 0.09)
    # The reach contains all but e^-16 of the squares of the zero mode.
    assert 0 <= found.kinetic_wake < math.exp(-16) * found.kinetic
    assert math.isnan(energies(chain, angles, None, 29.6).whole)
    assert math.isnan(energies(chain, angles, None, 29.6).wake)
    assert energies(chain, angles, None, 29.6).elastic_wake == found.elastic_wake


def test_an_added_wake_has_its_energy():
    for example in [WIDE_FLIPPER, FLIPPER, WOBBLER, SPINNER]:
        chain = chain_of(example, 80)
        site = 60.4
        angles, rates = static_wall(chain, site), np.zeros(80)
        rates[5:15] = 0.4
        angles[20] += 0.01
        stretched = 0.5 * chain.stiffness * chain.spring_extensions(angles)[19:21] ** 2
        planted = 10 * 0.5 * chain.moment_of_inertia * 0.16 + float(stretched.sum())
        assert site - energy_reach(chain) > 21
        found = energies(chain, angles, rates, site)
        assert found.wake == pytest.approx(planted, rel=1e-9)
        assert abs(found.wall) < 1e-9 * planted
        assert energies(chain, angles, rates, [site, 10.0, 20.0]).wake < planted


@pytest.mark.parametrize('example', [WIDE_FLIPPER, WOBBLER, SPINNER])
def test_noisy_energies_are_unbiased_with_the_stated_deviation(example):
    random, count, noise, rate_noise = np.random.default_rng(3), 400, 0.05, 0.2
    chain = chain_of(example, ROTORS)
    angles = static_wall(chain, 29.7)
    rates = 3 * mode_towards_last(chain, angles)
    truth = energies(chain, angles, rates, 29.7)
    errors = []
    for _ in range(count):
        noisy = angles + noise * random.standard_normal(ROTORS)
        noisy_rates = rates + rate_noise * random.standard_normal(ROTORS)
        found = energies(chain, noisy, noisy_rates, 29.7, FrameErrors(noise, rate_noise))
        kinetic = (found.kinetic - truth.kinetic) / found.kinetic_deviation
        errors.append((kinetic, (found.elastic - truth.elastic) / found.elastic_deviation))
    # The estimated deviations scatter by a tenth, and the curvature of lengths adds terms of
    # order noise^2.
    assert np.mean(errors, axis=0) == pytest.approx(0, abs=4 / math.sqrt(count) + 0.1)
    assert np.std(errors, axis=0) == pytest.approx(1, abs=0.25)


@settings(deadline=None, max_examples=40)
@given(ANY_EXAMPLE, PLACES, st.sampled_from([0, 1]), st.booleans())
def test_winding_numbers_of_the_two_sides_differ_by_the_charge(example, site, leg, turned):
    chain = chain_of(example, ROTORS)
    state = static_wall(chain, site, leg, turned)
    found = topology(chain, state, site)
    assert found.charge == topological_charge(chain, state) == 1
    assert found.winding_numbers[1] - found.winding_numbers[0] == found.charge
    assert found.polarisations[0] > 0 > found.polarisations[1]


def test_periodic_ends_have_no_topology_of_two_sides():
    ring = dataclasses.replace(chain_of(FLIPPER, 20), periodic=True)
    assert StateReporter(ring).report(ring.uniform_state(1), math.nan).topology is None


@given(ANY_EXAMPLE, st.integers(0, 10**6), st.floats(0, 59), st.integers(1, 29))
def test_the_wake_of_a_ring_does_not_depend_on_its_cut(example, seed, site, cells):
    random = np.random.default_rng(seed)
    ring = dataclasses.replace(chain_of(example, ROTORS), periodic=True)
    angles, rates = random.uniform(-3, 3, ROTORS), random.standard_normal(ROTORS)
    here = energies(ring, angles, rates, site)
    there = energies(
        ring, np.roll(angles, 2 * cells), np.roll(rates, 2 * cells), (site + 2 * cells) % ROTORS
    )
    assert there == pytest.approx(here)


def test_an_anti_kink_has_the_opposite_topology():
    for example in [WIDEST_FLIPPER, WIDE_FLIPPER, FLIPPER, SPINNER]:
        chain = chain_of(example, 2 * ROTORS)
        angles, _ = theory_of(chain).state(ROTORS * chain.spacing, charge=-1)
        found = topology(chain, angles, ROTORS)
        assert (found.charge, found.winding_numbers) == (-1, (1, 0))


def test_a_uniform_state_has_one_winding_number_and_its_mode_at_an_edge():
    for example in EXAMPLES:
        for sites in [math.nan, [], 0.0, ROTORS - 1.0]:
            for lean in [-1, 1]:
                chain = chain_of(example, ROTORS)
                found = topology(chain, chain.uniform_state(lean), sites)
                assert found.charge == 0
                assert found.winding_numbers == ((1, 1) if lean < 0 else (0, 0))
                assert found.polarisations == pytest.approx((lean, lean), abs=1e-6)
                # sum_n n x^n / sum_n x^n = x / (1 - x) of the squares x = e^(-2 a / ell).
                square = math.exp(-2 * chain.spacing / penetration_depth(chain))
                from_edge = square / (1 - square)
                assert found.mode_centre == pytest.approx(
                    from_edge if lean < 0 else ROTORS - 1 - from_edge, abs=1e-6
                )


def test_the_zero_mode_is_centred_at_the_wall():
    for example in EXAMPLES:
        chain = chain_of(example, ROTORS)
        middle = (ROTORS - 1) / 2
        assert topology(chain, static_wall(chain, middle), middle).mode_centre == pytest.approx(
            middle, abs=1e-3
        )


@pytest.mark.parametrize('example', EXAMPLES)
def test_edge_rotors_agree_with_the_leg(example):
    for rotors in [ROTORS, ROTORS + 1]:
        for turned in BOTH:
            chain = chain_of(example, rotors)
            if chain.motion is Motion.SPINNER:
                found = edge_rotors(chain, static_wall(chain, 30.2, 0, turned))
                assert found.toggled is None
                ahead = (found.turns[1] - found.turns[0]) % 1
                assert ahead == pytest.approx(0.5, abs=1e-3)
                return
            for leg, toggled in enumerate(TOGGLED):
                found = edge_rotors(chain, static_wall(chain, 30.2, leg, turned))
                assert found.toggled == toggled
                assert np.isnan(found.turns).all()


def test_edge_rotors_of_a_spinner_count_the_turns_that_a_cycle_makes():
    chain = chain_of(SPINNER, 8)
    orbit = closed_orbit(chain, chain.uniform_state(-1)).angles
    before, after = (edge_rotors(chain, angles).turns for angles in (orbit[0], orbit[-1]))
    assert np.abs(np.subtract(after, before)) == pytest.approx(1, abs=1e-9)
    assert before == pytest.approx((0, 0), abs=1e-12)


@settings(deadline=None, max_examples=30)
@given(ANY_EXAMPLE, PLACES, st.integers(0, 10**6))
def test_reports_obey_mirror_and_time_symmetry(example, site, seed):
    random = np.random.default_rng(seed)
    chain = chain_of(example, ROTORS)
    angles = static_wall(chain, site) + 0.01 * random.standard_normal(ROTORS)
    rates = random.standard_normal(ROTORS)
    mirrored, there = -angles[::-1], ROTORS - 1 - site
    here = energies(chain, angles, rates, site)
    for image in (
        energies(chain, mirrored, -rates[::-1], there),
        energies(chain, angles, -rates, site),
        energies(chain, np.pi - angles, -rates, site),
    ):
        assert image == pytest.approx(here, rel=1e-6)
    found, image = topology(chain, angles, site), topology(chain, mirrored, there)
    assert image.charge == found.charge
    assert image.polarisations == pytest.approx([-each for each in found.polarisations[::-1]])
    assert image.mode_centre == pytest.approx(ROTORS - 1 - found.mode_centre, abs=1e-6)
    assert image.winding_numbers == tuple(1 - each for each in found.winding_numbers[::-1])


def test_invalid_angles_and_rates_are_rejected():
    chain = chain_of(FLIPPER, ROTORS)
    for angles, message in [
        (np.zeros(3), r'angles of shape \(3,\) do not fit a chain of 60 rotors'),
        (np.where(np.arange(60) == 7, math.nan, 0.0), 'angle of rotor 7 = nan must be a finite'),
        (chain.uniform_state(1)[None], r'angles of shape \(1, 60\) do not fit'),
    ]:
        with pytest.raises(ValueError, match=message):
            StateReporter(chain).report(angles, 30.0)
    with pytest.raises(ValueError, match='rate of rotor 3 = nan must be a finite number'):
        energies(chain, chain.uniform_state(1), np.where(np.arange(60) == 3, np.nan, 0.0), 30.0)


@pytest.mark.parametrize('example', CLASSES)
def test_the_rate_of_the_arc_gives_the_kinetic_energy_on_the_orbit(example):
    chain = chain_of(example, ROTORS)
    angles = static_wall(chain, 29.6)
    by_rotors = energies(chain, angles, 3.0 * mode_towards_last(chain, angles), 29.6)
    by_arc = energies(chain, angles, ArcRate(-3.0), 29.6)
    assert by_arc.kinetic == pytest.approx(by_rotors.kinetic)
    assert by_arc.kinetic_deviation < rounding_of_energies(chain)
    assert math.isnan(by_arc.kinetic_wake)
    assert math.isnan(by_arc.wake)
    assert by_arc.elastic_wake == by_rotors.elastic_wake


@pytest.mark.parametrize('example', CLASSES)
def test_elastic_energy_of_phonons_adds_to_the_kinetic_energy(example):
    random, chain = np.random.default_rng(3), chain_of(example, ROTORS)
    angles, mixing = static_wall(chain, 29.6), 20 * chain.time_unit
    errors = []
    for _ in range(6):
        rates = 0.02 / chain.time_unit * random.standard_normal(ROTORS)
        motion = simulate(chain, angles, rates, 3 * mixing, mixing)
        for seen, moving in zip(motion.angles[1:], motion.rates[1:], strict=True):
            along = float(mode_towards_last(chain, seen) @ moving)
            found = energies(chain, seen, ArcRate(along), 29.6)
            truth = float(chain.kinetic_energy(moving))
            errors.append((found.kinetic - truth) / found.kinetic_deviation)
    assert abs(np.mean(errors)) < 0.3
    assert max(map(abs, errors)) < 1


@pytest.mark.parametrize('rate', [0.0, 0.5, 5.0])
def test_an_uncertain_rate_of_the_arc_leaves_the_kinetic_energy_unbiased(rate):
    random, chain = np.random.default_rng(7), chain_of(FLIPPER, ROTORS)
    angles, reporter = static_wall(chain, 29.6), StateReporter(chain)
    truth = 0.5 * chain.moment_of_inertia * rate**2
    found = [
        reporter.report(angles, 29.6, ArcRate(rate + each, 1.0)).energies
        for each in random.standard_normal(4000)
    ]
    errors = np.array([each.kinetic for each in found]) - truth
    stated = np.array([each.kinetic_deviation for each in found])
    assert abs(float(errors.mean())) < 4 * float(errors.std()) / math.sqrt(4000)
    # The square of a rate below its noise is clipped at 0.
    assert 0.95 < float(np.sqrt(np.mean(stated**2))) / float(errors.std()) < 1.6


@pytest.mark.parametrize('example', [WIDE_FLIPPER, WOBBLER, SPINNER])
def test_unseen_rotors_increase_the_deviation_of_energies(example):
    random, noise, rate_noise = np.random.default_rng(11), 0.01, 0.2
    chain = chain_of(example, ROTORS)
    orbit = static_wall(chain, 29.7)
    moving = 3 * mode_towards_last(chain, orbit)
    angles = orbit + noise * random.standard_normal(ROTORS)
    rates = moving + rate_noise * random.standard_normal(ROTORS)
    errors = FrameErrors(noise, rate_noise)
    seen = energies(chain, angles, rates, 29.7, errors)
    none = energies(chain, angles, rates, 29.7, errors._replace(unseen=np.zeros(ROTORS, bool)))
    assert none == pytest.approx(seen)
    unseen = np.zeros(ROTORS, bool)
    unseen[[25, 26, 40]] = True
    filled = np.where(unseen, orbit, angles), np.where(unseen, moving, rates)
    doubts = [
        energies(chain, *filled, 29.7, FrameErrors(noise, rate_noise, persistent, unseen))
        for persistent in (0.0, 0.02)
    ]
    _, first, second = chain.springs(filled[0])
    squares = first[[25, 26, 40]] ** 2 + second[[24, 25, 39]] ** 2
    for found, persistent in zip(doubts, (0.0, 0.02), strict=True):
        hidden = 0.5 * chain.stiffness * float(squares.sum()) * (noise**2 + persistent**2)
        assert found.elastic_deviation > hidden
        assert found.kinetic_deviation > 1.5 * chain.moment_of_inertia * rate_noise**2
    assert doubts[1].elastic_deviation > doubts[0].elastic_deviation


def test_unseen_rotors_leave_the_other_energies_unbiased():
    random, noise, count = np.random.default_rng(13), 0.02, 400
    chain = chain_of(WOBBLER, ROTORS)
    orbit, unseen = static_wall(chain, 29.7), np.arange(ROTORS) % 3 == 0
    errors, reporter = FrameErrors(noise, unseen=unseen), StateReporter(chain)
    found = []
    for _ in range(count):
        angles = orbit + np.where(unseen, 0.0, noise) * random.standard_normal(ROTORS)
        found.append(reporter.report(angles, 29.7, None, errors).energies.elastic)
    mean = float(np.mean(found)), 4 * float(np.std(found)) / math.sqrt(count)
    one_rotor = 0.5 * chain.stiffness * float((chain.springs(orbit)[1] ** 2).max())
    # The curvature of lengths adds terms of order noise^2.
    assert abs(mean[0]) < mean[1] + 0.05 * one_rotor * noise**2
