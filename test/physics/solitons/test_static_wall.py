# SPDX-License-Identifier: Apache-2.0
"""Walls at rest: relaxed, symmetric, at the site of the arc of the orbit, with exact tails."""

import dataclasses
import math
from itertools import pairwise, product

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, SPINNER, WIDE_SPINNER, WOBBLER, any_chain, chain_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from linkage_motion import distance, wall_between

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.estimation.state_report import StateReporter
from soliton_linkage.linear.rigidity import mode_towards_last, rigidity_bands
from soliton_linkage.linear.statics import length_rounding
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons

# Error of the angles of a wall by following the orbit [rad].
FOLLOWED = 1e-9
Branches = tuple[Array, Array]


def legs_of(chain: Chain) -> range:
    return range(2 if chain.motion is Motion.SPINNER else 4)


def mirrored_leg(chain: Chain, leg: int) -> int:
    """Return the leg of the mirror image.

    An edge rotor has toggled relative to the left-leaning state at both ends, and the mirror image
    of that state leans right. For d < 1 the first and the last rotor are exchanged. For d > 1 the
    coupling A_0 has the opposite sign there, so that legs 0 and 2 are exchanged.
    """
    if chain.motion is Motion.SPINNER:
        return leg
    return (-leg if chain.lean_ratio <= 1 else 2 - leg) % 4


def branches_of(chain: Chain, angles: Array) -> Branches:
    first, second = rigidity_bands(chain, angles)
    return np.sign(first), np.sign(second)


@st.composite
def any_wall(
    draw: st.DrawFn, fewest: int = 3, most: int = 30, apart: float = 1e-8, narrowest: float = 0.05
) -> tuple[Chain, float, int, bool]:
    """Draw a chain, and the site, the leg and the inversion of a wall in it."""
    chain = draw(any_chain(fewest, most))
    assume(chain.lean_ratio > narrowest)
    assume(abs(chain.lean_ratio / chain.critical_lean_ratio - 1) > apart)
    site = draw(st.floats(0.5, chain.number_of_rotors - 1.5))
    return chain, site, draw(st.sampled_from(legs_of(chain))), draw(st.booleans())


@settings(deadline=None, max_examples=40)
@given(any_wall())
def test_a_wall_is_relaxed_at_any_site(wall):
    chain, site, leg, inverted = wall
    angles = static_wall(chain, site, leg, inverted)
    rounding = length_rounding(chain)
    assert np.abs(chain.spring_extensions(angles)).max() <= rounding
    springs = chain.number_of_springs
    assert chain.elastic_energy(angles) <= springs * chain.stiffness * rounding**2 / 2


@pytest.mark.parametrize('example', EXAMPLES)
def test_a_wall_between_two_rotors_is_symmetric(example):
    for inverted, rotor in [(False, 9), (True, 10)]:
        chain = chain_of(example, 21)
        spinner = chain.motion is Motion.SPINNER
        for leg in legs_of(chain):
            crossed = spinner and (leg + rotor + inverted) % 2 == 1
            twin = wall_between(chain, rotor, inverted != spinner, crossed)
            angles = static_wall(chain, rotor + 0.5, leg, inverted)
            inner = slice(None) if spinner else slice(1, -1)
            assert distance(angles[inner], twin[inner]) < 1e-11


@settings(deadline=None, max_examples=15)
@given(any_wall(apart=1e-4))
def test_an_inverted_wall_is_the_image_at_the_horizontal(wall):
    chain, site, leg, inverted = wall
    image_leg = 1 - leg if chain.motion is Motion.SPINNER else leg
    image = static_wall(chain, site, image_leg, not inverted)
    assert distance(static_wall(chain, site, leg, inverted), np.pi - image) < FOLLOWED


@settings(deadline=None, max_examples=15)
@given(any_wall(apart=1e-4))
def test_the_mirror_image_of_a_wall_is_the_wall_at_the_mirrored_site(wall):
    chain, site, leg, inverted = wall
    # In staggered angles the image is -theta, or theta - pi for spinners, wherever even rotors
    # become odd ones.
    odd_changes = chain.number_of_rotors % 2 == 0
    image_turned = inverted != odd_changes
    if chain.motion is Motion.SPINNER:
        image_turned = not image_turned
    mirrored = chain.number_of_rotors - 1 - site
    image = static_wall(chain, mirrored, mirrored_leg(chain, leg), image_turned)
    assert distance(static_wall(chain, site, leg, inverted), -image[::-1]) < FOLLOWED


@settings(deadline=None, max_examples=15)
@given(any_wall(fewest=6, apart=1e-4))
def test_walls_repeat_after_two_rotors_and_are_inverted_after_one(wall):
    chain, site, leg, inverted = wall
    site = 0.5 + (site - 0.5) * (chain.number_of_rotors - 4) / (chain.number_of_rotors - 2)
    angles = static_wall(chain, site, leg, inverted)
    further = static_wall(chain, site + 2, leg, inverted)
    # Edge rotors may be on different sides; all others see the same bars. Places are rounded.
    assert distance(further[3:-1], angles[1:-3]) < FOLLOWED
    following_leg = 1 - leg if chain.motion is Motion.SPINNER else leg
    following = static_wall(chain, site + 1, following_leg, inverted)
    assert distance(following[2:-1], np.pi - angles[1:-2]) < FOLLOWED


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_site_is_proportional_to_the_arc_length_of_the_motion(example):
    chain = chain_of(example, 170)
    arc = site_arc(chain)
    for leg, spacings in product(legs_of(chain), (0.3, 1.0, -2.7)):
        start = static_wall(chain, 84.2, leg)
        onwards = math.copysign(1, spacings) * mode_towards_last(chain, start)
        motion = RigidSimulation(chain, start, onwards, period=abs(spacings) * arc)
        motion.advance()
        assert distance(motion.angles, static_wall(chain, 84.2 + spacings, leg)) < FOLLOWED


def arc_of_wide_flipper(chain: Chain) -> float:
    """Arc a spacing of u = -ub tanh(x d / a), whose rotors turn by dphi = du / sqrt(r^2 - u^2).

    Lambda^2 = sin(theta_bar)^2 d times the integral over tau = tanh from -1 to 1 of
    (1 - tau^2) / (1 - sin(theta_bar)^2 tau^2), that is (4/3) sin(theta_bar)^2 d to first order.
    """
    sine = math.sin(chain.rest_angle)
    return math.sqrt(2 * chain.lean_ratio * (1 - (1 - sine**2) * math.atanh(sine) / sine))


def arc_of_wide_spinner(chain: Chain) -> float:
    """Arc a spacing of cos(theta - theta_bar) = -tanh(x / w), dtheta = sech(x / w) dx / w."""
    return math.sqrt(2 * chain.spacing / chain.wall_width)


def test_the_arc_converges_to_phi_4_theory_as_d_squared():
    for rest_angle in [0.1, 0.77, 1.3]:
        errors = []
        for lean_ratio in (0.2, 0.1, 0.05):
            chain = chain_of((lean_ratio / 2 / math.sin(rest_angle), rest_angle), 3)
            errors.append(site_arc(chain) / arc_of_wide_flipper(chain) - 1)
        for coarse, fine in pairwise(errors):
            assert math.log2(coarse / fine) == pytest.approx(2, abs=0.1)


def test_the_arc_converges_to_sine_gordon_theory_as_1_over_d_squared():
    for rest_angle in [0.6, 0.9, 1.4]:
        errors = []
        for ratio in (16, 32, 64):
            chain = chain_of((ratio, rest_angle), 3)
            errors.append(site_arc(chain) / arc_of_wide_spinner(chain) - 1)
        for coarse, fine in pairwise(errors):
            assert math.log2(coarse / fine) == pytest.approx(2, abs=0.1)


def shown_leg(chain: Chain, angles: Array, site: float, inverted: bool) -> int:
    """Leg by the edge rotors that have toggled or the side on which a wall's rotors turn over."""
    if chain.motion is not Motion.SPINNER:
        toggled = StateReporter(chain).report(angles, site).edge_rotors.toggled
        return [(False, False), (False, True), (True, True), (True, False)].index(toggled)
    lean, rotor = -1 if inverted else 1, round(site)
    sine = math.sin(float(staggered(angles)[rotor]) - lean * chain.rest_angle)
    return int(sine * lean * (-1) ** rotor > 0)


@pytest.mark.parametrize(('rotors', 'inverted'), [(40, False), (41, True)])
@pytest.mark.parametrize('example', EXAMPLES)
def test_a_wall_is_found_on_its_leg(example, inverted, rotors):
    chain = chain_of(example, rotors)
    legs = legs_of(chain)
    for leg, site in product(legs, (13.3, 20.0, 24.8)):
        angles = static_wall(chain, site, leg, inverted)
        (soliton,) = find_solitons(chain, angles)
        assert shown_leg(chain, angles, site, inverted) == leg
        assert soliton.rotor == pytest.approx(site, abs=0.1)
        assert soliton.charge == 1


def test_walls_near_the_transition_to_spinners_are_symmetric():
    for beyond in [-1e-8, 1e-8]:
        for rest_angle in [0.3, 0.77, 1.5]:
            chain = chain_of(((1 + beyond) / math.sin(rest_angle) ** 2, rest_angle), 20)
            assert (chain.motion is Motion.SPINNER) == (beyond > 0)
            leg = mirrored_leg(chain, 0)
            angles = static_wall(chain, 9.2)
            image = static_wall(chain, 9.8, leg, chain.motion is not Motion.SPINNER)
            assert distance(angles, -image[::-1]) < 1e-6


@pytest.mark.parametrize('example', EXAMPLES)
def test_in_a_chain_with_deviations_each_bar_has_its_own_length(example):
    even = chain_of(example, 30)
    deviations = drawn_deviations(30, 5, spacing=0.01, rotor_length=0.01, rest_length=0.01)
    chain = dataclasses.replace(even, deviations=deviations)
    for leg in legs_of(chain):
        angles = static_wall(chain, 14.3, leg)
        assert np.abs(chain.spring_extensions(angles)).max() <= length_rounding(chain)
        assert angles[14] == static_wall(even, 14.3, leg)[14]
        assert (
            np.asarray(branches_of(chain, angles))
            == branches_of(even, static_wall(even, 14.3, leg))
        ).all()


def test_a_bar_that_does_not_reach_is_rejected():
    chain = chain_of(FLIPPER, 9)
    lengths = np.zeros(8)
    lengths[6] = 2.0
    deviations = dataclasses.replace(chain.deviations, rest_length=tuple(lengths.tolist()))
    other = dataclasses.replace(chain, deviations=deviations)
    with pytest.raises(ValueError, match=r'bar 6 of length .* cannot join rotor 7 .* must have'):
        static_wall(other, 3.0)


def test_a_chain_at_the_transition_to_spinners_is_rejected():
    for beyond in [0.0, 5e-10, -5e-10]:
        chain = chain_of(((1 + beyond) / math.sin(0.77) ** 2, 0.77), 9)
        with pytest.raises(ValueError, match=r'd = 2\.873.* too near to d_c = 2\.873.*; take d'):
            static_wall(chain, 4.0)


def test_a_too_wide_wall_is_rejected():
    with pytest.raises(ValueError, match=r'd = 4e-05 makes a wall extend over .* rotors'):
        site_arc(chain_of((0.02, 0.001), 3))


RING = dataclasses.replace(chain_of(FLIPPER, 8), periodic=True)


def test_sites_legs_and_chains_without_a_wall_are_rejected():
    for chain, site, leg, message in [
        *(
            (chain_of(FLIPPER, 9), site, 0, r'site = .* must lie in the range 0 to .* = 8')
            for site in (-0.01, 8.01, -3.0, math.nan, math.inf)
        ),
        (chain_of(FLIPPER, 9), 4.0, 4, 'leg = 4 must be one of 0 to'),
        (chain_of(WOBBLER, 9), 4.0, -1, 'leg = -1 must be one of 0 to'),
        (chain_of(WIDE_SPINNER, 9), 4.0, 2, 'leg = 2 must be one of 0 to'),
        (chain_of(SPINNER, 2), 0.5, 0, '2 rotors with free ends; give it 3'),
        (RING, 3.0, 0, r'periodic ends; .* free ends'),
    ]:
        with pytest.raises(ValueError, match=message):
            static_wall(chain, site, leg)
