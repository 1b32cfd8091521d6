# SPDX-License-Identifier: Apache-2.0
"""Measurement of several walls by their shapes: accuracy, conservation laws, and tables."""

import math
from copy import deepcopy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from meeting_walls import NARROW, meeting
from scipy.interpolate import CubicSpline

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis
from soliton_linkage.estimation.estimates import EventKind, TrackingStatus
from soliton_linkage.estimation.wall_shapes import WallShape, WallShapes, fit_wall, set_residuals
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.solitons.anti_kink import anti_kink_path, constraint_field, resting_anti_kink
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage_studies.collisions.runs import INITIAL_DISTANCE, Collision, simulate_frames
from soliton_linkage_studies.collisions.travelling_wall import travelling_wall

NOISE = 0.01
FRAMES = 50
CHAINS = {
    'flipper': Chain(61, rest_angle=0.97),
    'wide flipper': Chain(81, rest_angle=0.3),
    'wobbler': Chain(61, rotor_length=0.1, rest_angle=0.77),
    'spinner': Chain(81, rotor_length=0.2, rest_angle=1.18),
}


def kink_and_anti_kink(chain: Chain, site: float) -> tuple[Array, tuple[float, float]]:
    """Return staggered angles of a kink and an anti-kink, and their sites.

    The anti-kink is as far from its end; pinned anti-kinks of spinners are at rest.
    """
    inner = staggered(static_wall(chain, site))[1:-1]
    far = chain.number_of_rotors - 1 - site
    if chain.motion is Motion.SPINNER:
        far, state = resting_anti_kink(chain, 2 * (far // 2) + 0.5)
        other = staggered(state)[1:-1]
    else:
        other = staggered(CubicSpline(*anti_kink_path(chain, math.floor(far)))(far))[1:-1]
    return np.concatenate([inner, inner[-1:], other]), (site - 1, len(inner) + far)


@pytest.mark.parametrize('name', CHAINS)
def test_a_kink_and_an_anti_kink_are_located_with_the_stated_deviation(name):
    chain = CHAINS[name]
    rng, errors = np.random.default_rng(1), []
    rotors = 2 * (chain.number_of_rotors - 2) + 1
    fresh = Analyser(replace(chain, number_of_rotors=rotors), NOISE)
    for site in chain.number_of_rotors // 2 + np.array([-2.9, -2.7, -2.45, -2.1]):
        theta, true = kink_and_anti_kink(chain, float(site))
        analyser = deepcopy(fresh)
        angles = staggered(theta)
        for frame in range(FRAMES):
            noise = NOISE * rng.standard_normal(len(theta))
            found = analyser.analyse(frame * 4_000_000, angles + noise)
            assert found is not None
        walls = found.solitons
        assert [each.charge for each in walls] == [1, -1]
        assert found.topology is not None
        assert found.topology.charge == 0
        errors += [
            (w.rotor - x) * chain.spacing / w.position_deviation
            for w, x in zip(walls, true, strict=True)
        ]
        bound = NOISE / site_arc(chain) / math.sqrt(FRAMES) * chain.spacing
        assert all(each.position_deviation < 3 * bound for each in walls)
    assert 0.4 < math.sqrt(np.mean(np.square(errors))) < 1.6
    assert max(map(abs, errors)) < 4


def test_waves_increase_the_stated_deviations_from_the_first_frame_on():
    chain, scores = CHAINS['flipper'], []
    fresh = Analyser(replace(chain, number_of_rotors=2 * (chain.number_of_rotors - 2) + 1))
    for seed in range(6):
        rng, analyser = np.random.default_rng(seed), deepcopy(fresh)
        theta, true = kink_and_anti_kink(chain, 28.3)
        angles = staggered(theta) + 0.03 * rng.standard_normal(len(theta))
        for frame in range(8):
            noise = 0.001 * rng.standard_normal(len(theta))
            found = analyser.analyse(frame * 4_000_000, angles + noise)
            assert found is not None
            scores += [
                (wall.rotor - x) * chain.spacing / wall.position_deviation
                for wall, x in zip(found.solitons, true, strict=True)
            ]
    assert np.sqrt(np.mean(np.square(scores))) < 1.5
    assert np.abs(scores).max() < 4


@pytest.mark.parametrize('mirrored', [False, True])
def test_an_anti_kink_is_located_while_a_kink_leaves_at_the_edge(mirrored):
    chain = Chain(61, rotor_length=0.03, rest_angle=0.97)
    errors = []
    for site in np.arange(52.0, 54.0, 0.5):
        theta, (kink, anti_kink) = kink_and_anti_kink(chain, float(site))
        for first in range(46, 54, 2):
            part = theta[first : first + 40]
            angles, true = staggered(part), anti_kink - first
            if mirrored:
                angles, true = -angles[::-1], len(part) - 1 - true
            analyser = Analyser(replace(chain, number_of_rotors=len(part)), 1e-3)
            found = analyser.analyse(0, angles)
            assert found is not None
            walls = [each for each in found.solitons if each.charge < 0]
            assert len(walls) == 1, (kink - first, site)
            errors.append(walls[0].rotor - true)
    assert max(map(abs, errors)) < 0.02


def test_a_wall_keeps_its_velocity_when_another_wall_appears():
    chain, speed, rng = CHAINS['wobbler'], 0.02, np.random.default_rng(1)
    still = staggered(static_wall(chain, 30.3))[1:-1][::-1]
    uniform = np.full(len(still), still[0])
    analyser = Analyser(replace(chain, number_of_rotors=2 * len(still)), NOISE)
    for frame in range(110):
        moving = staggered(static_wall(chain, 20 + speed * frame))[1:-1]
        theta = np.concatenate([moving, uniform if frame < 100 else still])
        noise = NOISE * rng.standard_normal(len(theta))
        found = analyser.analyse(frame * 4_000_000, staggered(theta) + noise)
        assert found is not None
        if frame >= 100:
            kink, _ = found.solitons
            error = kink.velocity - speed / 0.004 * chain.spacing
            assert kink.id == 1
            assert abs(error) < 4 * kink.velocity_deviation < 0.2 * kink.velocity


def test_a_deformed_kink_does_not_make_a_resting_anti_kink_less_certain():
    chain, deviations = CHAINS['wobbler'], []
    still = staggered(static_wall(chain, 30.3))[1:-1][::-1]
    for apart in (0.0, 0.4):
        rng = np.random.default_rng(1)
        analyser = Analyser(replace(chain, number_of_rotors=2 * len(still)), NOISE)
        for frame in range(80):
            site = 20 + 0.02 * frame
            walls = [staggered(static_wall(chain, site + way))[1:-1] for way in (-apart, apart)]
            theta = np.concatenate([np.mean(walls, axis=0), still])
            noise = NOISE * rng.standard_normal(len(theta))
            found = analyser.analyse(frame * 4_000_000, staggered(theta) + noise)
            assert found is not None
        deviations.append([each.position_deviation for each in found.solitons])
    (kink, anti_kink), (deformed, beside) = deviations
    assert deformed > 1.5 * kink
    assert beside < 1.2 * anti_kink


class Run(NamedTuple):
    task: Collision
    times: Array
    angles: Array
    rates: Array


@pytest.fixture(scope='module')
def bounce():
    task, parts = meeting(NARROW, 0.4), []
    for part in simulate_frames(task):
        parts.append(part)
        if part[0][-1] > 28 * task.unit:
            return Run(task, *map(np.concatenate, zip(*parts, strict=True)))
    raise AssertionError


def analysed(run: Run, noise: float = 0.0, seed: int = 1) -> list[Analysis]:
    analyser, rng = Analyser(run.task.ring), np.random.default_rng(seed)
    found = [
        analyser.analyse(round(time * 1e9), angles + rng.normal(0, noise, len(angles)), rates)
        for time, angles, rates in zip(run.times, run.angles, run.rates, strict=True)
    ]
    return [each for each in found if each is not None]


def starts(run: Run) -> tuple[float, float]:
    """Return the initial positions of both walls [m]."""
    ring, task = run.task.ring, run.task
    points = travelling_wall(ring, task.speed * task.sound * ring.spacing, 1).points
    middle, half = (ring.number_of_rotors - 1) / 2, INITIAL_DISTANCE * task.reach / 2
    return -np.rint((half - middle) * points) / points, -np.rint(
        (-half - middle) * points
    ) / points


def test_a_collision_conserves_charge_and_energy(bounce):
    found = analysed(bounce)
    assert all(sum(each.charge for each in one.solitons) == 0 for one in found)
    assert {each.id for one in found for each in one.solitons} == {1, 2}
    events = [(k, each) for k, one in enumerate(found) for each in one.events]
    assert [each.kind for _, each in events] == [
        EventKind.FOUND,
        EventKind.FOUND,
        EventKind.BOUNCE,
    ]
    reported, met = events[-1]
    assert (met.ids_before, met.ids_after, met.charge_before, met.charge_after) == (
        (1, 2),
        (1, 2),
        0,
        0,
    )
    energies = found[reported].energies
    assert energies is not None
    assert met.energy_before == pytest.approx(energies.whole, rel=1e-4)
    radiated = met.energy_before - met.energy_after
    assert radiated == pytest.approx(energies.wake, abs=2e-5 * energies.whole)
    assert 0 < radiated < 0.1 * energies.whole


def test_each_wall_of_a_collision_is_located_with_the_stated_deviation(bounce):
    run, errors = bounce, []
    speed = run.task.speed * run.task.sound
    left, right = starts(run)
    first = run.times < 3.2 / run.task.speed * run.task.unit
    part = Run(run.task, run.times[first], run.angles[first], run.rates[first])
    for seed in (1, 2):
        for time, one in zip(part.times, analysed(part, 0.01, seed), strict=True):
            assert one.status is not TrackingStatus.LOST
            for wall in one.solitons:
                true = left + speed * time if wall.charge > 0 else right - speed * time
                errors.append((wall.position - true) / wall.position_deviation)
    assert len(errors) == 4 * np.count_nonzero(first)
    assert 0.4 < math.sqrt(np.mean(np.square(errors))) < 1.2
    assert max(map(abs, errors)) < 4.5


SHAPE_CHAINS = {
    'flipper': Chain(81, rest_angle=0.97),
    'wobbler': Chain(81, rotor_length=0.1, rest_angle=0.77),
    'spinner': Chain(121, rotor_length=0.2, rest_angle=1.18),
    'pinned wobbler': Chain(81, rotor_length=0.083, rest_angle=1.247),
    'long spinner': Chain(121, rotor_length=0.36, rest_angle=1.02),
}
EDGE = 5


def leaves_nothing(shape: WallShape, theta: Array, site: float) -> bool:
    """Return whether a shape fits the staggered angles of a wall at its site."""
    inner = theta[EDGE:-EDGE]
    left = np.empty_like(inner)
    set_residuals(inner, EDGE, shape.table, site, 1.0, left)
    found, *_ = fit_wall(inner, EDGE, shape.table, site + 0.2, 1.0, 1e-2, 2.5, False)
    return bool(np.abs(left).max() < 1e-4) and abs(found - site) < 1e-4


@pytest.mark.parametrize('name', SHAPE_CHAINS)
def test_the_shape_of_a_kink_is_exact(name):
    chain, shapes = SHAPE_CHAINS[name], WallShapes(SHAPE_CHAINS[name])
    for leg in range(2 if chain.motion is Motion.SPINNER else 1):
        for site in (40.0, 40.33, 41.07, 40.5):
            theta = staggered(static_wall(chain, site, leg))
            assert leaves_nothing(shapes.of_leg(leg), theta, site)


@pytest.mark.parametrize('name', ['flipper', 'wobbler', 'long spinner'])
def test_the_shape_of_an_anti_kink_that_is_not_pinned_is_exact(name):
    chain, shapes = SHAPE_CHAINS[name], WallShapes(SHAPE_CHAINS[name])
    states = CubicSpline(*anti_kink_path(chain, 40.0))
    for site in (40.0, 40.33, 41.07, 41.5):
        theta = staggered(states(site))
        assert leaves_nothing(shapes.anti_kinks[0], theta, site)
        if chain.motion is Motion.SPINNER:
            assert leaves_nothing(shapes.anti_kinks[1], np.roll(theta, 1), site + 1)


@pytest.mark.parametrize('name', ['spinner', 'pinned wobbler'])
def test_the_shape_of_a_pinned_anti_kink_is_exact_at_rest(name):
    chain, shapes = SHAPE_CHAINS[name], WallShapes(SHAPE_CHAINS[name])
    site, angles = resting_anti_kink(chain, 40.5)
    one, other = shapes.anti_kinks
    assert leaves_nothing(one, staggered(angles), site)
    assert leaves_nothing(other, np.roll(staggered(angles), 1), site + 1)


@pytest.mark.parametrize(('share', 'passes'), [(0.7, False), (1.4, True)])
def test_an_anti_kink_passes_its_energy_barrier_above_the_pinning_speed(share, passes):
    chain = Chain(41, rest_angle=0.97)
    sites, states = anti_kink_path(chain, 20.0)
    begin = int(np.argmin(chain.elastic_energy(states)))
    along = CubicSpline(sites, states)(sites[begin], 1)
    speed = share * WallShapes(chain).pinning_speed
    run = simulate(chain, states[begin], speed * along, 2 / speed, 0.2 * chain.time_unit)
    field = np.array([constraint_field(chain, angles)[0].sum() for angles in run.angles])
    moved = np.abs(field - field[0]).max() / 2
    assert (moved > 1.2) == passes
