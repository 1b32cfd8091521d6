# SPDX-License-Identifier: Apache-2.0
"""Laws of all orbits: relaxed springs, unit tangents, continuity, agreement with the linkage."""

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
    WIDE_SPINNER,
    WOBBLER,
    chain_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from linkage_motion import distance
from orbits import Example, accuracy, deviating_orbit, some_arcs, uniform_orbit
from sampled_orbit import closed_orbit

from soliton_linkage.linear.rigidity import Edge, mode_towards_last, zero_mode
from soliton_linkage.linkage.chain import Motion
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import DeviatingOrbit, orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import static_wall

# Error of following an orbit [rad].
FOLLOWED = 1e-8
# A wall of two rotors at d = 1, which also has the shortest orbit to follow.
NARROW = (1.0, math.asin(0.5))
# Very long and short rotors, and d close to d_c on either side.
EXTREMES = (
    (0.02, 1.2),
    (20.0, 0.3),
    (0.9 / math.sin(0.8) ** 2, 0.8),
    (1.02 / math.sin(0.8) ** 2, 0.8),
)
UNIFORM = [
    (STRONG_WOBBLER, 1001, None),
    *((example, 3, None) for example in (FLIPPER, SPINNER)),
    *((example, 200, None) for example in (WIDE_FLIPPER, WIDE_SPINNER)),
]
DEVIATING = [
    *((example, 3, 5) for example in CLASSES),
    (FLIPPER, 20, 5),
    (SPINNER, 60, 5),
    (STRONG_WOBBLER, 20, 1),
]
UNUSUAL = [
    *((example, 5, None) for example in EXTREMES),
    (NARROW, 5, None),
    (NARROW, 201, None),
]
ARGUMENTS = ('example', 'rotors', 'seed')
ANY_ORBIT = pytest.mark.parametrize(ARGUMENTS, [*UNIFORM, *DEVIATING])
UNUSUAL_ORBITS_TOO = pytest.mark.parametrize(ARGUMENTS, [*UNIFORM, *DEVIATING, *UNUSUAL])


def orbit_with(example: Example, rotors: int, seed: int | None) -> Orbit:
    """Return the orbit of a chain, with deviations if there is a seed."""
    if seed is None:
        return uniform_orbit(example, rotors)
    return deviating_orbit(example, rotors, seed=seed)


@UNUSUAL_ORBITS_TOO
def test_an_orbit_is_continuous_and_periodic_with_relaxed_springs(example, rotors, seed):
    orbit = orbit_with(example, rotors, seed)
    angles = np.array([orbit.configuration(arc) for arc in some_arcs(orbit, 60)])
    extensions = np.abs(orbit.chain.spring_extensions(angles))
    if seed is None:
        # Neither of the levers of a spring is longer than its rotor.
        assert extensions.max() <= 2 * accuracy(orbit) * orbit.chain.rotor_length
    else:
        assert (extensions / orbit.chain.rest_lengths).max() < 1e-9
    step = 1e-8
    for seam in [orbit.leg_arcs(leg)[1] for leg in range(orbit.number_of_legs)]:
        before, after = orbit.configuration(seam - step), orbit.configuration(seam + step)
        assert distance(before, after) <= 2 * step + accuracy(orbit)
    for arc in some_arcs(orbit, 3):
        later = orbit.configuration(arc + 3 * orbit.length)
        assert distance(orbit.configuration(arc), later) < accuracy(orbit)


@ANY_ORBIT
def test_the_tangent_is_the_zero_mode_and_the_derivative_of_the_angles(example, rotors, seed):
    orbit = orbit_with(example, rotors, seed)
    # A mode turns with the angles at a rate of its curvature, some units.
    limit = 10 * accuracy(orbit)
    ends = [orbit.leg_arcs(leg)[1] for leg in range(orbit.number_of_legs)]
    for arc in some_arcs(orbit, 20):
        angles, tangent = orbit.configuration(arc), orbit.tangent(arc)
        mode = zero_mode(orbit.chain, angles)
        assert np.sign(mode @ tangent) * tangent == pytest.approx(mode, rel=0, abs=limit)
        assert np.linalg.norm(tangent) == pytest.approx(1, abs=limit)
        if min(abs(math.remainder(arc - end, orbit.length)) for end in ends) > 1e-3:
            towards_last = mode_towards_last(orbit.chain, angles) @ tangent
            assert np.sign(towards_last) == (-1) ** orbit.leg(arc)
    errors = []
    for step in (1e-3, 5e-4):
        differences = []
        for arc in some_arcs(orbit, 20):
            moved = orbit.configuration(arc + step) - orbit.configuration(arc - step)
            moved -= 2 * math.pi * np.round(moved / (2 * math.pi))
            differences.append(moved / (2 * step) - orbit.tangent(arc))
        errors.append(np.abs(differences).max())
    # The error of a central difference is of second order in its step.
    assert errors[1] < errors[0] / 3.5 + accuracy(orbit) / 5e-4
    assert errors[0] < 1e-3 + accuracy(orbit) / 1e-3


@ANY_ORBIT
def test_the_wall_moves_along_each_leg_without_reversing(example, rotors, seed):
    orbit, uniform = orbit_with(example, rotors, seed), uniform_orbit(example, rotors)
    assert orbit.number_of_legs == (2 if orbit.chain.motion is Motion.SPINNER else 4)
    assert orbit.leg_arcs(0)[0] == 0
    assert orbit.leg_arcs(orbit.number_of_legs - 1)[1] == orbit.length
    for leg in range(orbit.number_of_legs):
        begin, end = orbit.leg_arcs(leg)
        arcs = np.linspace(begin, end, 200)[1:-1].tolist()
        assert {orbit.leg(arc) for arc in arcs} == {leg}
        sites = np.array([orbit.site(arc) for arc in arcs])
        assert 0 <= sites.min() <= sites.max() <= rotors - 1
        steps = np.diff(sites) * (-1) ** leg
        inside = (sites > sites.min() + 1e-9) & (sites < sites.max() - 1e-9)
        assert (steps >= 0).all()
        assert (steps[inside[1:] & inside[:-1]] > 0).all()
        at_ends = [uniform.site(arc) for arc in uniform.leg_arcs(leg)]
        assert [orbit.site(begin), orbit.site(end)] == pytest.approx(at_ends, abs=1e-6)


@ANY_ORBIT
@settings(deadline=None, max_examples=10)
@given(part=st.floats(0, 1), leg=st.integers(0, 3), cycles=st.integers(-3, 3))
def test_site_and_arc_are_inverse_functions_with_the_slope_of_the_site_arc(
    example, rotors, seed, part, leg, cycles
):
    orbit = orbit_with(example, rotors, seed)
    leg %= orbit.number_of_legs
    site = 0.5 + part * (rotors - 2)
    arc = orbit.arc_at(site, leg) + cycles * orbit.length
    assert orbit.leg(arc) == leg
    limit = 1e-11 * rotors if seed is None else 1e-9
    assert orbit.site(arc) == pytest.approx(site, rel=0, abs=limit)
    step = 1e-4 if part < 0.5 else -1e-4
    slope = abs((orbit.arc_at(site + step, leg) - orbit.arc_at(site, leg)) / step)
    assert orbit.site_arc_at(arc) == pytest.approx(slope, rel=0.01)


@pytest.mark.parametrize(
    ARGUMENTS, [*((each, 200, None) for each in EXAMPLES), *((each, 60, 5) for each in CLASSES)]
)
def test_rotors_outside_the_segment_are_at_rest_as_in_the_background(example, rotors, seed):
    orbit = orbit_with(example, rotors, seed)
    limit = accuracy(orbit)
    for arc in some_arcs(orbit, 12):
        segment = orbit.segment(arc)
        first, last = segment.first, segment.first + len(segment.angles) - 1
        mode = zero_mode(orbit.chain, orbit.configuration(arc))
        assert np.abs(np.delete(mode, np.arange(first, last + 1))).max(initial=0.0) < limit
        for rotor, side in zip((first, last), orbit.background(arc), strict=True):
            extensions = orbit.chain.spring_extensions(side) / orbit.chain.rest_lengths
            assert np.abs(extensions[1:-1]).max() < 1e-9
            if 0 < rotor < rotors - 1:
                at_edge = segment.angles[rotor - first]
                assert abs(math.remainder(at_edge - side[rotor], math.tau)) < limit


def compare_with_linkage(orbit: Orbit, start: float, limit: float) -> None:
    """Compare with the orbit of the linkage, which may run in the other direction."""
    sampled = closed_orbit(orbit.chain, orbit.configuration(start))
    sense = float(sampled.directions[0])
    assert sampled.length == pytest.approx(orbit.length, rel=0, abs=limit)
    for arc in np.linspace(0, sampled.length, 40).tolist():
        there = orbit.configuration(start + sense * arc)
        assert distance(there, sampled.configuration(arc)) < limit
    assert len(sampled.reflections) == orbit.number_of_legs
    turns = [(start + sense * arc, edge) for arc, edge in sampled.reflections]
    for leg in range(orbit.number_of_legs):
        end = orbit.leg_arcs(leg)[1]
        apart = [abs(math.remainder(arc - end, orbit.length)) for arc, _ in turns]
        assert min(apart) < limit
        assert turns[int(np.argmin(apart))][1] is (Edge.LAST if leg % 2 == 0 else Edge.FIRST)


@pytest.mark.parametrize(
    ('example', 'rotors', 'limit'),
    [
        *((example, 5, FOLLOWED) for example in EXAMPLES),
        *((example, 4, FOLLOWED) for example in CLASSES),
        # Longer than the short chain: four legs, each with the cut tails of the zero mode.
        (NARROW, 15, 4e-6),
    ],
)
def test_a_uniform_orbit_is_the_closed_orbit_of_the_linkage(example, rotors, limit):
    orbit = uniform_orbit(example, rotors)
    start = orbit.arc_at(orbit.middle, 0)
    wall = static_wall(orbit.chain, orbit.middle)
    assert distance(orbit.configuration(start), wall) < limit
    compare_with_linkage(orbit, start, limit)


@pytest.mark.parametrize('example', CLASSES)
def test_a_deviating_orbit_is_the_closed_orbit_of_the_linkage(example):
    # Without deviations of the moments of inertia that has the same arc length.
    drawn = drawn_deviations(5, 2, spacing=0.05, rest_length=0.05)
    orbit = DeviatingOrbit(dataclasses.replace(chain_of(example, 5), deviations=drawn))
    compare_with_linkage(orbit, orbit.arc_at(2.0, 0), FOLLOWED)


def test_orbit_of_takes_deviations_into_account():
    assert isinstance(orbit_of(chain_of(WOBBLER, 8)), UniformOrbit)
    deviating = deviating_orbit(FLIPPER, 8).chain
    orbit = orbit_of(deviating)
    assert isinstance(orbit, DeviatingOrbit)
    assert orbit.chain == deviating


def test_chains_that_cannot_have_a_wall_are_rejected():
    for rotors, periodic in [(2, False), (2, True), (20, True)]:
        for orbit in [UniformOrbit, DeviatingOrbit]:
            chain = dataclasses.replace(chain_of(FLIPPER, rotors), periodic=periodic)
            with pytest.raises(
                ValueError, match=f'chain of {rotors} rotors .* give it 3 rotors or more'
            ):
                orbit(chain)
