# SPDX-License-Identifier: Apache-2.0
"""Contraction of walls: at rest, in the continuum limit, and stated deviations."""

import math

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, SPINNER, STRONG_WOBBLER, WIDE_FLIPPER, WOBBLER, chain_of
from continuum_theories import WIDEST_FLIPPER, theory_of

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.estimation.relocalisation import fit_anywhere, fit_near
from soliton_linkage.estimation.wall_shapes import WallShapes
from soliton_linkage.estimation.wall_width import (
    UNKNOWN,
    ContractionEstimator,
    TheoryWidth,
    passage_scatter,
)
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import site_arc, static_wall

ROTORS = 50
LEGS = (0, 1, 2, 3)


def contracted(chain: Chain, site: float, leg: int, gamma: float) -> Array:
    """Return a wall phi_n = f(gamma (X - n)), each rotor from its own wall at rest."""
    angles = np.empty(chain.number_of_rotors)
    for rotor in range(chain.number_of_rotors):
        distance = gamma * (site - rotor)
        like = 2 * (chain.number_of_rotors // 4) + rotor % 2
        inside = min(max(like + distance, 0.5), chain.number_of_rotors - 1.5)
        angles[rotor] = static_wall(chain, inside, leg)[like]
    return angles


@pytest.mark.parametrize('example', EXAMPLES)
def test_a_wall_at_rest_is_not_contracted(example):
    chain = chain_of(example, ROTORS)
    estimator = ContractionEstimator(WallShapes(chain))
    for leg in LEGS[: 2 if chain.motion is Motion.SPINNER else 4]:
        for site in (23.0, 23.4, 24.9, 25.5):
            found = estimator.fit(static_wall(chain, site, leg), site + 0.05, leg, 1e-6, 0.03)
            assert found.logarithm == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize('example', [WIDE_FLIPPER, FLIPPER, WOBBLER, SPINNER])
def test_the_contraction_of_a_wall_is_recovered(example):
    for gamma in [0.8, 1.3, 1.8]:
        chain = chain_of(example, ROTORS)
        estimator = ContractionEstimator(WallShapes(chain))
        angles = contracted(chain, 24.3, 0, gamma)
        found = estimator.fit(angles, 24.25, 0, 1e-6, math.log(gamma) / 2)
        assert found.factor == pytest.approx(gamma, rel=1e-4)
        turns = 2 * np.pi * np.random.default_rng(3).integers(-3, 4, ROTORS)
        turned = estimator.fit(angles + turns, 24.25, 0, 1e-6, math.log(gamma) / 2)
        assert turned.logarithm == pytest.approx(found.logarithm, abs=1e-9)


@pytest.mark.parametrize('example', [WIDEST_FLIPPER, (20.0, 1.2)])
def test_contraction_in_the_continuum_follows_lorentz(example):
    for share in [0.3, 0.8]:
        chain = chain_of(example, 200)
        theory = theory_of(chain)
        velocity = share * theory.speed_of_sound
        site = 99.4
        angles, _ = theory.state(site * chain.spacing, velocity)
        # In the theory rotors turn forwards, as on the second leg of the orbit.
        found = ContractionEstimator(WallShapes(chain)).fit(angles, site, 1, 1e-3)
        order = min(chain.lean_ratio, 1 / chain.lean_ratio)
        assert found.factor == pytest.approx(theory.lorentz_factor(velocity), rel=order**2)


@pytest.mark.parametrize('example', EXAMPLES)
def test_one_frame_is_unbiased_with_the_stated_deviation(example):
    random, noise, count = np.random.default_rng(5), 0.003, 600
    chain = chain_of(example, ROTORS)
    estimator = ContractionEstimator(WallShapes(chain))
    walls = [(site, static_wall(chain, site)) for site in random.uniform(23, 26, 30)]
    errors = []
    for number in range(count):
        site, angles = walls[number % 30]
        found = estimator.fit(angles + noise * random.standard_normal(ROTORS), site, 0, noise)
        errors.append(found.logarithm / found.deviation)
    assert np.isfinite(errors).all()
    assert abs(float(np.mean(errors))) < 4 / math.sqrt(count)
    assert float(np.var(errors)) == pytest.approx(1, abs=4 * math.sqrt(2 / count))


@pytest.mark.parametrize('example', [WIDE_FLIPPER, WOBBLER, SPINNER])
def test_unseen_rotors_increase_the_deviation_without_bias(example):
    chain = chain_of(example, ROTORS)
    estimator, angles = ContractionEstimator(WallShapes(chain)), static_wall(chain, 24.3)
    whole = estimator.fit(angles, 24.3, 0, 1e-3)
    angles[::3] = math.nan
    holed = estimator.fit(angles, 24.3, 0, 1e-3)
    assert holed.logarithm == pytest.approx(0, abs=1e-4)
    assert holed.deviation > whole.deviation
    assert estimator.fit(np.full(ROTORS, math.nan), 24.3, 0, 1e-3) is UNKNOWN


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_contraction_is_unknown_at_edges_and_in_noise(example):
    chain = chain_of(example, ROTORS)
    estimator, angles = ContractionEstimator(WallShapes(chain)), static_wall(chain, 24.3)
    near = 1.9 * chain.wall_width / chain.spacing
    for site in (0.0, near, ROTORS - 1 - near, ROTORS - 1.0, math.nan):
        assert estimator.fit(angles, site, 0, 1e-3) is UNKNOWN
    known = estimator.fit(angles, 24.3, 0, 1e-3)
    assert estimator.fit(angles, 24.3, 0, 0.5 * 1e-3 / known.deviation) is UNKNOWN


def test_the_mean_of_white_noise_has_the_stated_deviation():
    random, noise, runs = np.random.default_rng(7), 0.01, 1000
    chain = chain_of(FLIPPER, 30)
    shapes, sites = WallShapes(chain), np.linspace(8.2, 15.4, 24)
    walls = np.array([static_wall(chain, float(site)) for site in sites])
    errors = []
    for _ in range(runs):
        mean = ContractionEstimator(shapes)
        for site, angles in zip(sites, walls, strict=True):
            frame = angles + noise * random.standard_normal(30)
            found = mean.update(frame, float(site), 0, noise)
        errors.append(found.logarithm / found.deviation)
    assert float(np.var(errors)) == pytest.approx(1, abs=0.05 + 2 * math.sqrt(2 / runs))
    assert abs(float(np.mean(errors))) < 0.15
    assert float(np.abs(errors).max()) < 4.5


def passage_of(
    chain: Chain, start: Array, rates: Array, duration: float, frames: int
) -> tuple[Array, Array, int, float]:
    """Return angles, sites, leg and speed [rotor spacings / s] in the middle of a chain."""
    recording = simulate(chain, start, rates, duration, duration / frames, 1e-7)
    orbit = UniformOrbit(chain)
    arcs = [fit_anywhere(orbit, recording.angles[0]).arc]
    for angles in recording.angles[1:]:
        arcs.append(fit_near(orbit, angles, arcs[-1]).arc)
    sites = np.array([orbit.site(arc) for arc in arcs])
    inside = np.abs(sites - orbit.middle) < 0.4 * orbit.middle
    first = int(np.argmax(inside))
    part = slice(first, first + int(np.argmin(np.append(inside[first:], False))))
    speed = np.polyfit(recording.times[part], sites[part], 1)[0]
    return recording.angles[part], sites[part], orbit.leg(arcs[first]), abs(float(speed))


def mean_logarithm(shapes: WallShapes, frames: Array, sites: Array, leg: int) -> float:
    estimator = ContractionEstimator(shapes)
    found = [
        estimator.fit(frame, float(site), leg, 1e-5).logarithm
        for frame, site in zip(frames, sites, strict=True)
    ]
    return float(np.mean(found))


@pytest.mark.parametrize(
    ('example', 'kick'), [(FLIPPER, 0.1), (WOBBLER, 0.08), (STRONG_WOBBLER, 0.03), (SPINNER, 0.3)]
)
def test_the_mean_on_springs_agrees_with_the_whole_passage(example, kick):
    random, chain = np.random.default_rng(11), chain_of(example, 36)
    speed = kick * chain.spacing / (chain.rotor_length * chain.time_unit)
    start = static_wall(chain, 9.3)
    rates = speed * mode_towards_last(chain, start)
    duration = 18 * site_arc(chain) / speed
    frames, sites, leg, _ = passage_of(chain, start, rates, duration, 360)
    shapes = WallShapes(chain)
    whole = mean_logarithm(shapes, frames, sites, leg)
    for noise in (0.0, 0.003, 0.01):
        mean, errors = ContractionEstimator(shapes), []
        for frame, site in zip(frames, sites, strict=True):
            noisy = frame + noise * random.standard_normal(36)
            found = mean.update(noisy, float(site), leg, max(noise, 1e-5))
            errors.append((found.logarithm - whole) / found.deviation)
        assert float(np.mean(np.square(errors[len(errors) // 2 :]))) < 3
        assert float(np.abs(errors).max()) < 4.5
        assert found.deviation < 0.02


def test_a_new_leg_and_a_changed_wall_restart_the_mean():
    random, noise, chain = np.random.default_rng(13), 0.003, chain_of(FLIPPER, 40)
    mean, sites = ContractionEstimator(WallShapes(chain)), np.arange(10, 20, 0.1)
    for site in sites:
        frame = static_wall(chain, float(site)) + noise * random.standard_normal(40)
        before = mean.update(frame, float(site), 0, noise)
    narrow = [contracted(chain, float(site), 0, 1.4) for site in np.arange(20, 24, 0.1)]
    for site, angles in zip(np.arange(20, 24, 0.1), narrow, strict=True):
        after = mean.update(angles + noise * random.standard_normal(40), float(site), 0, noise)
    assert before.factor == pytest.approx(1, abs=5 * before.deviation)
    assert after.factor == pytest.approx(1.4, abs=5 * 1.4 * after.deviation)
    again = mean.update(narrow[-1], 23.9, 1, noise)
    assert again.deviation > 2 * after.deviation


def test_the_scatter_of_passages_is_estimated():
    random, spread, noise = np.random.default_rng(17), 0.03, 0.01
    found = []
    for _ in range(200):
        values = spread * random.standard_normal(60) + noise * random.standard_normal(60)
        found.append(passage_scatter(values, np.full(60, noise**2)))
    assert np.mean(found) == pytest.approx(spread**2, rel=0.1)
    assert passage_scatter(noise * np.tile([1.0, -1.0], 30), np.full(60, noise**2)) == 0


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_width_at_rest_agrees_with_theory(example):
    chain = chain_of(example, ROTORS)
    theory, reported = theory_of(chain), TheoryWidth(chain)
    wall = static_wall(chain, 24.3)
    found = ContractionEstimator(WallShapes(chain)).update(wall, 24.3, 0, 1e-4)
    has_a_width = chain.motion is Motion.SPINNER or chain.lean_ratio < 2
    assert math.isnan(reported(0.0)) == (not has_a_width)
    if has_a_width:
        assert reported(0.0) / found.factor == pytest.approx(theory.width(), rel=1e-4)
        assert 0 < found.deviation < 0.02
        for share in (0.6, -0.6):
            moving = reported(share * theory.speed_of_sound)
            assert moving == pytest.approx(0.8 * theory.width())
    for velocity in (math.nan, theory.speed_of_sound, -2 * theory.speed_of_sound):
        assert math.isnan(reported(velocity))


def test_a_wall_at_an_edge_has_no_width():
    chain = chain_of(FLIPPER, ROTORS)
    estimator = ContractionEstimator(WallShapes(chain))
    assert estimator.update(chain.uniform_state(1), ROTORS - 1.0, 0, 1e-3) is UNKNOWN
