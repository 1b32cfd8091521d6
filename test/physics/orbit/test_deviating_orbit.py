# SPDX-License-Identifier: Apache-2.0
"""The orbit of a chain that deviates: that of its linkage, and what a frame tells with it."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, STRONG_WOBBLER, WIDE_FLIPPER, WIDE_SPINNER, WOBBLER, chain_of
from hypothesis import given, settings
from hypothesis import strategies as st
from linkage_motion import distance
from sampled_orbit import closed_orbit

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.estimation.relocalisation import fit_anywhere, fit_near
from soliton_linkage.linear.rigidity import Edge, mode_towards_last, zero_mode
from soliton_linkage.linear.statics import toggled_angle, unstretched
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.deviations import Deviations, drawn_deviations
from soliton_linkage.orbit.deviating_orbit import DeviatingOrbit, orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.passage import find_obstacles
from soliton_linkage_studies.traversal import follow_wall

CLASSES = (FLIPPER, WOBBLER, SPINNER)
LENGTHS = ('rotor_length', 'spacing', 'rest_length')
# Sums of Chebyshev series and tails that are cut [rad].
ACCURATE = 1e-8
Example = tuple[float, float]


def deviating(example: Example, rotors: int, fraction: float = 0.05, seed: int = 0) -> Chain:
    fractions = dict.fromkeys((*LENGTHS, 'mass'), fraction)
    drawn = drawn_deviations(rotors, seed, **fractions)
    return dataclasses.replace(chain_of(example, rotors), deviations=drawn)


@lru_cache(maxsize=64)
def orbit_with(
    example: Example, rotors: int = 20, fraction: float = 0.05, seed: int = 0
) -> DeviatingOrbit:
    return DeviatingOrbit(deviating(example, rotors, fraction, seed))


@lru_cache(maxsize=16)
def orbit_without(example: Example, rotors: int = 20) -> UniformOrbit:
    return UniformOrbit(chain_of(example, rotors))


ANY_ORBIT = pytest.mark.parametrize(
    ('example', 'rotors', 'seed'),
    [
        *((example, rotors, 5) for example in CLASSES for rotors in (3, 20)),
        *((example, 60, 5) for example in (FLIPPER, SPINNER)),
        (STRONG_WOBBLER, 20, 1),
        (WIDE_SPINNER, 20, 0),
    ],
)


def some_arcs(orbit: Orbit, count: int) -> list[float]:
    """Arcs all over the orbit and beyond both of its ends, and next to every reflection."""
    even = np.linspace(-1, orbit.length + 1, count)
    begins = [orbit.leg_arcs(leg)[0] for leg in range(orbit.number_of_legs)]
    return [*even.tolist(), *(begin + by for begin in begins for by in (-0.3, 0.0, 0.4))]


@ANY_ORBIT
def test_every_bar_has_its_length_all_along(example: Example, rotors: int, seed: int) -> None:
    orbit = orbit_with(example, rotors, seed=seed)
    chain = orbit.chain
    angles = np.array([orbit.configuration(arc) for arc in some_arcs(orbit, 150)])
    assert np.abs(chain.spring_extensions(angles) / chain.rest_lengths).max() < 1e-9


@ANY_ORBIT
def test_the_tangent_is_the_zero_mode_towards_the_other_edge(
    example: Example, rotors: int, seed: int
) -> None:
    orbit = orbit_with(example, rotors, seed=seed)
    for arc in some_arcs(orbit, 40):
        angles, tangent = orbit.configuration(arc), orbit.tangent(arc)
        mode = zero_mode(orbit.chain, angles)
        assert np.sign(mode @ tangent) * tangent == pytest.approx(mode, rel=0, abs=ACCURATE)
        ends = [orbit.leg_arcs(leg)[1] for leg in range(orbit.number_of_legs)]
        if min(abs(math.remainder(arc - end, orbit.length)) for end in ends) > 1e-3:
            towards_last = mode_towards_last(orbit.chain, angles) @ tangent
            assert np.sign(towards_last) == (-1) ** orbit.leg(arc)


@ANY_ORBIT
def test_angles_change_by_the_tangent(example: Example, rotors: int, seed: int) -> None:
    orbit = orbit_with(example, rotors, seed=seed)
    errors = []
    for step in (1e-3, 5e-4):
        moved = []
        for arc in some_arcs(orbit, 40):
            way = orbit.configuration(arc + step) - orbit.configuration(arc - step)
            way -= 2 * math.pi * np.round(way / (2 * math.pi))
            moved.append(way / (2 * step) - orbit.tangent(arc))
        errors.append(np.abs(moved).max())
    # A central difference is off by the second order in its step.
    assert errors[1] < errors[0] / 3.5 + ACCURATE / 1e-3
    assert errors[0] < 1e-3


@ANY_ORBIT
def test_it_is_continuous_and_closes(example: Example, rotors: int, seed: int) -> None:
    orbit = orbit_with(example, rotors, seed=seed)
    step = 1e-9
    for seam in [orbit.leg_arcs(leg)[1] for leg in range(orbit.number_of_legs)]:
        before, after = orbit.configuration(seam - step), orbit.configuration(seam + step)
        assert distance(before, after) <= 2 * step + ACCURATE
    for arc in some_arcs(orbit, 10):
        later = orbit.configuration(arc + 3 * orbit.length)
        assert distance(orbit.configuration(arc), later) < ACCURATE


@pytest.mark.parametrize('example', CLASSES)
def test_it_is_the_closed_orbit_of_the_linkage(example: Example) -> None:
    # Without deviations of the moments of inertia that has the same arc length.
    drawn = drawn_deviations(5, 2, spacing=0.05, rest_length=0.05)
    chain = dataclasses.replace(chain_of(example, 5), deviations=drawn)
    orbit = DeviatingOrbit(chain)
    begin = orbit.arc_at(2.0, 0)
    sampled = closed_orbit(chain, orbit.configuration(begin))
    assert sampled.length == pytest.approx(orbit.length, rel=0, abs=ACCURATE)
    sense = float(sampled.directions[0])
    for arc in np.linspace(0, sampled.length, 30).tolist():
        there = orbit.configuration(begin + sense * arc)
        assert distance(there, sampled.configuration(arc)) < ACCURATE
    turns = [begin + sense * arc for arc, _ in sampled.reflections]
    for leg in range(orbit.number_of_legs):
        end = orbit.leg_arcs(leg)[1]
        assert min(abs(math.remainder(arc - end, orbit.length)) for arc in turns) < ACCURATE


@pytest.mark.parametrize('example', CLASSES)
def test_free_motion_runs_round_it_at_the_rate_it_says(example: Example) -> None:
    orbit = orbit_with(example, 8)
    chain, start = orbit.chain, orbit.leg_arcs(0)[0] + 2.0
    angles, tangent = orbit.configuration(start), orbit.tangent(start)
    speed = math.sqrt(float(chain.moments_of_inertia @ tangent**2) / chain.moment_of_inertia)
    # A rate of 1 rad/s in the metric of the moments of inertia, which is kept.
    period = orbit.length / 400
    simulation = RigidSimulation(chain, unstretched(chain, angles), tangent / speed, period)
    arcs = [start]
    for _ in range(400):
        simulation.advance()
        fit = fit_near(orbit, simulation.angles, arcs[-1] + period)
        assert fit.misfit < ACCURATE
        arcs.append(fit.arc)
    middle = (np.array(arcs[1:]) + np.array(arcs[:-1])) / 2
    rates = np.array([orbit.free_rate(arc) for arc in middle.tolist()])
    ends = np.array([orbit.free_rate(arc) for arc in arcs])
    # Simpson's rule; the rate is smooth and nearly 1.
    assert np.diff(arcs) / period == pytest.approx(
        (ends[1:] + 4 * rates + ends[:-1]) / 6, rel=1e-4
    )
    assert np.ptp(rates) > 0.01


@pytest.mark.parametrize('rotors', [5, 20])
@pytest.mark.parametrize('example', [*CLASSES, WIDE_FLIPPER, WIDE_SPINNER])
def test_without_deviations_it_is_that_of_the_uniform_chain(example: Example, rotors: int) -> None:
    orbit, uniform = DeviatingOrbit(chain_of(example, rotors)), orbit_without(example, rotors)
    accurate = 1e-6
    assert orbit.length == pytest.approx(uniform.length, rel=0, abs=accurate)
    assert orbit.site_arc == pytest.approx(uniform.site_arc, rel=accurate)
    for arc in some_arcs(uniform, 60):
        assert distance(orbit.configuration(arc), uniform.configuration(arc)) < accurate
        assert orbit.site(arc) == pytest.approx(uniform.site(arc), rel=0, abs=accurate)
        assert orbit.site_arc_at(arc) == pytest.approx(uniform.site_arc, rel=1e-4)
        assert orbit.free_rate(arc) == pytest.approx(1, abs=1e-12)
        assert uniform.free_rate(arc) == pytest.approx(1, abs=10 * accurate)


@pytest.mark.parametrize('example', [*CLASSES, WIDE_FLIPPER])
def test_the_reflections_of_evenly_built_chains_are_found(example: Example) -> None:
    # Each swing is its own image there, so that pieces begin at the reflections but for rounding.
    for rotors in range(3, 16, 3):
        orbit = DeviatingOrbit(chain_of(example, rotors))
        assert len(set(map(orbit.leg, np.linspace(0, orbit.length, 50)))) == orbit.number_of_legs


@pytest.mark.parametrize('example', CLASSES)
def test_small_deviations_change_it_to_first_order(example: Example) -> None:
    uniform = orbit_without(example)
    places = np.linspace(2, 17, 11).tolist()
    changes = []
    for fraction in (1e-3, 1e-4):
        orbit = orbit_with(example, 20, fraction)
        change = [orbit.length - uniform.length]
        for leg in range(uniform.number_of_legs):
            for place in places:
                arc, other = orbit.arc_at(place, leg), uniform.arc_at(place, leg)
                there, was = orbit.configuration(arc), uniform.configuration(other)
                change += [float(distance(there, was)), arc - other]
                change.append(orbit.site(other) - place)
                change.append(orbit.site_arc_at(arc) - uniform.site_arc)
                change.append(orbit.free_rate(arc) - 1)
        changes.append(np.array(change))
    sizes = np.abs(changes).max(axis=1)
    assert sizes[1] == pytest.approx(sizes[0] / 10, rel=0.1)
    # What is left of each over ten times less of it is of second order.
    assert np.abs(changes[0] - 10 * changes[1]).max() < 0.1 * sizes[0]


@pytest.mark.parametrize('rotors', [7, 8])
@pytest.mark.parametrize('example', CLASSES)
def test_the_mirror_image_of_the_chain_has_the_mirror_image_of_the_orbit(
    example: Example, rotors: int
) -> None:
    orbit = orbit_with(example, rotors)
    deviations = orbit.chain.deviations
    reversed_ones = {
        field.name: getattr(deviations, field.name)[::-1]
        for field in dataclasses.fields(deviations)
    }
    image = dataclasses.replace(orbit.chain, deviations=Deviations(**reversed_ones))
    other = DeviatingOrbit(image)
    assert other.length == pytest.approx(orbit.length, rel=0, abs=ACCURATE)
    turned = (rotors % 2 == 1) == (orbit.chain.motion is Motion.SPINNER)
    for arc in np.linspace(0, orbit.length, 25).tolist():
        angles = orbit.configuration(arc)[::-1]
        mirrored = math.pi + angles if turned else -angles
        there = fit_anywhere(other, mirrored).arc
        assert distance(other.configuration(there), mirrored) < ACCURATE
        place = rotors - 1 - orbit.site(arc)
        assert other.site(there) == pytest.approx(place, rel=0, abs=1e-5)


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER])
def test_legs_of_flippers_end_where_the_edge_rotor_is_in_line_with_its_bar(
    example: Example,
) -> None:
    orbit = orbit_with(example)
    for leg in range(4):
        angles = orbit.configuration(orbit.leg_arcs(leg)[1])
        edge, rotor = (Edge.LAST, -1) if leg % 2 == 0 else (Edge.FIRST, 0)
        apart = math.remainder(toggled_angle(orbit.chain, angles, edge) - angles[rotor], math.tau)
        assert abs(apart) < ACCURATE


@ANY_ORBIT
def test_the_wall_goes_to_and_fro_without_turning_back(
    example: Example, rotors: int, seed: int
) -> None:
    orbit, uniform = orbit_with(example, rotors, seed=seed), orbit_without(example, rotors)
    assert orbit.leg_arcs(0)[0] == 0
    assert orbit.leg_arcs(orbit.number_of_legs - 1)[1] == orbit.length
    for leg in range(orbit.number_of_legs):
        begin, end = orbit.leg_arcs(leg)
        arcs = np.linspace(begin, end, 400)[1:-1].tolist()
        assert {orbit.leg(arc) for arc in arcs} == {leg}
        places = np.array([orbit.site(arc) for arc in arcs]) * (-1) ** leg
        assert (np.diff(places) >= 0).all()
        inside = (places > places.min() + 1e-9) & (places < places.max() - 1e-9)
        assert (np.diff(places[inside]) > 0).all()
        at_ends = [uniform.site(arc) for arc in uniform.leg_arcs(leg)]
        assert [orbit.site(begin), orbit.site(end)] == pytest.approx(at_ends, abs=1e-6)


@pytest.mark.parametrize('example', CLASSES)
@settings(deadline=None, max_examples=20)
@given(share=st.floats(0, 1), leg=st.integers(0, 3), orbits=st.integers(-3, 3))
def test_place_and_arc_are_inverse_and_the_site_arc_is_their_slope(
    example: Example, share: float, leg: int, orbits: int
) -> None:
    orbit = orbit_with(example)
    leg %= orbit.number_of_legs
    place = 0.5 + share * 18
    arc = orbit.arc_at(place, leg) + orbits * orbit.length
    assert orbit.leg(arc) == leg
    assert orbit.site(arc) == pytest.approx(place, rel=0, abs=1e-9)
    step = 1e-4 if share < 0.5 else -1e-4
    slope = abs((orbit.arc_at(place + step, leg) - orbit.arc_at(place, leg)) / step)
    assert orbit.site_arc_at(arc) == pytest.approx(slope, rel=0.01)


@pytest.mark.parametrize('example', CLASSES)
def test_half_of_the_mode_is_on_either_side_of_a_wall_between_rotors(example: Example) -> None:
    orbit = orbit_with(example, 60, seed=5)
    for bond in range(25, 35):
        for leg in range(orbit.number_of_legs):
            tangent = orbit.tangent(orbit.arc_at(bond + 0.5, leg))
            left = float(tangent[: bond + 1] @ tangent[: bond + 1])
            assert left == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize('example', CLASSES)
def test_rotors_beyond_a_stretch_stand_still_as_in_the_background(example: Example) -> None:
    orbit = orbit_with(example, 60, seed=5)
    chain = orbit.chain
    for arc in some_arcs(orbit, 20):
        left, right = orbit.background(arc)
        for side in (left, right):
            extensions = chain.spring_extensions(side) / chain.rest_lengths
            assert np.abs(extensions).max() < 1e-9
        about = orbit.segment(arc)
        for beyond, angles in ((about.first, left), (about.first + len(about.angles) - 1, right)):
            if 0 < beyond < 59:
                at_edge = about.angles[beyond - about.first]
                assert abs(math.remainder(at_edge - angles[beyond], math.tau)) < ACCURATE


def noisy(orbit: Orbit, arc: float, sigma: float, frames: int) -> Array:
    random = np.random.default_rng(7)
    there = orbit.configuration(arc)
    return there + random.normal(0, sigma, (frames, len(there)))


@pytest.mark.parametrize('example', CLASSES)
def test_frames_are_measured_at_the_bound_and_worse_without_the_deviations(
    example: Example,
) -> None:
    orbit, uniform = orbit_with(example, 40, seed=5), orbit_without(example, 40)
    sigma, frames = 0.01, 300
    errors, without = [], []
    for place, leg in ((12.3, 0), (20.0, 1), (27.8, 0)):
        arc = orbit.arc_at(place, leg)
        made = noisy(orbit, arc, sigma, frames)
        errors += [fit_near(orbit, frame, arc).arc - arc for frame in made]
        beside = uniform.arc_at(place, leg)
        found = [uniform.site(fit_near(uniform, frame, beside).arc) - place for frame in made]
        without += (np.array(found) * orbit.site_arc).tolist()
    # The deviation of 900 errors scatters by 2.4 %, their mean by a thirtieth of one.
    assert np.std(errors) == pytest.approx(sigma, rel=0.08)
    assert abs(np.mean(errors)) < 4 * sigma / math.sqrt(len(errors))
    assert np.sqrt(np.mean(np.square(without))) > 2 * sigma


@pytest.mark.parametrize('example', CLASSES)
def test_frames_are_found_from_anywhere(example: Example) -> None:
    orbit = orbit_with(example, 40, seed=5)
    for arc in np.linspace(0, orbit.length, 25).tolist():
        fit = fit_anywhere(orbit, noisy(orbit, arc, 0.01, 1)[0])
        assert abs(math.remainder(fit.arc - arc, orbit.length)) < 6 * 0.01
        assert fit.misfit < 2 * 0.01


def test_the_filter_follows_the_chain_of_springs() -> None:
    orbit = orbit_with(FLIPPER, 14)
    chain, start = orbit.chain, 3.0
    angles = unstretched(chain, orbit.configuration(start))
    simulation = ElasticSimulation(chain, angles, 10 * orbit.tangent(start), 2e-3)
    random = np.random.default_rng(6)
    tracker, arc = OrbitFilter(orbit, 0.01), start
    errors = []
    for frame in range(400):
        truth = fit_near(orbit, simulation.angles, arc).arc
        seen = simulation.angles + random.normal(0, 0.01, 14)
        estimate = tracker.update(2e-3 * frame, seen)
        errors.append(math.remainder(estimate.arc - truth, orbit.length))
        arc = truth + 10 * 2e-3
        simulation.advance()
    assert arc > start + 6
    assert tracker.starts == 1
    # The nearest point to a single frame is off by 0.01 rad.
    assert np.sqrt(np.mean(np.square(errors[20:]))) < 0.02


def test_an_orbit_is_taken_as_the_chain_deviates() -> None:
    chain = chain_of(FLIPPER, 8)
    assert isinstance(orbit_of(chain), UniformOrbit)
    deviating_chain = deviating(FLIPPER, 8)
    orbit = orbit_of(deviating_chain)
    assert isinstance(orbit, DeviatingOrbit)
    assert orbit.chain == deviating_chain


def test_memory_grows_as_the_chain_is_long() -> None:
    pieces = {}
    for rotors in (60, 120):
        orbit = orbit_with(FLIPPER, rotors, seed=5)
        arcs = np.linspace(0, orbit.length, 10 * rotors).tolist()
        pieces[rotors] = max(len(orbit.segment(arc).angles) for arc in arcs)
    assert pieces[120] <= pieces[60] + 4 < 50


@pytest.mark.parametrize('seed', [1, 4])
def test_a_wall_goes_round_where_the_motion_of_the_linkage_does(seed: int) -> None:
    # Bonds of both may stop the wall, and one of them does.
    chain = deviating(FLIPPER, 40, seed=seed)
    assert find_obstacles(chain)
    if follow_wall(chain)[-1].crossed:
        assert DeviatingOrbit(chain).number_of_legs == 4
    else:
        with pytest.raises(ValueError, match=r'cannot pass rotor 1\d .* bond 1[15], .* lower'):
            DeviatingOrbit(chain)


def test_a_wall_that_cannot_get_through_is_refused_in_words() -> None:
    chain = chain_of(SPINNER, 12)
    lengths = [0.0] * 12
    lengths[7] = -0.5
    drawn = Deviations(rotor_length=tuple(lengths))
    blocked = dataclasses.replace(chain, deviations=drawn)
    with pytest.raises(ValueError, match=r'cannot pass rotor .* bond [67].* lower the dev'):
        DeviatingOrbit(blocked)


def test_chains_without_a_wall_and_those_that_take_too_long_are_refused() -> None:
    with pytest.raises(ValueError, match='give it 3 rotors or more'):
        DeviatingOrbit(chain_of(FLIPPER, 2))
    periodic = dataclasses.replace(chain_of(FLIPPER, 20), periodic=True)
    with pytest.raises(ValueError, match='give it 3 rotors or more and free ends'):
        DeviatingOrbit(periodic)
    with pytest.raises(ValueError, match='take fewer rotors'):
        DeviatingOrbit(deviating(WOBBLER, 50_000, 0.01))
