# SPDX-License-Identifier: Apache-2.0
"""Energies, topology, edge rotors, wobble and width of a state against closed forms."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, SPINNER, STRONG_WOBBLER, WIDE_FLIPPER, WOBBLER, chain_of
from continuum_theories import WIDEST_FLIPPER, theory_of
from hypothesis import given, settings
from hypothesis import strategies as st
from linkage_motion import closed_orbit
from scipy.optimize import brentq

from soliton_linkage.bands import couplings, penetration_depth
from soliton_linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.continuum import FlipperTheory, topological_charge
from soliton_linkage.cycle import Cycle
from soliton_linkage.elastic_simulation import simulate
from soliton_linkage.rigidity import mode_towards_last
from soliton_linkage.soliton import find_solitons
from soliton_linkage.state_report import (
    Wobble,
    edge_rotors,
    energies,
    energy_reach,
    topology,
    wall_at,
    wall_on_cycle,
    width,
    wobble,
)
from soliton_linkage.static_wall import site_arc, static_wall
from soliton_linkage.statics import length_rounding

ROTORS = 60
WOBBLERS = (WOBBLER, STRONG_WOBBLER)
TOGGLED = ((False, False), (False, True), (True, True), (True, False))
PLACES = st.floats(5, ROTORS - 6)
ANY_EXAMPLE = st.sampled_from(EXAMPLES)
BOTH = (False, True)


def ratio_of(chain: Chain) -> float:
    return (1 - chain.lean_ratio) / (1 + chain.lean_ratio)


def flat(wobbling: Wobble) -> list[float]:
    """All numbers of a wobble in a row."""
    return np.hstack(dataclasses.astuple(wobbling)).tolist()


def rounding_of_energies(chain: Chain) -> float:
    return chain.number_of_rotors * float(chain.stiffnesses.max()) * length_rounding(chain) ** 2


@settings(deadline=None)
@given(ANY_EXAMPLE, st.integers(0, 10**6), st.lists(PLACES, max_size=3))
def test_energies_sum_to_the_whole_wherever_walls_are_said_to_be(
    example: tuple[float, float], seed: int, places: list[float]
) -> None:
    random = np.random.default_rng(seed)
    chain = chain_of(example, ROTORS)
    angles, rates = random.uniform(-3, 3, ROTORS), random.standard_normal(ROTORS)
    found = energies(chain, angles, rates, places)
    whole = float(chain.elastic_energy(angles) + chain.kinetic_energy(rates))
    assert found.kinetic == pytest.approx(float(chain.kinetic_energy(rates)))
    assert found.elastic == pytest.approx(float(chain.elastic_energy(angles)))
    assert found.whole == pytest.approx(whole)
    assert found.wall + found.wake == pytest.approx(whole)
    assert found.wall > -1e-9 * whole
    if not places:
        assert found.wake == pytest.approx(whole)


@settings(deadline=None, max_examples=30)
@given(ANY_EXAMPLE, PLACES, st.sampled_from([0, 1]))
def test_a_free_wall_at_rest_has_no_energy(
    example: tuple[float, float], place: float, leg: int
) -> None:
    chain = chain_of(example, ROTORS)
    found = energies(chain, static_wall(chain, place, leg), np.zeros(ROTORS), place)
    assert found.kinetic == found.kinetic_wake == 0
    assert 0 <= found.elastic_wake <= found.elastic <= rounding_of_energies(chain)


@pytest.mark.parametrize('share', [0.2, 0.5, 0.8])
def test_a_moving_wall_of_the_continuum_has_its_energy_in_the_wall(share: float) -> None:
    chain = chain_of(WIDEST_FLIPPER, 200)
    theory = FlipperTheory(chain, exact_sound=False)
    velocity = share * theory.speed_of_sound
    angles, rates = theory.state(99.3 * chain.spacing, velocity)
    found = energies(chain, angles, rates, 99.3)
    # The theory is the limit of small d; its terms of higher order are of order d.
    assert found.wall == pytest.approx(theory.energy(velocity), rel=chain.lean_ratio / 2)
    assert found.kinetic == pytest.approx(theory.kinetic_energy(velocity), rel=0.02)
    assert abs(found.wake) < 1e-4 * found.wall


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])
def test_a_moving_wall_that_radiates_nothing_leaves_nothing_behind(
    example: tuple[float, float],
) -> None:
    chain = chain_of(example, ROTORS)
    angles = static_wall(chain, 29.6)
    rates = 0.3 * mode_towards_last(chain, angles)
    found = energies(chain, angles, rates, 29.6)
    assert found.kinetic == pytest.approx(0.5 * chain.moment_of_inertia * 0.09)
    # Within reach are all but e^-16 of the squares of the zero mode.
    assert 0 <= found.kinetic_wake < math.exp(-16) * found.kinetic
    assert math.isnan(energies(chain, angles, None, 29.6).whole)
    assert math.isnan(energies(chain, angles, None, 29.6).wake)
    assert energies(chain, angles, None, 29.6).elastic_wake == found.elastic_wake


@pytest.mark.parametrize('example', [WIDE_FLIPPER, FLIPPER, WOBBLER, SPINNER])
def test_a_planted_wake_is_found_with_its_energy(example: tuple[float, float]) -> None:
    chain = chain_of(example, 80)
    place = 60.4
    angles, rates = static_wall(chain, place), np.zeros(80)
    rates[5:15] = 0.4
    angles[20] += 0.01
    stretched = 0.5 * chain.stiffness * chain.spring_extensions(angles)[19:21] ** 2
    planted = 10 * 0.5 * chain.moment_of_inertia * 0.16 + float(stretched.sum())
    assert place - energy_reach(chain) > 21
    found = energies(chain, angles, rates, place)
    assert found.wake == pytest.approx(planted, rel=1e-9)
    assert abs(found.wall) < 1e-9 * planted
    assert energies(chain, angles, rates, [place, 10.0, 20.0]).wake < planted


@pytest.mark.parametrize('noise', [0.01, 0.05])
@pytest.mark.parametrize('example', [WIDE_FLIPPER, WOBBLER, SPINNER])
def test_noise_leaves_energies_unbiased_with_the_deviation_that_they_state(
    example: tuple[float, float], noise: float
) -> None:
    random, count, rate_noise = np.random.default_rng(3), 400, 0.2
    chain = chain_of(example, ROTORS)
    angles = static_wall(chain, 29.7)
    rates = 3 * mode_towards_last(chain, angles)
    truth = energies(chain, angles, rates, 29.7)
    errors = []
    for _ in range(count):
        found = energies(
            chain,
            angles + noise * random.standard_normal(ROTORS),
            rates + rate_noise * random.standard_normal(ROTORS),
            29.7,
            noise,
            rate_noise,
        )
        errors.append(
            (
                (found.kinetic - truth.kinetic) / found.kinetic_deviation,
                (found.elastic - truth.elastic) / found.elastic_deviation,
            )
        )
    # Deviations are estimated from noise themselves, by a tenth off, and with them the mean; the
    # curvature of lengths adds terms of order noise^2.
    assert np.mean(errors, axis=0) == pytest.approx(0, abs=4 / math.sqrt(count) + 0.1)
    assert np.std(errors, axis=0) == pytest.approx(1, abs=0.25)


@settings(deadline=None, max_examples=40)
@given(ANY_EXAMPLE, PLACES, st.sampled_from([0, 1]), st.booleans())
def test_winding_numbers_of_the_two_sides_differ_by_the_charge(
    example: tuple[float, float], place: float, leg: int, turned: bool
) -> None:
    chain = chain_of(example, ROTORS)
    state = static_wall(chain, place, leg, turned)
    found = topology(chain, state, place)
    assert found.charge == topological_charge(chain, state) == 1
    assert found.winding_numbers[1] - found.winding_numbers[0] == found.charge
    assert found.polarisations[0] > 0 > found.polarisations[1]


def test_periodic_ends_have_no_topology_of_two_sides() -> None:
    ring = dataclasses.replace(chain_of(FLIPPER, 20), periodic=True)
    with pytest.raises(ValueError, match='a chain with periodic ends'):
        topology(ring, ring.uniform_state(1), math.nan)


@given(ANY_EXAMPLE, st.integers(0, 10**6), st.floats(0, 59), st.integers(1, 29))
def test_the_wake_of_a_ring_does_not_know_where_it_is_cut(
    example: tuple[float, float], seed: int, place: float, cells: int
) -> None:
    random = np.random.default_rng(seed)
    ring = dataclasses.replace(chain_of(example, ROTORS), periodic=True)
    angles, rates = random.uniform(-3, 3, ROTORS), random.standard_normal(ROTORS)
    here = energies(ring, angles, rates, place)
    there = energies(
        ring, np.roll(angles, 2 * cells), np.roll(rates, 2 * cells), (place + 2 * cells) % ROTORS
    )
    assert dataclasses.astuple(there) == pytest.approx(dataclasses.astuple(here))


@pytest.mark.parametrize('example', [WIDEST_FLIPPER, WIDE_FLIPPER, FLIPPER, SPINNER])
def test_an_anti_kink_has_the_opposite_topology(example: tuple[float, float]) -> None:
    chain = chain_of(example, 2 * ROTORS)
    angles, _ = theory_of(chain).state(ROTORS * chain.spacing, charge=-1)
    found = topology(chain, angles, ROTORS)
    assert (found.charge, found.winding_numbers) == (-1, (1, 0))


@pytest.mark.parametrize('lean', [-1, 1])
@pytest.mark.parametrize('places', [math.nan, [], 0.0, ROTORS - 1.0])
@pytest.mark.parametrize('example', EXAMPLES)
def test_a_uniform_state_has_one_winding_number_and_its_mode_at_an_edge(
    example: tuple[float, float], places: float | list[float], lean: int
) -> None:
    chain = chain_of(example, ROTORS)
    found = topology(chain, chain.uniform_state(lean), places)
    assert found.charge == 0
    assert found.winding_numbers == ((1, 1) if lean < 0 else (0, 0))
    assert found.polarisations == pytest.approx((lean, lean), abs=1e-6)
    # sum_n n x^n / sum_n x^n = x / (1 - x) of the squares x = e^(-2 a / ell).
    square = math.exp(-2 * chain.spacing / penetration_depth(chain))
    from_edge = square / (1 - square)
    assert found.mode_centre == pytest.approx(
        from_edge if lean < 0 else ROTORS - 1 - from_edge, abs=1e-6
    )


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_zero_mode_sits_at_the_wall(example: tuple[float, float]) -> None:
    chain = chain_of(example, ROTORS)
    middle = (ROTORS - 1) / 2
    assert topology(chain, static_wall(chain, middle), middle).mode_centre == pytest.approx(
        middle, abs=1e-3
    )


@pytest.mark.parametrize('turned', BOTH)
@pytest.mark.parametrize('rotors', [ROTORS, ROTORS + 1])
@pytest.mark.parametrize('example', EXAMPLES)
def test_edge_rotors_are_those_of_the_leg(
    example: tuple[float, float], rotors: int, turned: bool
) -> None:
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


def test_edge_rotors_of_a_spinner_count_the_turns_that_a_cycle_makes() -> None:
    chain = chain_of(SPINNER, 8)
    orbit = closed_orbit(chain)
    before, after = (edge_rotors(chain, angles).turns for angles in (orbit[0], orbit[-1]))
    # The orbit closes to within the spacing of its samples, 0.05 rad.
    assert np.abs(np.subtract(after, before)) == pytest.approx(1, abs=0.05)
    assert before == pytest.approx((0, 0), abs=1e-12)


@settings(deadline=None, max_examples=30)
@given(ANY_EXAMPLE, PLACES, st.integers(0, 10**6))
def test_mirror_image_and_reversed_time_change_what_they_should(
    example: tuple[float, float], place: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    chain = chain_of(example, ROTORS)
    angles = static_wall(chain, place) + 0.01 * random.standard_normal(ROTORS)
    rates = random.standard_normal(ROTORS)
    mirrored, there = -angles[::-1], ROTORS - 1 - place
    here = energies(chain, angles, rates, place)
    for image in (
        energies(chain, mirrored, -rates[::-1], there),
        energies(chain, angles, -rates, place),
        energies(chain, np.pi - angles, -rates, place),
    ):
        assert dataclasses.astuple(image) == pytest.approx(dataclasses.astuple(here), rel=1e-6)
    found, image = topology(chain, angles, place), topology(chain, mirrored, there)
    assert image.charge == found.charge
    assert image.polarisations == pytest.approx([-each for each in found.polarisations[::-1]])
    assert image.mode_centre == pytest.approx(ROTORS - 1 - found.mode_centre, abs=1e-6)
    assert image.winding_numbers == tuple(1 - each for each in found.winding_numbers[::-1])


@settings(deadline=None, max_examples=30)
@given(ANY_EXAMPLE, PLACES, st.integers(0, 10**6))
def test_the_wobble_is_the_same_in_a_mirror_and_upside_down(
    example: tuple[float, float], place: float, seed: int
) -> None:
    chain = chain_of(example, ROTORS)
    noisy = 0.01 * np.random.default_rng(seed).standard_normal(ROTORS)
    angles = static_wall(chain, place) + noisy
    mirrored, there = -angles[::-1], ROTORS - 1 - place
    found, turned, image = (
        wobble(chain, state, wall_at(chain, at), 0.01)
        for state, at in ((angles, place), (np.pi - angles, place), (mirrored, there))
    )
    assert flat(turned) == pytest.approx(flat(found), rel=1e-6, nan_ok=True)
    image = dataclasses.replace(
        image,
        amplitudes=image.amplitudes[::-1],
        amplitude_deviations=image.amplitude_deviations[::-1],
        rest_amplitudes=image.rest_amplitudes[::-1],
    )
    assert flat(image) == pytest.approx(flat(found), rel=1e-4, abs=1e-7, nan_ok=True)


@pytest.mark.parametrize('turned', BOTH)
@pytest.mark.parametrize('example', EXAMPLES)
def test_a_wall_at_rest_gives_back_the_exact_tail(
    example: tuple[float, float], turned: bool
) -> None:
    chain = chain_of(example, ROTORS)
    for place in (28.2, 29.5, 30.9):
        for leg in (0, 1):
            angles = static_wall(chain, place, leg, turned)
            found = wobble(chain, angles, wall_at(chain, place))
            assert found.exact_decay_length == penetration_depth(chain)
            assert found.tail_ratio == pytest.approx(ratio_of(chain), rel=1e-7)
            assert found.decay_length == pytest.approx(found.exact_decay_length, rel=1e-7)
            if chain.lean_ratio > 1:
                assert found.exact_wavelength == pytest.approx(2 * chain.spacing)
                assert found.wavelength == pytest.approx(2 * chain.spacing, rel=1e-3)
            else:
                assert found.exact_wavelength == math.inf
                assert math.isnan(found.wavelength)


@pytest.mark.parametrize('example', WOBBLERS)
def test_the_amplitude_is_how_far_a_rotor_leans_beyond_rest(
    example: tuple[float, float],
) -> None:
    chain = chain_of(example, ROTORS)
    lean, largest = chain.rotor_length * math.sin(chain.rest_angle), 0.0
    for place in np.linspace(28, 30, 21):
        angles = static_wall(chain, float(place))
        beyond = chain.rotor_length * np.abs(np.sin(angles)) - lean
        found = wobble(chain, angles, wall_at(chain, float(place)))
        middle = math.floor(place) + 1
        sides = float(beyond[1:middle].max()), float(beyond[middle:-1].max())
        assert found.amplitudes == pytest.approx(sides, abs=1e-9)
        assert found.amplitude == pytest.approx(max(sides), abs=1e-9)
        assert found.amplitudes == pytest.approx(found.rest_amplitudes, abs=1e-12)
        largest = max(largest, found.amplitude / lean)
    # The overshoot that was measured on such chains.
    assert largest == pytest.approx(0.033 if example == WOBBLER else 0.17, rel=0.05)


@pytest.mark.parametrize('example', [WIDE_FLIPPER, FLIPPER, SPINNER])
def test_without_wobble_there_is_no_amplitude(example: tuple[float, float]) -> None:
    chain = chain_of(example, ROTORS)
    found = wobble(chain, static_wall(chain, 29.3), wall_at(chain, 29.3), 0.01)
    if chain.motion is Motion.SPINNER:
        assert np.isnan(found.amplitudes).all()
    else:
        assert -found.amplitude_deviation < found.amplitude <= 0


def test_a_moving_tail_decays_as_a_wave_with_the_speed_of_the_wall() -> None:
    chain = chain_of(WIDE_FLIPPER, ROTORS)
    kick, start = 0.03, static_wall(chain, 15.3)
    speed = kick * chain.spacing / (chain.rotor_length * chain.time_unit)
    period = 0.5 * site_arc(chain) / speed
    recording = simulate(
        chain, start, speed * mode_towards_last(chain, start), 40 * period, period, 1e-7
    )
    places, ratios = [], []
    for angles in recording.angles[10:]:
        places.append(find_solitons(chain, angles)[0].rotor)
        ratios.append(wobble(chain, angles, wall_at(chain, places[-1]), 1e-3).tail_ratio)
    velocity = float(np.polyfit(recording.times[10:], places, 1)[0])
    plus, minus = couplings(chain)
    stiffness = 1 / (chain.rotor_length * chain.time_unit) ** 2

    def unmatched(ratio: float) -> float:
        squared = plus**2 + minus**2 + plus * minus * (ratio + 1 / ratio)
        return stiffness * squared + (velocity * math.log(ratio)) ** 2

    moving = brentq(unmatched, 0.05, ratio_of(chain))
    assert float(np.mean(ratios)) == pytest.approx(moving, rel=0.02)
    assert moving < 0.96 * ratio_of(chain)


@pytest.mark.parametrize('noise', [0.003, 0.01, 0.05])
@pytest.mark.parametrize('example', EXAMPLES)
def test_noise_leaves_the_wobble_unbiased_with_the_deviations_that_it_states(
    example: tuple[float, float], noise: float
) -> None:
    random, chain = np.random.default_rng(19), chain_of(example, ROTORS)
    scaled: dict[str, list[float]] = {'ratio': [], 'amplitude': [], 'decay': [], 'wave': []}
    for place in 29 + np.arange(10) / 10:
        angles, wall = static_wall(chain, float(place)), wall_at(chain, float(place))
        for _ in range(40):
            found = wobble(chain, angles + noise * random.standard_normal(ROTORS), wall, noise)
            for name, error in (
                ('ratio', (found.tail_ratio - ratio_of(chain)) / found.tail_ratio_deviation),
                (
                    'amplitude',
                    (found.amplitude - found.rest_amplitude) / found.amplitude_deviation,
                ),
                (
                    'decay',
                    (found.decay_length - found.exact_decay_length) / found.decay_length_deviation,
                ),
                ('wave', (found.wavelength - 2 * chain.spacing) / found.wavelength_deviation),
            ):
                if math.isfinite(error):
                    scaled[name].append(error)
    for name, errors in scaled.items():
        if len(errors) < 40:
            continue
        spread = 5 / math.sqrt(len(errors))
        # To second order of the noise the mean of a length is off by a fraction of its deviation.
        assert abs(float(np.mean(errors))) < spread + 0.2
        assert float(np.std(errors)) < 1.1 + spread / 2
        if name in ('ratio', 'amplitude'):
            assert float(np.std(errors)) > 0.9 - spread / 2


def test_noise_in_both_rotors_of_a_pair_does_not_flatten_the_tail() -> None:
    random, noise, count = np.random.default_rng(61), 0.012, 2500
    chain = chain_of(WIDE_FLIPPER, ROTORS)
    angles, wall = static_wall(chain, 29.6), wall_at(chain, 29.6)
    errors = []
    for _ in range(count):
        found = wobble(chain, angles + noise * random.standard_normal(ROTORS), wall, noise)
        errors.append((found.tail_ratio - ratio_of(chain)) / found.tail_ratio_deviation)
    assert abs(float(np.mean(errors))) < 5 / math.sqrt(count)


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])
def test_the_wall_of_a_cycle_says_the_same(example: tuple[float, float]) -> None:
    chain = chain_of(example, 41)
    cycle = Cycle(chain)
    random = np.random.default_rng(53)
    for leg in range(cycle.number_of_legs):
        arc = cycle.arc_at(19.7, leg)
        angles = cycle.configuration(arc) + 0.01 * random.standard_normal(41)
        by_cycle = wobble(chain, angles, wall_on_cycle(cycle, arc), 0.01)
        by_place = wobble(chain, angles, wall_at(chain, 19.7), 0.01)
        assert flat(by_cycle) == pytest.approx(flat(by_place), rel=1e-3, abs=1e-6, nan_ok=True)
    # Where the wall is at the first rotor there is no side before it.
    edge = wobble(chain, cycle.configuration(0.0), wall_on_cycle(cycle, 0.0), 0.01)
    assert math.isnan(edge.amplitudes[0])
    assert math.isnan(edge.amplitudes[1]) == (chain.motion is Motion.SPINNER)


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_width_of_the_theory_contracts_up_to_the_speed_of_sound(
    example: tuple[float, float],
) -> None:
    chain = chain_of(example, ROTORS)
    soliton = find_solitons(chain, static_wall(chain, 29.4))[0]
    sound = theory_of(chain).speed_of_sound
    for share in (0.0, 0.3, -0.9):
        found = width(chain, soliton, share * sound)
        assert found.theory == pytest.approx(chain.wall_width * math.sqrt(1 - share**2))
        assert (found.measured, found.deviation) == pytest.approx(
            (soliton.width, soliton.width_deviation), nan_ok=True
        )
    for velocity in (None, math.nan, sound, -2 * sound):
        assert math.isnan(width(chain, soliton, velocity).theory)
    moving = dataclasses.replace(soliton, velocity=0.6 * sound)
    assert width(chain, moving).theory == pytest.approx(0.8 * chain.wall_width)


@pytest.mark.parametrize('place', [-3.0, 0.4, ROTORS - 1.4, math.nan])
def test_a_wall_at_an_edge_is_refused(place: float) -> None:
    with pytest.raises(ValueError, match=f'place = {place} must lie from 0.5 to .* = 58.5'):
        wall_at(chain_of(FLIPPER, ROTORS), place)


def bad_states() -> list[tuple[Array, str]]:
    chain = chain_of(FLIPPER, ROTORS)
    holed = staggered(np.zeros(ROTORS))
    holed[7] = math.nan
    return [
        (np.zeros(3), r'angles of shape \(3,\) do not fit a chain of 60 rotors'),
        (holed, 'angle of rotor 7 = nan must be a finite number'),
        (chain.uniform_state(1)[None], r'angles of shape \(1, 60\) do not fit'),
    ]


@pytest.mark.parametrize(('angles', 'message'), bad_states())
def test_angles_that_do_not_fit_are_refused(angles: Array, message: str) -> None:
    chain = chain_of(FLIPPER, ROTORS)
    wall = wall_at(chain, 30.0)
    with pytest.raises(ValueError, match=message):
        energies(chain, angles, None, 30.0)
    with pytest.raises(ValueError, match=message):
        topology(chain, angles, 30.0)
    with pytest.raises(ValueError, match=message):
        edge_rotors(chain, angles)
    with pytest.raises(ValueError, match=message):
        wobble(chain, angles, wall)
