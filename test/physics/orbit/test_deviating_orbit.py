# SPDX-License-Identifier: Apache-2.0
"""The orbit of a chain whose rotors and springs deviate, and measurements of frames with it."""

import dataclasses
import math

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, SPINNER, WIDE_FLIPPER, WOBBLER, chain_of
from linkage_motion import distance
from orbits import deviating_chain, deviating_orbit, some_arcs, uniform_orbit

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.estimation.relocalisation import fit_anywhere, fit_near
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.orbit.deviating_orbit import DeviatingOrbit
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.passage import find_obstacles
from soliton_linkage_studies.measures import follow_wall

ACCURATE = 1e-8
"""Accuracy of angles [rad]."""


@pytest.mark.parametrize('example', CLASSES)
def test_free_motion_has_the_free_rate(example):
    orbit = deviating_orbit(example, 8)
    chain, start = orbit.chain, orbit.leg_arcs(0)[0] + 2.0
    angles, tangent = orbit.configuration(start), orbit.tangent(start)
    speed = math.sqrt(float(chain.moments_of_inertia @ tangent**2) / chain.moment_of_inertia)
    # Free motion conserves the rate of 1 rad/s in the metric of the moments of inertia.
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


@pytest.mark.parametrize(
    ('example', 'rotors'),
    [(FLIPPER, 3), (SPINNER, 3), (WOBBLER, 20), (SPINNER, 20), (WIDE_FLIPPER, 9)],
)
def test_without_deviations_the_orbit_equals_the_uniform_orbit(example, rotors):
    orbit, uniform = DeviatingOrbit(chain_of(example, rotors)), uniform_orbit(example, rotors)
    accurate = 1e-6
    ends = [end for leg in range(uniform.number_of_legs) for end in uniform.leg_arcs(leg)]
    assert orbit.length == pytest.approx(uniform.length, rel=0, abs=accurate)
    assert orbit.site_arc == pytest.approx(uniform.site_arc, rel=accurate)
    for arc in some_arcs(uniform, 60):
        assert distance(orbit.configuration(arc), uniform.configuration(arc)) < accurate
        assert orbit.site(arc) == pytest.approx(uniform.site(arc), rel=0, abs=accurate)
        # At a reflection the slopes of the two legs differ.
        inside = min(abs(arc % uniform.length - end) for end in ends) > 1e-6
        if inside:
            assert orbit.site_arc_at(arc) == pytest.approx(uniform.site_arc_at(arc), rel=1e-4)
        assert orbit.free_rate(arc) == pytest.approx(1, abs=1e-12)
        assert uniform.free_rate(arc) == pytest.approx(1, abs=10 * accurate)


@pytest.mark.parametrize('example', CLASSES)
def test_small_deviations_change_the_orbit_to_first_order(example):
    uniform = uniform_orbit(example)
    sites = np.linspace(2, 17, 11).tolist()
    changes = []
    for fraction in (1e-3, 1e-4):
        orbit = deviating_orbit(example, 20, fraction)
        change = [orbit.length - uniform.length]
        for leg in range(uniform.number_of_legs):
            for site in sites:
                arc, other = orbit.arc_at(site, leg), uniform.arc_at(site, leg)
                there, was = orbit.configuration(arc), uniform.configuration(other)
                change += [float(distance(there, was)), arc - other]
                change.append(orbit.site(other) - site)
                change.append(orbit.site_arc_at(arc) - uniform.site_arc_at(other))
                change.append(orbit.free_rate(arc) - 1)
        changes.append(np.array(change))
    sizes = np.abs(changes).max(axis=1)
    assert sizes[1] == pytest.approx(sizes[0] / 10, rel=0.1)
    # The remainder is of second order.
    assert np.abs(changes[0] - 10 * changes[1]).max() < 0.1 * sizes[0]


@pytest.mark.parametrize(
    ('example', 'rotors'), [(FLIPPER, 7), (WOBBLER, 8), (SPINNER, 7), (SPINNER, 8)]
)
def test_the_mirrored_chain_has_the_mirrored_orbit(example, rotors):
    orbit = deviating_orbit(example, rotors)
    deviations = orbit.chain.deviations
    reversed_deviations = {
        field.name: getattr(deviations, field.name)[::-1]
        for field in dataclasses.fields(deviations)
    }
    image = dataclasses.replace(orbit.chain, deviations=Deviations(**reversed_deviations))
    other = DeviatingOrbit(image)
    assert other.length == pytest.approx(orbit.length, rel=0, abs=ACCURATE)
    turned = (rotors % 2 == 1) == (orbit.chain.motion is Motion.SPINNER)
    for arc in np.linspace(0, orbit.length, 25).tolist():
        angles = orbit.configuration(arc)[::-1]
        mirrored = math.pi + angles if turned else -angles
        there = fit_anywhere(other, mirrored).arc
        assert distance(other.configuration(there), mirrored) < ACCURATE
        site = rotors - 1 - orbit.site(arc)
        assert other.site(there) == pytest.approx(site, rel=0, abs=1e-5)


@pytest.mark.parametrize('example', CLASSES)
def test_a_wall_at_a_bond_has_half_of_the_zero_mode_on_each_side(example):
    orbit = deviating_orbit(example, 60, seed=5)
    for bond in range(25, 35):
        for leg in range(orbit.number_of_legs):
            tangent = orbit.tangent(orbit.arc_at(bond + 0.5, leg))
            left = float(tangent[: bond + 1] @ tangent[: bond + 1])
            assert left == pytest.approx(0.5, abs=1e-6)


def noisy(orbit: Orbit, arc: float, sigma: float, frames: int) -> Array:
    random = np.random.default_rng(7)
    there = orbit.configuration(arc)
    return there + random.normal(0, sigma, (frames, len(there)))


@pytest.mark.parametrize('example', CLASSES)
def test_measured_arcs_reach_the_cramer_rao_bound_with_the_deviations_only(example):
    orbit, uniform = deviating_orbit(example, 40, seed=5), uniform_orbit(example, 40)
    sigma, frames = 0.01, 300
    errors, without = [], []
    for site, leg in ((12.3, 0), (20.0, 1), (27.8, 0)):
        arc = orbit.arc_at(site, leg)
        made = noisy(orbit, arc, sigma, frames)
        errors += [fit_near(orbit, frame, arc).arc - arc for frame in made]
        beside = uniform.arc_at(site, leg)
        found = [uniform.site(fit_near(uniform, frame, beside).arc) - site for frame in made]
        without += (np.array(found) * orbit.site_arc).tolist()
    # The standard deviation of 900 errors scatters by 2.4 %, their mean by 1/30 of it.
    assert np.std(errors) == pytest.approx(sigma, rel=0.08)
    assert abs(np.mean(errors)) < 4 * sigma / math.sqrt(len(errors))
    assert np.sqrt(np.mean(np.square(without))) > 2 * sigma


@pytest.mark.parametrize('seed', [1, 4])
def test_an_orbit_exists_if_the_motion_of_the_linkage_passes(seed):
    # Both chains have blocked bonds, which stop the wall in one of them.
    chain = deviating_chain(FLIPPER, 40, seed=seed)
    assert find_obstacles(chain)
    if follow_wall(chain)[-1].crossed:
        assert DeviatingOrbit(chain).number_of_legs == 4
    else:
        with pytest.raises(ValueError, match=r'cannot pass rotor 1\d .* bond 1[15], .* lower'):
            DeviatingOrbit(chain)


def test_a_blocked_wall_is_rejected_with_its_bond():
    chain = chain_of(SPINNER, 12)
    lengths = [0.0] * 12
    lengths[7] = -0.5
    drawn = Deviations(rotor_length=tuple(lengths))
    blocked = dataclasses.replace(chain, deviations=drawn)
    with pytest.raises(ValueError, match=r'cannot pass rotor .* bond [67].* lower the dev'):
        DeviatingOrbit(blocked)


def test_chains_that_take_too_long_are_rejected():
    with pytest.raises(ValueError, match='take fewer rotors'):
        DeviatingOrbit(deviating_chain(WOBBLER, 50_000, 0.01))
