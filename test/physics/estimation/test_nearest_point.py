# SPDX-License-Identifier: Apache-2.0
"""Nearest point of the orbit: Cramer-Rao bound, and global search."""

import math
from functools import partial

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, SPINNER, WIDE_SPINNER, WOBBLER
from hypothesis import given, settings
from hypothesis import strategies as st
from orbits import uniform_orbit

from soliton_linkage.estimation.relocalisation import fit_anywhere, fit_near
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

# What an arc is fitted to [rad], the cycle being accurate to 1e-6.
FITTED = 1e-6


def noise(orbit: UniformOrbit, sigma: float, seed: int, frames: int) -> Array:
    """Return independent normal noise of every angle [rad], shape (frames, N)."""
    shape = (frames, orbit.chain.number_of_rotors)
    return np.random.default_rng(seed).normal(0, sigma, shape)


def tangent_at(orbit: UniformOrbit, arc: float) -> Array:
    """Return the zero mode of the chain along the orbit [1], shape (N,)."""
    about = orbit.segment(arc)
    mode = zero_mode(orbit.chain, orbit.configuration(arc))
    along = mode[about.first : about.first + len(about.angles)] @ about.tangent
    return np.asarray(np.sign(along) * mode)


def apart(orbit: UniformOrbit, arc: float, other: float) -> float:
    return abs(math.remainder(arc - other, orbit.length))


def inner_arc(orbit: UniformOrbit, share: float, leg: int) -> float:
    """Return the arc of a wall more than two widths from both edges."""
    chain = orbit.chain
    margin = 2 * chain.wall_width / chain.spacing
    site = margin + share * (chain.number_of_rotors - 1 - 2 * margin)
    return orbit.arc_at(site, leg % orbit.number_of_legs)


@pytest.mark.parametrize('example', CLASSES)
@pytest.mark.parametrize(('share', 'leg', 'sigma'), [(0.0, 0, 0.05), (0.513, 1, 0.01)])
def test_it_is_unbiased_and_reaches_the_cramer_rao_bound(example, sigma, share, leg):
    orbit = uniform_orbit(example, 40)
    arc = inner_arc(orbit, share, leg)
    frames = 3000
    noises = noise(orbit, sigma, 11, frames)
    there = orbit.configuration(arc)
    errors = np.array([fit_near(orbit, there + each, arc).arc - arc for each in noises])
    # The standard deviation of 3000 samples scatters by 1.3 %.
    assert errors.std() == pytest.approx(sigma, rel=0.05)
    # To first order the error is the projection of the noise on the tangent, of mean 0.
    beyond = errors - noises @ tangent_at(orbit, arc)
    assert abs(beyond.mean()) < 0.002 * orbit.site_arc
    assert beyond.std() < 0.2 * sigma


@pytest.mark.parametrize('rotors', [3, 40])
@pytest.mark.parametrize('example', CLASSES)
@settings(deadline=None, max_examples=8)
@given(share=st.floats(0, 1), off=st.floats(-0.2, 0.2))
def test_without_noise_it_is_exact_wherever_the_wall_is(example, rotors, share, off):
    orbit = uniform_orbit(example, rotors)
    arc = share * orbit.length
    fit = fit_near(orbit, orbit.configuration(arc), arc + off)
    assert fit.arc == pytest.approx(arc, rel=0, abs=FITTED)
    assert fit.information == pytest.approx(1, abs=10 * FITTED)
    assert fit.misfit < FITTED


@pytest.mark.parametrize('example', CLASSES)
def test_its_misfit_estimates_sigma(example):
    orbit = uniform_orbit(example, 40)
    sigma, frames = 0.02, 400
    arc = inner_arc(orbit, 0.3, 0)
    there = orbit.configuration(arc)
    fits = [fit_near(orbit, there + each, arc) for each in noise(orbit, sigma, 5, frames)]
    freedoms = frames * (len(orbit.segment(arc).angles) - 1)
    # Four deviations of the mean square, and sigma^2 of what the orbit curves away.
    limit = 4 * math.sqrt(2 / freedoms) + sigma**2
    squares = np.array([fit.misfit for fit in fits]) ** 2
    assert squares.mean() == pytest.approx(sigma**2, rel=limit)


@pytest.mark.parametrize('example', CLASSES)
@settings(deadline=None, max_examples=12)
@given(share=st.floats(0, 1), leg=st.integers(0, 3), seed=st.integers(0, 2**32))
def test_its_information_is_the_share_of_the_tangent_that_is_seen(example, share, leg, seed):
    orbit = uniform_orbit(example, 40)
    arc = inner_arc(orbit, share, leg)
    frame, tangent = orbit.configuration(arc), tangent_at(orbit, arc)
    missing = np.random.default_rng(seed).random(len(frame)) < 0.4
    frame[missing] = np.nan
    seen = float(tangent[~missing] @ tangent[~missing])
    fit = fit_near(orbit, frame, arc)
    assert fit.information == pytest.approx(seen, abs=10 * FITTED)
    assert fit.arc == pytest.approx(arc, abs=FITTED / max(seen, 1e-6))


@pytest.mark.parametrize('example', CLASSES)
@settings(deadline=None, max_examples=8)
@given(share=st.floats(0, 1), seed=st.integers(0, 2**32), orbits=st.integers(-3, 3))
def test_whole_turns_and_cycles_have_no_effect(example, share, seed, orbits):
    orbit = uniform_orbit(example, 40)
    arc = share * orbit.length
    random = np.random.default_rng(seed)
    frame = orbit.configuration(arc) + random.normal(0, 0.02, 40)
    fit = fit_near(orbit, frame, arc)
    turned = frame + 2 * math.pi * random.integers(-9, 10, 40)
    wrapped = np.angle(np.exp(1j * frame))
    for other in (turned, wrapped):
        again = fit_near(orbit, other, arc + orbits * orbit.length)
        assert again.arc - orbits * orbit.length == pytest.approx(fit.arc, abs=FITTED)
        assert again.misfit == pytest.approx(fit.misfit, rel=FITTED)
        assert apart(orbit, fit_anywhere(orbit, other).arc, fit.arc) < FITTED


@pytest.mark.parametrize('example', CLASSES)
def test_a_mirrored_frame_is_at_the_mirrored_site(example):
    for rotors in [40, 41]:
        orbit = uniform_orbit(example, rotors)
        spinner = orbit.chain.motion is Motion.SPINNER
        for leg in range(orbit.number_of_legs):
            arc = orbit.arc_at(17.3, leg)
            frame = orbit.configuration(arc) + noise(orbit, 0.05, leg, 1)[0]
            turned = (rotors % 2 == 1) == spinner
            image = frame[::-1] + math.pi if turned else -frame[::-1]
            fits = fit_anywhere(orbit, frame), fit_anywhere(orbit, image)
            sites = [orbit.site(fit.arc) for fit in fits]
            assert sum(sites) == pytest.approx(rotors - 1, abs=FITTED)


def some_frames(
    orbit: UniformOrbit, sigma: float, seed: int, frames: int
) -> list[tuple[float, Array]]:
    """Return arcs all over the orbit and noisy frames there, with whole turns."""
    random = np.random.default_rng(seed)
    arcs = random.uniform(0, orbit.length, frames)
    # A third of them where the wall is being reflected.
    begins = [orbit.leg_arcs(leg)[0] for leg in range(orbit.number_of_legs)]
    arcs[::3] = random.choice(begins, len(arcs[::3])) + random.normal(0, 1, len(arcs[::3]))
    made = []
    for arc in arcs.tolist():
        frame = orbit.configuration(arc)
        turns = random.integers(-3, 4, len(frame))
        made.append((arc, frame + random.normal(0, sigma, len(frame)) + 2 * math.pi * turns))
    return made


@pytest.mark.parametrize(('rotors', 'sigma'), [(201, 0.01), (20, 0.2)])
@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER, WIDE_SPINNER])
def test_it_is_found_from_anywhere_or_has_little_information(example, sigma, rotors):
    orbit = uniform_orbit(example, rotors)
    random, found, frames = np.random.default_rng(rotors), 0, 15
    for arc, frame in some_frames(orbit, sigma, rotors, frames):
        fit = fit_anywhere(orbit, frame)
        assert 0 <= fit.arc <= orbit.length
        near = fit_near(orbit, frame, arc)
        # No point of the orbit is nearer than the fit near the truth.
        assert apart(orbit, fit.arc, near.arc) < FITTED
        assert apart(orbit, fit.arc, arc) < 6 * sigma
        assert fit.misfit == pytest.approx(near.misfit, rel=FITTED)
        frame[random.random(rotors) < 0.1] = np.nan
        fit = fit_anywhere(orbit, frame)
        there = apart(orbit, fit.arc, arc) < 6 * sigma / math.sqrt(fit.information)
        found += there
        if np.isfinite(frame[[0, -1]]).all() or orbit.chain.motion is Motion.SPINNER:
            assert there
    assert found > frames / 2


def test_without_known_rotors_the_arc_is_nan():
    for example in CLASSES:
        orbit = uniform_orbit(example, 40)
        nothing = np.full(40, np.nan)
        anywhere = fit_anywhere(orbit, nothing)
        assert anywhere.information == 0
        assert math.isnan(anywhere.arc)
        assert math.isnan(anywhere.misfit)
        near = fit_near(orbit, nothing, 3.25)
        assert (near.arc, near.information) == (3.25, 0)
        assert math.isnan(near.misfit)


@pytest.mark.parametrize('fit', [partial(fit_near, arc=0.0), fit_anywhere])
def test_infinite_angles_and_angles_of_another_shape_are_rejected(fit):
    for shape in [(39,), (41,), (1, 40), ()]:
        with pytest.raises(
            ValueError, match='do not fit a chain of 40 rotors; give one per rotor'
        ):
            fit(uniform_orbit(FLIPPER, 40), np.zeros(shape))
    for infinity in [math.inf, -math.inf]:
        angles = np.zeros(40)
        angles[7], angles[3] = infinity, math.nan
        with pytest.raises(ValueError, match=r'angle of rotor 7 = -?inf must be a finite number'):
            fit(uniform_orbit(FLIPPER, 40), angles)


def test_an_arc_that_is_not_finite_is_rejected():
    for arc in [math.nan, math.inf]:
        with pytest.raises(ValueError, match=r'arc = .* rad must be a finite number'):
            fit_near(uniform_orbit(FLIPPER, 40), np.zeros(40), arc)
