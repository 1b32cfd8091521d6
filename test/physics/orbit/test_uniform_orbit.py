# SPDX-License-Identifier: Apache-2.0
"""The orbit of a chain of any length, composed from the orbit of a short chain."""

import dataclasses
import math

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, SPINNER, WOBBLER, chain_of
from linkage_motion import distance
from orbits import ACCURACY_UNIFORM, uniform_orbit

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import static_wall


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_orbit_is_continuous_where_the_short_chain_repeats(example):
    orbit = uniform_orbit(example, 1001)
    step = 1e-8
    middle = orbit.arc_at(orbit.middle, 1)
    # The segment moves by two rotors somewhere within two spacings.
    low, high = middle + 0.1 * orbit.site_arc, middle + 2.1 * orbit.site_arc
    first = orbit.segment(low).first
    assert orbit.segment(high).first == first - 2
    while high - low > step:
        between = (low + high) / 2
        same = orbit.segment(between).first == first
        low, high = (between, high) if same else (low, between)
    jump = distance(orbit.configuration(low), orbit.configuration(high))
    assert jump <= step + ACCURACY_UNIFORM


def test_springs_are_relaxed_if_the_last_step_to_a_middle_is_very_short():
    chain = Chain(10, 1.0015709382109532, 0.5134515980453058, 1.009888303195124)
    orbit = UniformOrbit(chain)
    for arc in np.linspace(0, orbit.length, 400).tolist():
        lengths = chain.springs(orbit.configuration(arc))[0]
        assert np.abs(lengths / chain.spacing).max() < 1e-6


EDGES = [
    (chain_of((0.1277, 0.9), 40), 1e-6),
    (chain_of((2.463, 1.1), 30), 3e-6),
    *((chain_of(each, rotors), 1e-5) for each in (FLIPPER, SPINNER) for rotors in (3, 4)),
    (chain_of(WOBBLER, 5), 1e-5),
]


@pytest.mark.parametrize(('chain', 'accuracy'), EDGES)
def test_the_site_is_the_argument_of_static_wall_up_to_the_edges(chain, accuracy):
    orbit = UniformOrbit(chain)
    last = chain.number_of_rotors - 1
    for leg in range(orbit.number_of_legs):
        for site in np.linspace(0.05, last - 0.05, 40).tolist():
            arc = orbit.arc_at(site, leg)
            wall = static_wall(chain, site, leg)
            assert distance(orbit.configuration(arc), wall) < accuracy
            assert orbit.site(arc) == pytest.approx(site, abs=1e-9)
            step = 1e-4 * orbit.site_arc
            slope = abs(orbit.site(arc + step) - orbit.site(arc - step)) / (2 * step)
            assert orbit.site_arc_at(arc) * slope == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_the_segment_does_not_grow_with_the_chain(example):
    long, longest = uniform_orbit(example, 1000), uniform_orbit(example, 100_000)
    for leg in range(long.number_of_legs):
        sizes = [
            len(each.segment(each.arc_at(each.middle, leg)).angles) for each in (long, longest)
        ]
        assert sizes[0] == sizes[1]
    growth = (longest.length - long.length) / long.number_of_legs
    assert growth == pytest.approx(99_000 * long.site_arc, rel=1e-12)
    assert longest.wall_extent == pytest.approx(long.wall_extent, rel=1e-9)


def test_deviations_are_ignored():
    chain = chain_of(WOBBLER, 8)
    drawn = drawn_deviations(8, 3, rotor_length=0.05, spacing=0.05)
    deviating = UniformOrbit(dataclasses.replace(chain, deviations=drawn))
    assert deviating.chain == chain
    assert deviating.length == uniform_orbit(WOBBLER, 8).length


def test_chains_at_the_transition_or_with_too_wide_walls_are_rejected():
    for example, message in [
        ((1 / math.sin(0.8) ** 2, 0.8), 'too near to d_c'),
        ((0.02, 0.001), 'take longer rotors or a larger rest angle'),
    ]:
        with pytest.raises(ValueError, match=message):
            UniformOrbit(chain_of(example, 20))


def test_tangents_of_very_wide_walls_do_not_overflow():
    orbit = UniformOrbit(Chain(number_of_rotors=200, rotor_length=9.5e-05, rest_angle=1.57))
    tangent = orbit.tangent(orbit.arc_at(100.0, 0))
    assert np.linalg.norm(tangent) == pytest.approx(1.0, abs=1e-6)
