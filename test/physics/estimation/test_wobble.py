# SPDX-License-Identifier: Apache-2.0
"""Wobble beside a wall against exact tails, waves and its own noise."""

import dataclasses
import math

import numpy as np
import pytest
from chains import (
    CLASSES,
    EXAMPLES,
    FLIPPER,
    SPINNER,
    STRONG_WOBBLER,
    WIDE_FLIPPER,
    WOBBLER,
    chain_of,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.estimation.state_report import energy_reach
from soliton_linkage.estimation.wobble import Wobble, WobbleReporter
from soliton_linkage.linear.bands import couplings, penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons

ROTORS = 60
WOBBLERS = (WOBBLER, STRONG_WOBBLER)
PLACES = st.floats(5, ROTORS - 6)
ANY_EXAMPLE = st.sampled_from(EXAMPLES)
BOTH = (False, True)
RestingWall = tuple[int, Array, float]
"""First rotor, angles of a wall at rest [rad] and its site [rotor spacings]."""


def wall_at(chain: Chain, site: float) -> RestingWall:
    """A wall at rest at a place [rotor spacings], half a spacing or more from both ends.

    The chain has no deviations, and its edge rotors have not toggled.
    """
    beside = math.ceil(energy_reach(chain))
    nearest = round(site)
    first, last = max(nearest - beside, 0), min(nearest + beside, chain.number_of_rotors - 1)
    window = dataclasses.replace(
        chain, number_of_rotors=2 * beside + 4, periodic=False, deviations=NO_DEVIATIONS
    )
    before = beside + 1 + (nearest - beside - 1) % 2
    angles = static_wall(window, site - nearest + before)
    shift = before - nearest
    return first, angles[first + shift : last + shift + 1], site


def wall_on_orbit(orbit: UniformOrbit, arc: float) -> RestingWall:
    """Return the wall at rest at an arc of an orbit [rad]."""
    about = orbit.segment(arc)
    return about.first, about.angles, orbit.site(arc)


def wobble(
    chain: Chain, angles: Array, wall: RestingWall, noise: float = 0.0, persistent: float = 0.0
) -> Wobble:
    return WobbleReporter(chain).wobble(angles, *wall, noise, persistent)


def ratio_of(chain: Chain) -> float:
    return (1 - chain.lean_ratio) / (1 + chain.lean_ratio)


def flat(wobbling: Wobble) -> list[float]:
    return np.hstack(wobbling).tolist()


@settings(deadline=None, max_examples=30)
@given(ANY_EXAMPLE, PLACES, st.integers(0, 10**6))
def test_the_wobble_is_the_same_in_a_mirror_and_upside_down(example, site, seed):
    # If both sides are equally large, either of them is reported.
    assume(abs(2 * site - round(2 * site)) > 0.02)
    chain = chain_of(example, ROTORS)
    noisy = 0.01 * np.random.default_rng(seed).standard_normal(ROTORS)
    angles = static_wall(chain, site) + noisy
    mirrored, there = -angles[::-1], ROTORS - 1 - site
    found, turned, image = (
        wobble(chain, state, wall_at(chain, at), 0.01)
        for state, at in ((angles, site), (np.pi - angles, site), (mirrored, there))
    )
    assert flat(turned) == pytest.approx(flat(found), rel=1e-6, nan_ok=True)
    assert flat(image) == pytest.approx(flat(found), rel=1e-4, abs=1e-7, nan_ok=True)


@pytest.mark.parametrize('example', EXAMPLES)
def test_a_wall_at_rest_gives_back_the_exact_tail(example):
    for turned in BOTH:
        chain = chain_of(example, ROTORS)
        for site in (28.2, 29.5, 30.9):
            for leg in (0, 1):
                angles = static_wall(chain, site, leg, turned)
                found = wobble(chain, angles, wall_at(chain, site))
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
def test_the_amplitude_is_the_overshoot_beyond_rest(example):
    chain = chain_of(example, ROTORS)
    lean, largest = chain.rotor_length * math.sin(chain.rest_angle), 0.0
    for site in np.linspace(28, 30, 21):
        angles = static_wall(chain, float(site))
        beyond = chain.rotor_length * np.abs(np.sin(angles)) - lean
        found = wobble(chain, angles, wall_at(chain, float(site)))
        assert found.amplitude == pytest.approx(float(beyond[1:-1].max()), abs=1e-9)
        assert found.amplitude == pytest.approx(found.rest_amplitude, abs=1e-12)
        largest = max(largest, found.amplitude / lean)
    # This overshoot was measured on such chains.
    assert largest == pytest.approx(0.033 if example == WOBBLER else 0.17, rel=0.05)


@pytest.mark.parametrize('example', [WIDE_FLIPPER, FLIPPER, SPINNER])
def test_without_wobble_there_is_no_amplitude(example):
    chain = chain_of(example, ROTORS)
    found = wobble(chain, static_wall(chain, 29.3), wall_at(chain, 29.3), 0.01)
    if chain.motion is Motion.SPINNER:
        assert math.isnan(found.amplitude)
    else:
        assert -found.amplitude_deviation < found.amplitude <= 0


def test_a_moving_tail_decays_as_a_wave_with_the_speed_of_the_wall():
    chain = chain_of(WIDE_FLIPPER, ROTORS)
    kick, start = 0.03, static_wall(chain, 15.3)
    speed = kick * chain.spacing / (chain.rotor_length * chain.time_unit)
    period = 0.5 * site_arc(chain) / speed
    recording = simulate(
        chain, start, speed * mode_towards_last(chain, start), 40 * period, period, 1e-7
    )
    sites, ratios = [], []
    for angles in recording.angles[10:]:
        sites.append(find_solitons(chain, angles)[0].rotor)
        ratios.append(wobble(chain, angles, wall_at(chain, sites[-1]), 1e-3).tail_ratio)
    velocity = float(np.polyfit(recording.times[10:], sites, 1)[0])
    plus, minus = couplings(chain)
    stiffness = 1 / (chain.rotor_length * chain.time_unit) ** 2

    def unmatched(ratio: float) -> float:
        squared = plus**2 + minus**2 + plus * minus * (ratio + 1 / ratio)
        return stiffness * squared + (velocity * math.log(ratio)) ** 2

    moving = brentq(unmatched, 0.05, ratio_of(chain))
    assert float(np.mean(ratios)) == pytest.approx(moving, rel=0.02)
    assert moving < 0.96 * ratio_of(chain)


@pytest.mark.parametrize('noise', [0.003, 0.05])
@pytest.mark.parametrize('example', EXAMPLES)
def test_the_noisy_wobble_is_unbiased_with_the_stated_deviations(example, noise):
    random, chain = np.random.default_rng(19), chain_of(example, ROTORS)
    reporter = WobbleReporter(chain)
    scaled: dict[str, list[float]] = {'ratio': [], 'amplitude': [], 'decay': [], 'wave': []}
    for site in 29 + np.arange(10) / 10:
        angles, wall = static_wall(chain, float(site)), wall_at(chain, float(site))
        for _ in range(40):
            found = reporter.wobble(angles + noise * random.standard_normal(ROTORS), *wall, noise)
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
        # To second order in the noise a length has a bias of a fraction of its deviation.
        assert abs(float(np.mean(errors))) < spread + 0.2
        assert float(np.std(errors)) < 1.1 + spread / 2
        if name in ('ratio', 'amplitude'):
            assert float(np.std(errors)) > 0.9 - spread / 2


@pytest.mark.parametrize('example', CLASSES)
def test_the_wall_on_an_orbit_gives_the_same_result(example):
    chain = chain_of(example, 41)
    orbit = UniformOrbit(chain)
    random = np.random.default_rng(53)
    for leg in range(orbit.number_of_legs):
        arc = orbit.arc_at(19.7, leg)
        angles = orbit.configuration(arc) + 0.01 * random.standard_normal(41)
        by_cycle = wobble(chain, angles, wall_on_orbit(orbit, arc), 0.01)
        by_site = wobble(chain, angles, wall_at(chain, 19.7), 0.01)
        assert flat(by_cycle) == pytest.approx(flat(by_site), rel=1e-3, abs=1e-6, nan_ok=True)
    # A wall at the first rotor has no side before it.
    edge = wobble(chain, orbit.configuration(0.0), wall_on_orbit(orbit, 0.0), 0.01)
    assert math.isnan(edge.amplitude) == (chain.motion is Motion.SPINNER)


@pytest.mark.parametrize('example', EXAMPLES)
def test_persistent_residuals_increase_the_deviations_only(example):
    random, chain = np.random.default_rng(59), chain_of(example, ROTORS)
    angles = static_wall(chain, 29.3) + 3e-4 * random.standard_normal(ROTORS)
    plain, doubted = (
        wobble(chain, angles, wall_at(chain, 29.3), 3e-4, persistent) for persistent in (0.0, 4e-4)
    )
    assert doubted.tail_ratio == plain.tail_ratio
    assert doubted.amplitude == pytest.approx(plain.amplitude, nan_ok=True)
    ratio = doubted.tail_ratio_deviation / plain.tail_ratio_deviation
    assert ratio == pytest.approx(5 / 3)
    if chain.motion is not Motion.SPINNER:
        larger = doubted.amplitude_deviation / plain.amplitude_deviation
        assert larger == pytest.approx(5 / 3)
    if chain.lean_ratio > 1:
        assert doubted.wavelength_deviation > plain.wavelength_deviation


@pytest.mark.parametrize('example', EXAMPLES)
def test_a_wall_next_to_an_edge_has_a_valid_wobble(example):
    random, chain = np.random.default_rng(67), chain_of(example, ROTORS)
    wall = wall_at(chain, 2.6)
    noise = 0.5 * chain.rest_angle
    for _ in range(20):
        angles = static_wall(chain, 2.6) + noise * random.standard_normal(ROTORS)
        found = wobble(chain, angles, wall, noise)
        if chain.motion is not Motion.SPINNER:
            # Masses before the wall are counted to the right, those beyond it to the left.
            lean = chain.rotor_length * math.sin(chain.rest_angle) + found.amplitude
            to_the_right, _ = chain.positions(angles)
            outwards = np.append(to_the_right[1:3], -to_the_right[3:-1])
            assert np.abs(outwards - lean).min() < 1e-12
        assert flat(wobble(chain, np.pi - angles, wall, noise)) == pytest.approx(
            flat(found), rel=1e-6, nan_ok=True
        )
