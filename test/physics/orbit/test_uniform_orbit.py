# SPDX-License-Identifier: Apache-2.0
"""The orbit of a chain of any length: relaxed, closed, of unit speed, and that of the linkage."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache

import numpy as np
import pytest
from chains import (
    EXAMPLES,
    FLIPPER,
    SPINNER,
    STRONG_WOBBLER,
    WIDE_SPINNER,
    WOBBLER,
    chain_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from linkage_motion import distance
from sampled_orbit import closed_orbit
from scipy.interpolate import make_interp_spline

from soliton_linkage.linear.rigidity import Edge, mode_towards_last, zero_mode
from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.uniform_orbit import UniformOrbit, spline
from soliton_linkage.solitons.static_wall import static_wall

# What the orbit promises of its angles [rad].
ACCURATE = 1e-6
# Error of following an orbit [rad].
FOLLOWED = 1e-8
# A wall of two rotors at d = 1, which also makes the shortest orbit to follow.
NARROW = (1.0, math.asin(0.5))
# Very long and short rotors, and near d_c on either side.
EXTREMES = (
    (0.02, 1.2),
    (20.0, 0.3),
    (0.9 / math.sin(0.8) ** 2, 0.8),
    (1.02 / math.sin(0.8) ** 2, 0.8),
)
ANY_LENGTH = [(example, 1001) for example in EXAMPLES]
ANY_LENGTH += [(example, rotors) for example in (FLIPPER, WOBBLER, SPINNER) for rotors in (3, 8)]
ANY_LENGTH += [(FLIPPER, 1000), (SPINNER, 1000)]
ANYTHING = [*ANY_LENGTH, *((example, 5) for example in EXTREMES)]
ANYTHING += [(NARROW, 5), (NARROW, 1001), ((20.0, 0.3), 1001)]
Example = tuple[float, float]


@lru_cache(maxsize=128)
def orbit_of_example(example: Example, rotors: int) -> UniformOrbit:
    return UniformOrbit(chain_of(example, rotors))


def some_arcs(orbit: UniformOrbit, count: int) -> list[float]:
    """Arcs all over the orbit and beyond both of its ends, and next to every reflection."""
    even = np.linspace(-1, orbit.length + 1, count)
    begins = [orbit.leg_arcs(leg)[0] for leg in range(orbit.number_of_legs)]
    return [*even.tolist(), *(begin + by for begin in begins for by in (-0.3, 0.0, 0.4))]


@pytest.mark.parametrize(('example', 'rotors'), ANYTHING)
def test_springs_are_relaxed_all_along_the_orbit(example: Example, rotors: int) -> None:
    orbit = orbit_of_example(example, rotors)
    angles = np.array([orbit.configuration(arc) for arc in some_arcs(orbit, 40)])
    # Neither of the levers of a spring is longer than its rotor.
    limit = 2 * ACCURATE * orbit.chain.rotor_length
    assert np.abs(orbit.chain.spring_extensions(angles)).max() <= limit


@pytest.mark.parametrize(('example', 'rotors'), ANY_LENGTH)
def test_the_tangent_is_the_zero_mode_towards_the_other_edge(
    example: Example, rotors: int
) -> None:
    orbit = orbit_of_example(example, rotors)
    for arc in some_arcs(orbit, 12):
        about = orbit.segment(arc)
        tangent = np.zeros(rotors)
        tangent[about.first : about.first + len(about.angles)] = about.tangent
        mode = zero_mode(orbit.chain, orbit.configuration(arc))
        sign = np.sign(mode @ tangent)
        # A mode turns with the angles at a rate of its curvature, some units.
        assert sign * tangent == pytest.approx(mode, rel=0, abs=10 * ACCURATE)
        assert np.linalg.norm(tangent) == pytest.approx(1, abs=10 * ACCURATE)
        ends = [orbit.leg_arcs(leg)[1] for leg in range(orbit.number_of_legs)]
        if min(abs(math.remainder(arc - end, orbit.length)) for end in ends) > 1e-3:
            towards_last = mode_towards_last(orbit.chain, orbit.configuration(arc))
            assert np.sign(towards_last @ tangent) == (-1) ** orbit.leg(arc)


@pytest.mark.parametrize('rotors', [3, 1001])
@pytest.mark.parametrize('example', EXAMPLES)
def test_the_speed_is_1_everywhere_and_along_the_tangent(example: Example, rotors: int) -> None:
    orbit = orbit_of_example(example, rotors)
    step = 1e-3
    for arc in some_arcs(orbit, 20):
        before, after = orbit.configuration(arc - step), orbit.configuration(arc + step)
        moved = np.angle(np.exp(1j * (after - before)))
        # Chords are shorter than arcs by a share of the squared curvature, at most some units;
        # where a stretch begins two rotors further, angles jump by what they are accurate to.
        limit = 20 * step**2 + math.sqrt(2) * ACCURATE / step
        assert np.linalg.norm(moved) / (2 * step) == pytest.approx(1, abs=limit)
        about = orbit.segment(arc)
        moved = moved[about.first : about.first + len(about.angles)]
        assert moved @ about.tangent / (2 * step) == pytest.approx(1, abs=limit)


@pytest.mark.parametrize(('example', 'rotors'), ANYTHING)
def test_it_is_continuous_through_reflections_and_where_it_closes(
    example: Example, rotors: int
) -> None:
    orbit = orbit_of_example(example, rotors)
    step = 1e-8
    seams = [orbit.leg_arcs(leg)[0] for leg in range(orbit.number_of_legs)] + [orbit.length]
    for seam in seams:
        before, after = orbit.configuration(seam - step), orbit.configuration(seam + step)
        assert distance(before, after) <= 2 * step + ACCURATE


@pytest.mark.parametrize('example', EXAMPLES)
def test_it_is_continuous_where_a_long_chain_repeats_the_short_one(example: Example) -> None:
    orbit = orbit_of_example(example, 1001)
    step = 1e-8
    middle = orbit.arc_at(orbit.middle, 1)
    # Two spacings on all begins anew, and whatever repeats does so within one of them.
    low, high = middle + 0.1 * orbit.site_arc, middle + 2.1 * orbit.site_arc
    first = orbit.segment(low).first
    assert orbit.segment(high).first == first - 2
    while high - low > step:
        between = (low + high) / 2
        same = orbit.segment(between).first == first
        low, high = (between, high) if same else (low, between)
    assert distance(orbit.configuration(low), orbit.configuration(high)) <= step + ACCURATE


def compare_with_closed_orbit(orbit: UniformOrbit, accuracy: float) -> None:
    """Compare with the orbit of the same chain, which may run through it the other way."""
    sampled = closed_orbit(orbit.chain, static_wall(orbit.chain, orbit.middle))
    offset, sense = orbit.arc_at(orbit.middle, 0), float(sampled.directions[0])
    assert sampled.length == pytest.approx(orbit.length, rel=0, abs=accuracy)
    for arc in np.linspace(0, sampled.length, 40).tolist():
        there = orbit.configuration(offset + sense * arc)
        assert distance(there, sampled.configuration(arc)) < accuracy
    assert len(sampled.reflections) == orbit.number_of_legs
    turns = [(offset + sense * arc, edge) for arc, edge in sampled.reflections]
    for leg in range(orbit.number_of_legs):
        end = orbit.leg_arcs(leg)[1]
        apart = [abs(math.remainder(arc - end, orbit.length)) for arc, _ in turns]
        assert min(apart) < accuracy
        assert turns[int(np.argmin(apart))][1] is (Edge.LAST if leg % 2 == 0 else Edge.FIRST)


@pytest.mark.parametrize(
    ('example', 'rotors'),
    [*((example, 5) for example in EXAMPLES), (FLIPPER, 4), (WOBBLER, 4), (SPINNER, 4)],
)
def test_it_is_the_closed_orbit_of_a_short_chain(example: Example, rotors: int) -> None:
    compare_with_closed_orbit(orbit_of_example(example, rotors), FOLLOWED)


def test_it_is_the_closed_orbit_of_a_longer_chain_than_the_short_one() -> None:
    # Four legs, each off by the cut tails of the zero mode.
    compare_with_closed_orbit(orbit_of_example(NARROW, 15), 4 * ACCURATE)


@pytest.mark.parametrize('example', EXAMPLES)
@settings(deadline=None, max_examples=10)
@given(place=st.floats(100, 900), leg=st.integers(0, 3))
def test_in_the_middle_of_legs_it_holds_the_walls_at_rest(
    example: Example, place: float, leg: int
) -> None:
    orbit = orbit_of_example(example, 1001)
    leg %= orbit.number_of_legs
    wall = static_wall(orbit.chain, place, leg)
    assert distance(orbit.configuration(orbit.arc_at(place, leg)), wall) < ACCURATE


@pytest.mark.parametrize(
    ('example', 'expected'),
    [
        ((0.5, 0.1), 1.308),
        (FLIPPER, 1.194),
        (WOBBLER, 1.644),
        (STRONG_WOBBLER, 1.474),
        (WIDE_SPINNER, 16.9),
    ],
)
def test_the_swing_at_the_edges_is_that_of_an_independent_program(
    example: Example, expected: float
) -> None:
    orbit = orbit_of_example(example, 1001)
    swing = orbit.length / orbit.number_of_legs - 1000 * orbit.site_arc
    # Half a unit of the last digit given.
    digits = 0.05 if example == WIDE_SPINNER else 5e-4
    assert swing * example[0] == pytest.approx(expected, abs=digits)


@pytest.mark.parametrize(('example', 'rotors'), ANY_LENGTH)
@settings(deadline=None, max_examples=10)
@given(share=st.floats(0, 1), leg=st.integers(0, 3), orbits=st.integers(-3, 3))
def test_place_and_arc_are_inverse_to_each_other(
    example: Example, rotors: int, share: float, leg: int, orbits: int
) -> None:
    orbit = orbit_of_example(example, rotors)
    leg %= orbit.number_of_legs
    place = 0.5 + share * (rotors - 2)
    arc = orbit.arc_at(place, leg) + orbits * orbit.length
    assert orbit.leg(arc) == leg
    assert orbit.site(arc) == pytest.approx(place, rel=0, abs=1e-11 * rotors)


@pytest.mark.parametrize(('example', 'rotors'), ANY_LENGTH)
def test_legs_follow_one_another_to_and_fro(example: Example, rotors: int) -> None:
    orbit = orbit_of_example(example, rotors)
    arcs = np.linspace(0, orbit.length, 400, endpoint=False).tolist()
    legs = [orbit.leg(arc) for arc in arcs]
    assert legs == sorted(legs)
    assert set(legs) == set(range(2 if orbit.chain.motion is Motion.SPINNER else 4))
    assert orbit.leg_arcs(0)[0] == 0
    assert orbit.leg_arcs(orbit.number_of_legs - 1)[1] == orbit.length
    places = np.array([orbit.site(arc) for arc in arcs])
    assert places.min() >= 0
    assert places.max() <= rotors - 1
    for leg in range(orbit.number_of_legs):
        begin, end = orbit.leg_arcs(leg)
        assert end - begin > 0
        within = places[[here == leg for here in legs]]
        assert (np.diff(within) * (-1) ** leg >= 0).all()


@pytest.mark.parametrize('example', EXAMPLES)
def test_rotors_beyond_a_stretch_do_not_move(example: Example) -> None:
    orbit = orbit_of_example(example, 1001)
    for arc in some_arcs(orbit, 12):
        about = orbit.segment(arc)
        mode = zero_mode(orbit.chain, orbit.configuration(arc))
        beyond = np.delete(mode, np.arange(about.first, about.first + len(about.angles)))
        assert np.abs(beyond).max() < ACCURATE
        left, right = orbit.background(arc)
        assert distance(left[1:-1], orbit.chain.uniform_state(1)[1:-1]) == 0
        leaning = np.sin(right[1:-1])
        assert leaning == pytest.approx(-np.sin(left[1:-1]), abs=1e-15)


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_the_longest_chain_takes_no_more_than_a_long_one(example: Example) -> None:
    long, longest = orbit_of_example(example, 1000), orbit_of_example(example, 100_000)
    for leg in range(long.number_of_legs):
        shares = [
            len(each.segment(each.arc_at(each.middle, leg)).angles) for each in (long, longest)
        ]
        assert shares[0] == shares[1]
    growth = (longest.length - long.length) / long.number_of_legs
    assert growth == pytest.approx(99_000 * long.site_arc, rel=1e-12)
    assert longest.wall_extent == pytest.approx(long.wall_extent, rel=1e-9)


def test_deviations_do_not_count() -> None:
    chain = chain_of(WOBBLER, 8)
    drawn = drawn_deviations(8, 3, rotor_length=0.05, spacing=0.05)
    deviating = UniformOrbit(dataclasses.replace(chain, deviations=drawn))
    assert deviating.chain == chain
    assert deviating.length == orbit_of_example(WOBBLER, 8).length


@pytest.mark.parametrize(('rotors', 'periodic'), [(2, False), (2, True), (20, True)])
def test_chains_without_a_wall_are_refused(rotors: int, periodic: bool) -> None:
    chain = dataclasses.replace(chain_of(FLIPPER, rotors), periodic=periodic)
    with pytest.raises(ValueError, match=f'chain of {rotors} rotors .* give it 3 rotors or more'):
        UniformOrbit(chain)


def test_the_transition_is_refused() -> None:
    with pytest.raises(ValueError, match='too near to d_c'):
        UniformOrbit(chain_of((1 / math.sin(0.8) ** 2, 0.8), 20))
    with pytest.raises(ValueError, match='take longer rotors or a larger rest angle'):
        UniformOrbit(chain_of((0.02, 0.001), 20))


def test_walls_that_are_wider_than_numbers_reach_have_an_orbit() -> None:
    chain = Chain(number_of_rotors=200, rotor_length=9.5e-05, rest_angle=1.57)
    orbit = UniformOrbit(chain)
    tangent = orbit.tangent(orbit.arc_at(100.0, 0))
    assert np.linalg.norm(tangent) == pytest.approx(1.0, abs=1e-6)


def test_splines_are_those_of_scipy() -> None:
    random = np.random.default_rng(1)
    places = np.cumsum(0.1 + random.random(40))
    expected = make_interp_spline(places, random.standard_normal((40, 3)), k=7)
    found = np.empty(3)
    for at in [*places, *random.uniform(places[0], places[-1], 50)]:
        spline(expected.t, expected.c, float(at), found)
        assert found == pytest.approx(expected(at), rel=1e-9, abs=1e-9)
