# SPDX-License-Identifier: Apache-2.0
"""The closed orbit: its length, its reflections, its turns, and what it is between samples."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache

import numpy as np
import pytest
from chains import EPS, EXAMPLES, FLIPPER, SPINNER, STRONG_WOBBLER, WIDE_SPINNER, WOBBLER, chain_of
from hypothesis import given, settings
from hypothesis import strategies as st
from linkage_motion import distance

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linear.statics import length_rounding, rest_state, toggled_angle, unstretched
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage_studies.closed_orbit import SampledOrbit, closed_orbit

CLASSES = (FLIPPER, WOBBLER, SPINNER)
EDGES = (Edge.FIRST, Edge.LAST)
# Error of the solver along a whole orbit [rad].
FOLLOWED = 1e-9


def orbit_of(example: tuple[float, float], rotors: int = 8, spacing: float = 0.05) -> SampledOrbit:
    return orbit_around_a_wall(chain_of(example, rotors), spacing)


@lru_cache(maxsize=64)
def orbit_around_a_wall(chain: Chain, spacing: float) -> SampledOrbit:
    return closed_orbit(chain, static_wall(chain, 3.3), spacing)


@lru_cache(maxsize=16)
def orbit_from_rest(chain: Chain) -> SampledOrbit:
    return closed_orbit(chain, rest_state(chain, 1))


def legs_of(chain: Chain) -> int:
    return 2 if chain.motion is Motion.SPINNER else 4


def deviating_chain(example: tuple[float, float], rotors: int = 8) -> Chain:
    fractions = {'spacing': 0.01, 'rotor_length': 0.01, 'rest_length': 0.01, 'mass': 0.2}
    deviations = drawn_deviations(rotors, 3, **fractions)
    return dataclasses.replace(chain_of(example, rotors), deviations=deviations)


def length_in_metric(chain: Chain, change: Array) -> Array:
    """sqrt(sum_n (I_n / I) dphi_n^2) [rad]."""
    weights = chain.moments_of_inertia / chain.moment_of_inertia
    return np.asarray(np.sqrt(np.sum(weights * change**2, axis=-1)))


def arc_of(orbit: SampledOrbit, angles: Array) -> float:
    """Arc at which an orbit is nearest to a configuration: a sample, then steps along it."""
    near = int(np.argmax(np.cos(orbit.angles - angles).sum(axis=1)))
    arc = float(orbit.arcs[near])
    for _ in range(6):
        step = 1e-3
        tangent = (orbit.configuration(arc + step) - orbit.configuration(arc - step)) / (2 * step)
        weights = orbit.chain.moments_of_inertia / orbit.chain.moment_of_inertia
        arc += float((weights * tangent) @ np.sin(angles - orbit.configuration(arc)))
    return arc


@pytest.mark.parametrize('example', EXAMPLES)
def test_every_sample_is_relaxed_and_the_last_is_the_first(example: tuple[float, float]) -> None:
    orbit = orbit_of(example)
    chain = orbit.chain
    assert np.abs(chain.spring_extensions(orbit.angles)).max() <= length_rounding(chain)
    turned = orbit.angles[-1] - orbit.angles[0]
    assert turned == pytest.approx(2 * math.pi * orbit.turns, rel=0, abs=1e-12)
    assert orbit.arcs[0] == 0
    assert orbit.arcs[-1] == orbit.length


@pytest.mark.parametrize('example', EXAMPLES)
def test_a_rotor_more_makes_every_leg_a_site_longer(example: tuple[float, float]) -> None:
    shorter, longer = orbit_of(example), orbit_of(example, 9)
    growth = (longer.length - shorter.length) / legs_of(shorter.chain)
    # A wall on the two rotors of one edge reaches the other as its zero mode does.
    limit = FOLLOWED + math.exp(-6 * shorter.chain.spacing / penetration_depth(shorter.chain))
    assert growth == pytest.approx(site_arc(shorter.chain), rel=0, abs=limit)


@pytest.mark.parametrize(
    ('example', 'expected'),
    [
        (FLIPPER, 1.194),
        ((0.8, 0.77), 1.517),
        (WOBBLER, 1.644),
        (STRONG_WOBBLER, 1.474),
        (WIDE_SPINNER, 16.9),
    ],
)
def test_the_swing_at_an_edge_is_that_of_an_independent_program(
    example: tuple[float, float], expected: float
) -> None:
    rotors = 16 if example == WIDE_SPINNER else 8
    orbit = orbit_of(example, rotors)
    swing = orbit.length / legs_of(orbit.chain) - (rotors - 1) * site_arc(orbit.chain)
    # Half a unit of the last digit given.
    digits = 0.05 if example == WIDE_SPINNER else 5e-4
    assert swing * example[0] == pytest.approx(expected, abs=digits)


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, STRONG_WOBBLER])
def test_a_flipper_is_itself_again_after_two_round_trips_but_for_its_edges_after_one(
    example: tuple[float, float],
) -> None:
    orbit = orbit_of(example)
    assert (orbit.turns == 0).all()
    start = orbit.configuration(0.0)
    half = static_wall(orbit.chain, 3.3, 2)
    assert distance(orbit.configuration(arc_of(orbit, half)), half) < FOLLOWED
    assert arc_of(orbit, half) == pytest.approx(orbit.length / 2, abs=0.5 * orbit.length / 4)
    assert distance(half[1:-1], start[1:-1]) < 1e-12
    edges = np.abs(np.angle(np.exp(1j * (half - start)))[[0, -1]])
    assert 1.4 < edges.max() < 2.6


@pytest.mark.parametrize('rotors', [8, 9])
@pytest.mark.parametrize('example', [SPINNER, WIDE_SPINNER])
def test_every_rotor_of_a_spinner_turns_once_in_the_same_sense_in_a_cycle(
    example: tuple[float, float], rotors: int
) -> None:
    turns = orbit_of(example, rotors).turns
    assert np.abs(turns[0]) == 1
    assert (turns == turns[0]).all()


@pytest.mark.parametrize('rotors', [8, 9])
@pytest.mark.parametrize('example', EXAMPLES)
def test_the_wall_is_reflected_at_the_last_and_the_first_edge_by_turns(
    example: tuple[float, float], rotors: int
) -> None:
    orbit = orbit_of(example, rotors)
    edges = [edge for _, edge in orbit.reflections]
    assert len(edges) == legs_of(orbit.chain)
    assert edges[::2] == [edges[0]] * (len(edges) // 2)
    assert edges[1::2] == [edges[1]] * (len(edges) // 2)
    assert set(edges) == set(EDGES)
    if len(edges) == 4:
        # Two legs are each other's mirror image, from one edge to the other and back.
        arcs = np.array([arc for arc, _ in orbit.reflections])
        ways = np.diff([*arcs, arcs[0] + orbit.length])
        apart = np.abs(ways[:2] - ways[2:])
        assert min(apart) < 1e-8
        assert max(apart) > 1e-3


@pytest.mark.parametrize('rotors', [8, 9])
@pytest.mark.parametrize('example', [FLIPPER, (0.5, 0.3), WOBBLER, STRONG_WOBBLER])
def test_a_flipper_is_reflected_where_its_edge_rotor_passes_its_toggled_angle(
    example: tuple[float, float], rotors: int
) -> None:
    orbit = orbit_of(example, rotors)
    for arc, edge in orbit.reflections:
        angles = orbit.configuration(arc)
        rotor = 0 if edge is Edge.FIRST else -1
        apart = math.remainder(toggled_angle(orbit.chain, angles, edge) - angles[rotor], math.tau)
        # Half of it is the angle that the edge rotor is from the line, in steps of 1e-10.
        assert abs(apart) < 1e-8


@pytest.mark.parametrize('example', CLASSES)
def test_the_orbit_is_the_same_wherever_it_starts(example: tuple[float, float]) -> None:
    orbit = orbit_of(example)
    chain = orbit.chain
    elsewhere = closed_orbit(chain, static_wall(chain, 2.1, legs_of(chain) - 1))
    for other in (elsewhere, orbit_from_rest(chain)):
        assert other.length == pytest.approx(orbit.length, rel=0, abs=FOLLOWED)
        for sample in range(0, len(other.arcs), len(other.arcs) // 5):
            angles = other.angles[sample]
            again = orbit.configuration(arc_of(orbit, angles))
            assert distance(again, angles) < FOLLOWED


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_an_orbit_of_a_whole_number_of_spacings_closes(example: tuple[float, float]) -> None:
    length = orbit_of(example).length
    orbit = orbit_of(example, spacing=length / 500)
    assert orbit.length == pytest.approx(length, rel=0, abs=FOLLOWED)
    assert len(orbit.arcs) == 501


@pytest.mark.parametrize('example', CLASSES)
def test_length_and_configurations_do_not_depend_on_the_spacing_of_the_samples(
    example: tuple[float, float],
) -> None:
    finest = orbit_of(example, spacing=0.025)
    errors = []
    for spacing in (0.2, 0.1, 0.05):
        orbit = orbit_of(example, spacing=spacing)
        assert orbit.length == pytest.approx(finest.length, rel=0, abs=FOLLOWED)
        apart = [
            float(distance(orbit.configuration(arc), finest.configuration(arc)))
            for arc in np.linspace(0, finest.length, 101).tolist()
        ]
        errors.append(max(apart))
    # A spline of degree 7 falls short by spacing^8; 2^5 leaves room for the worst places.
    assert errors[1] < errors[0] / 32
    assert errors[2] < FOLLOWED


def orbits_with_and_without_deviations() -> list[Chain]:
    return [chain_of(example, 8) for example in CLASSES] + [
        deviating_chain(example) for example in CLASSES
    ]


@pytest.mark.parametrize('chain', orbits_with_and_without_deviations())
def test_the_arc_is_the_length_in_the_metric_of_the_inertia(chain: Chain) -> None:
    orbit = orbit_from_rest(chain)
    step = 1e-3
    for arc in np.linspace(0, orbit.length, 50).tolist():
        change = orbit.configuration(arc + step) - orbit.configuration(arc - step)
        # Chords are shorter than arcs by a share of the squared curvature, at most some units.
        length = float(length_in_metric(chain, change))
        assert length == pytest.approx(2 * step, rel=20 * step**2)


@pytest.mark.parametrize('chain', orbits_with_and_without_deviations())
def test_chains_with_deviations_have_the_same_topology_of_orbit(chain: Chain) -> None:
    orbit = orbit_from_rest(chain)
    assert np.abs(chain.spring_extensions(orbit.angles)).max() <= length_rounding(chain)
    spinner = chain.motion is Motion.SPINNER
    assert len(orbit.reflections) == legs_of(chain)
    assert (np.abs(orbit.turns) == (1 if spinner else 0)).all()
    assert np.ptp(orbit.turns) == 0


@settings(deadline=None, max_examples=40)
@given(st.sampled_from(EXAMPLES), st.floats(-300, 300), st.integers(-3, 3))
def test_configurations_are_relaxed_and_periodic_but_for_turns(
    example: tuple[float, float], arc: float, orbits: int
) -> None:
    orbit = orbit_of(example)
    angles = orbit.configuration(arc)
    chain = orbit.chain
    # Angles of many turns are rounded by EPS of themselves.
    limit = length_rounding(chain) + 2 * EPS * float(np.abs(angles).max()) * chain.rotor_length
    assert np.abs(chain.spring_extensions(angles)).max() <= limit
    later = orbit.configuration(arc + orbits * orbit.length)
    turned = 2 * math.pi * orbits * orbit.turns
    assert later == pytest.approx(angles + turned, rel=0, abs=1e-11)


@pytest.mark.parametrize('example', CLASSES)
def test_samples_are_configurations_of_their_arcs(example: tuple[float, float]) -> None:
    orbit = orbit_of(example)
    for sample in range(0, len(orbit.arcs), 37):
        arc = float(orbit.arcs[sample])
        assert distance(orbit.configuration(arc), orbit.angles[sample]) < 1e-12


@pytest.mark.parametrize('example', EXAMPLES)
def test_walls_at_rest_lie_on_the_orbit_in_the_order_of_their_legs(
    example: tuple[float, float],
) -> None:
    orbit = orbit_of(example)
    chain = orbit.chain
    arcs = []
    for leg in range(legs_of(chain)):
        for place in (3.3, 4.1):
            angles = static_wall(chain, place, leg)
            arc = arc_of(orbit, angles)
            assert distance(orbit.configuration(arc), angles) < FOLLOWED
            arcs.append(arc % orbit.length)
    onwards = np.diff(np.append(arcs[::2], arcs[0])) % orbit.length
    backwards = -np.diff(np.append(arcs[::2], arcs[0])) % orbit.length
    assert min(onwards.sum(), backwards.sum()) == pytest.approx(orbit.length, rel=1e-12)


@settings(deadline=None, max_examples=40)
@given(st.sampled_from(EXAMPLES), st.floats(0, 300), st.sampled_from(EDGES))
def test_a_toggled_edge_rotor_keeps_its_bar_and_toggles_back(
    example: tuple[float, float], arc: float, edge: Edge
) -> None:
    orbit = orbit_of(example)
    angles = orbit.configuration(arc)
    toggled = angles.copy()
    rotor = 0 if edge is Edge.FIRST else -1
    toggled[rotor] = toggled_angle(orbit.chain, angles, edge)
    rounding = length_rounding(orbit.chain)
    assert np.abs(orbit.chain.spring_extensions(toggled)).max() <= 4 * rounding
    again = math.remainder(toggled_angle(orbit.chain, toggled, edge) - angles[rotor], math.tau)
    assert abs(again) < 1e-11


@pytest.mark.parametrize('rotors', [20, 21])
@pytest.mark.parametrize('turned', [False, True])
@pytest.mark.parametrize('example', [FLIPPER, (0.5, 0.3), WOBBLER, STRONG_WOBBLER])
def test_toggling_an_edge_rotor_leads_to_the_leg_beyond_its_reflection(
    example: tuple[float, float], turned: bool, rotors: int
) -> None:
    chain = chain_of(example, rotors)
    # Leg 0 ends at the last rotor, 1 at the first, 2 at the last and 3 at the first.
    for leg, edge in enumerate([Edge.LAST, Edge.FIRST, Edge.LAST, Edge.FIRST]):
        angles = static_wall(chain, 9.3, leg, turned)
        angles[0 if edge is Edge.FIRST else -1] = toggled_angle(chain, angles, edge)
        following = static_wall(chain, 9.3, (leg + 1) % 4, turned)
        assert distance(angles, following) < 1e-12


@pytest.mark.parametrize('example', CLASSES)
def test_toggling_obeys_the_deviating_lengths_of_its_edge(example: tuple[float, float]) -> None:
    chain = deviating_chain(example)
    angles = rest_state(chain, 1)
    for edge in EDGES:
        toggled = angles.copy()
        toggled[0 if edge is Edge.FIRST else -1] = toggled_angle(chain, angles, edge)
        assert np.abs(chain.spring_extensions(toggled)).max() <= 4 * length_rounding(chain)


@pytest.mark.parametrize('example', EXAMPLES)
def test_directions_change_sign_with_the_leg_and_tell_where_the_wall_goes(
    example: tuple[float, float],
) -> None:
    orbit = orbit_of(example)
    chain = orbit.chain
    assert set(orbit.directions.tolist()) == {-1, 1}
    for leg in range(legs_of(chain)):
        here, there = (arc_of(orbit, static_wall(chain, 3.3 + by, leg)) for by in (0, 0.5))
        sample = int(np.searchsorted(orbit.arcs, here % orbit.length)) - 1
        onwards = math.remainder(there - here, orbit.length)
        assert np.sign(onwards) == orbit.directions[sample]


@pytest.mark.parametrize('rotors', [2, 3])
@pytest.mark.parametrize('example', CLASSES)
def test_the_shortest_chains_have_an_orbit(example: tuple[float, float], rotors: int) -> None:
    chain = chain_of(example, rotors)
    orbit = closed_orbit(chain, chain.uniform_state(-1))
    finer = closed_orbit(chain, unstretched(chain, orbit.configuration(1.0)), 0.03)
    assert finer.length == pytest.approx(orbit.length, rel=0, abs=FOLLOWED)


@pytest.mark.parametrize('spacing', [0.0, -0.05, math.nan, math.inf, 0.26])
def test_a_spacing_that_draws_no_curve_is_refused(spacing: float) -> None:
    chain = chain_of(FLIPPER, 5)
    with pytest.raises(ValueError, match=r'spacing = .* rad must lie above 0 and up to 0.25'):
        closed_orbit(chain, static_wall(chain, 2.0), spacing)


def test_a_ring_has_no_orbit() -> None:
    ring = dataclasses.replace(chain_of(FLIPPER, 8), periodic=True)
    with pytest.raises(ValueError, match='periodic ends'):
        closed_orbit(ring, ring.uniform_state(1))


@pytest.mark.parametrize('beyond', [0.0, 5e-10, -5e-10])
def test_an_orbit_at_the_transition_to_spinners_is_refused(beyond: float) -> None:
    chain = chain_of(((1 + beyond) / math.sin(0.77) ** 2, 0.77), 6)
    with pytest.raises(ValueError, match=r'd = 2\.873.* too near to d_c = 2\.873.*; take d'):
        closed_orbit(chain, chain.uniform_state(1))
