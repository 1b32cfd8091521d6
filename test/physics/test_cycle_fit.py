# SPDX-License-Identifier: Apache-2.0
"""The nearest point of the orbit: at the bound of Cramer and Rao, and found from anywhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from chains import (
    FLIPPER,
    SPINNER,
    WIDE_FLIPPER,
    WIDE_SPINNER,
    WOBBLER,
    chain_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from soliton_linkage.chain import Array, Motion
from soliton_linkage.cycle import Cycle
from soliton_linkage.cycle_fit import CycleFit, fit_anywhere, fit_near
from soliton_linkage.rigidity import zero_mode

CLASSES = (FLIPPER, WOBBLER, SPINNER)
# What an arc is fitted to [rad], the cycle being accurate to 1e-6.
FITTED = 1e-6
Example = tuple[float, float]


@lru_cache(maxsize=32)
def cycle_of(example: Example, rotors: int = 40) -> Cycle:
    return Cycle(chain_of(example, rotors))


def noise(cycle: Cycle, sigma: float, seed: int, frames: int) -> Array:
    """Independent normal noise of every angle [rad], shape (frames, N)."""
    shape = (frames, cycle.chain.number_of_rotors)
    return np.random.default_rng(seed).normal(0, sigma, shape)


def tangent_at(cycle: Cycle, arc: float) -> Array:
    """Zero mode of the whole chain in the direction of the cycle [1], shape (N,)."""
    about = cycle.stretch(arc)
    mode = zero_mode(cycle.chain, cycle.configuration(arc))
    along = mode[about.first : about.first + len(about.angles)] @ about.tangent
    return np.asarray(np.sign(along) * mode)


def apart(cycle: Cycle, arc: float, other: float) -> float:
    return abs(math.remainder(arc - other, cycle.length))


def inner_arc(cycle: Cycle, share: float, leg: int) -> float:
    """Arc of a wall more than two widths from both edges."""
    chain = cycle.chain
    margin = 2 * chain.wall_width / chain.spacing
    place = margin + share * (chain.number_of_rotors - 1 - 2 * margin)
    return cycle.arc_at(place, leg % cycle.number_of_legs)


@pytest.mark.parametrize('sigma', [0.01, 0.05])
@pytest.mark.parametrize('example', CLASSES)
@pytest.mark.parametrize(('share', 'leg'), [(0.0, 0), (0.513, 1)])
def test_it_has_no_bias_and_the_deviation_of_the_bound(
    example: Example, sigma: float, share: float, leg: int
) -> None:
    cycle = cycle_of(example)
    arc = inner_arc(cycle, share, leg)
    frames = 3000
    noises = noise(cycle, sigma, 11, frames)
    there = cycle.configuration(arc)
    errors = np.array([fit_near(cycle, there + each, arc).arc - arc for each in noises])
    # Deviations of samples of 3000 scatter by 1.3 %.
    assert errors.std() == pytest.approx(sigma, rel=0.05)
    # To first order the error is the projection of the noise on the tangent, of mean 0.
    beyond = errors - noises @ tangent_at(cycle, arc)
    assert abs(beyond.mean()) < 0.002 * cycle.site_arc
    assert beyond.std() < 0.2 * sigma


@pytest.mark.parametrize('example', CLASSES)
@settings(deadline=None, max_examples=8)
@given(share=st.floats(0, 1), leg=st.integers(0, 3), seed=st.integers(0, 2**32))
def test_its_error_is_the_projection_of_the_noise_on_the_tangent_to_second_order(
    example: Example, share: float, leg: int, seed: int
) -> None:
    cycle = cycle_of(example)
    arc = inner_arc(cycle, share, leg)
    there, tangent = cycle.configuration(arc), tangent_at(cycle, arc)
    beyond = []
    for sigma in (0.04, 0.01):
        noises = noise(cycle, sigma, seed, 60)
        errors = [fit_near(cycle, there + each, arc).arc - arc for each in noises]
        beyond.append(np.linalg.norm(errors - noises @ tangent))
    # A quarter of the noise leaves a sixteenth of the second order, and less of the third.
    assert beyond[1] < beyond[0] / 10
    assert beyond[1] / math.sqrt(60) < 0.1 * 0.01


@pytest.mark.parametrize('sigma', [0.01, 0.05, 0.2])
@pytest.mark.parametrize('example', [*CLASSES, WIDE_FLIPPER, WIDE_SPINNER])
def test_it_ends_where_the_rest_is_orthogonal_to_the_tangent(
    example: Example, sigma: float
) -> None:
    cycle = cycle_of(example)
    arcs = np.linspace(0, cycle.length, 40).tolist()
    for arc, each in zip(arcs, noise(cycle, sigma, 3, 40), strict=True):
        frame = cycle.configuration(arc) + each
        fitted = fit_near(cycle, frame, arc).arc
        rest = np.angle(np.exp(1j * (frame - cycle.configuration(fitted))))
        about = cycle.stretch(fitted)
        rest = rest[about.first : about.first + len(about.angles)]
        assert abs(rest @ about.tangent) < FITTED


@pytest.mark.parametrize('rotors', [3, 40])
@pytest.mark.parametrize('example', [*CLASSES, WIDE_FLIPPER, WIDE_SPINNER])
@settings(deadline=None, max_examples=8)
@given(share=st.floats(0, 1), off=st.floats(-0.2, 0.2))
def test_without_noise_it_is_exact_wherever_the_wall_is(
    example: Example, rotors: int, share: float, off: float
) -> None:
    cycle = cycle_of(example, rotors)
    arc = share * cycle.length
    fit = fit_near(cycle, cycle.configuration(arc), arc + off)
    assert fit.arc == pytest.approx(arc, rel=0, abs=FITTED)
    assert fit.information == pytest.approx(1, abs=10 * FITTED)
    assert fit.misfit < FITTED


@pytest.mark.parametrize('example', CLASSES)
def test_its_misfit_estimates_sigma(example: Example) -> None:
    cycle = cycle_of(example)
    sigma, frames = 0.02, 400
    arc = inner_arc(cycle, 0.3, 0)
    there = cycle.configuration(arc)
    fits = [fit_near(cycle, there + each, arc) for each in noise(cycle, sigma, 5, frames)]
    freedoms = frames * (len(cycle.stretch(arc).angles) - 1)
    # Four deviations of the mean square, and sigma^2 of what the orbit curves away.
    limit = 4 * math.sqrt(2 / freedoms) + sigma**2
    squares = np.array([fit.misfit for fit in fits]) ** 2
    assert squares.mean() == pytest.approx(sigma**2, rel=limit)


@pytest.mark.parametrize('example', CLASSES)
@settings(deadline=None, max_examples=12)
@given(share=st.floats(0, 1), leg=st.integers(0, 3), seed=st.integers(0, 2**32))
def test_its_information_is_the_share_of_the_tangent_that_is_seen(
    example: Example, share: float, leg: int, seed: int
) -> None:
    cycle = cycle_of(example)
    arc = inner_arc(cycle, share, leg)
    frame, tangent = cycle.configuration(arc), tangent_at(cycle, arc)
    missing = np.random.default_rng(seed).random(len(frame)) < 0.4
    frame[missing] = np.nan
    seen = float(tangent[~missing] @ tangent[~missing])
    fit = fit_near(cycle, frame, arc)
    assert fit.information == pytest.approx(seen, abs=10 * FITTED)
    assert fit.arc == pytest.approx(arc, abs=FITTED / max(seen, 1e-6))


@pytest.mark.parametrize('example', CLASSES)
def test_missing_rotors_cost_what_their_information_says(example: Example) -> None:
    cycle = cycle_of(example)
    sigma, frames = 0.01, 2000
    arc = inner_arc(cycle, 0.4, 1)
    there, tangent = cycle.configuration(arc), tangent_at(cycle, arc)
    there[np.argmax(np.abs(tangent))] = np.nan
    fits = [fit_near(cycle, there + each, arc) for each in noise(cycle, sigma, 7, frames)]
    errors = np.array([(fit.arc - arc) * math.sqrt(fit.information) for fit in fits])
    assert fits[0].information < 0.9
    # Three deviations of a sample of 2000.
    assert errors.std() == pytest.approx(sigma, rel=0.05)


@pytest.mark.parametrize('example', CLASSES)
@settings(deadline=None, max_examples=8)
@given(share=st.floats(0, 1), seed=st.integers(0, 2**32), cycles=st.integers(-3, 3))
def test_whole_turns_and_cycles_do_not_matter(
    example: Example, share: float, seed: int, cycles: int
) -> None:
    cycle = cycle_of(example)
    arc = share * cycle.length
    random = np.random.default_rng(seed)
    frame = cycle.configuration(arc) + random.normal(0, 0.02, 40)
    fit = fit_near(cycle, frame, arc)
    turned = frame + 2 * math.pi * random.integers(-9, 10, 40)
    wrapped = np.angle(np.exp(1j * frame))
    for other in (turned, wrapped):
        again = fit_near(cycle, other, arc + cycles * cycle.length)
        assert again.arc - cycles * cycle.length == pytest.approx(fit.arc, abs=FITTED)
        assert again.misfit == pytest.approx(fit.misfit, rel=FITTED)
        assert apart(cycle, fit_anywhere(cycle, other).arc, fit.arc) < FITTED


@pytest.mark.parametrize('example', CLASSES)
def test_a_frame_shifted_by_two_rotors_is_two_sites_further(example: Example) -> None:
    cycle = cycle_of(example, 201)
    for leg in range(cycle.number_of_legs):
        arc = cycle.arc_at(100.3, leg)
        frame = cycle.configuration(arc) + noise(cycle, 0.05, leg, 1)[0]
        further = np.roll(frame, 2 if leg % 2 == 0 else -2)
        beyond = arc + 2 * cycle.site_arc
        way = fit_near(cycle, further, beyond).arc - fit_near(cycle, frame, arc).arc
        assert way == pytest.approx(2 * cycle.site_arc, rel=0, abs=FITTED)


@pytest.mark.parametrize('rotors', [40, 41])
@pytest.mark.parametrize('example', CLASSES)
def test_a_mirrored_frame_is_at_the_mirrored_place(example: Example, rotors: int) -> None:
    cycle = cycle_of(example, rotors)
    spinner = cycle.chain.motion is Motion.SPINNER
    for leg in range(cycle.number_of_legs):
        arc = cycle.arc_at(17.3, leg)
        frame = cycle.configuration(arc) + noise(cycle, 0.05, leg, 1)[0]
        turned = (rotors % 2 == 1) == spinner
        image = frame[::-1] + math.pi if turned else -frame[::-1]
        fits = fit_anywhere(cycle, frame), fit_anywhere(cycle, image)
        places = [cycle.place(fit.arc) for fit in fits]
        assert sum(places) == pytest.approx(rotors - 1, abs=FITTED)


def some_frames(cycle: Cycle, sigma: float, seed: int, frames: int) -> list[tuple[float, Array]]:
    """Arcs all over the cycle, and noisy frames there with whole turns."""
    random = np.random.default_rng(seed)
    arcs = random.uniform(0, cycle.length, frames)
    # A third of them where the wall is being reflected.
    begins = [cycle.leg_arcs(leg)[0] for leg in range(cycle.number_of_legs)]
    arcs[::3] = random.choice(begins, len(arcs[::3])) + random.normal(0, 1, len(arcs[::3]))
    made = []
    for arc in arcs.tolist():
        frame = cycle.configuration(arc)
        turns = random.integers(-3, 4, len(frame))
        made.append((arc, frame + random.normal(0, sigma, len(frame)) + 2 * math.pi * turns))
    return made


@pytest.mark.parametrize('rotors', [20, 201])
@pytest.mark.parametrize('sigma', [0.01, 0.2])
@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER, WIDE_SPINNER])
def test_it_is_found_from_anywhere(example: Example, sigma: float, rotors: int) -> None:
    cycle = cycle_of(example, rotors)
    for arc, frame in some_frames(cycle, sigma, rotors, 15):
        fit = fit_anywhere(cycle, frame)
        assert 0 <= fit.arc <= cycle.length
        near = fit_near(cycle, frame, arc)
        # Nothing on the cycle is nearer than what is found next to the truth.
        assert apart(cycle, fit.arc, near.arc) < FITTED
        assert apart(cycle, fit.arc, arc) < 6 * sigma
        assert fit.misfit == pytest.approx(near.misfit, rel=FITTED)


@pytest.mark.parametrize('rotors', [20, 150])
def test_wide_walls_are_found_where_noise_allows_it(rotors: int) -> None:
    cycle = cycle_of((0.5, 0.1), rotors)
    for arc, frame in some_frames(cycle, 0.01, rotors, 40):
        assert apart(cycle, fit_anywhere(cycle, frame).arc, arc) < 6 * 0.01


@pytest.mark.parametrize('rotors', [20, 201])
@pytest.mark.parametrize('sigma', [0.01, 0.2])
@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER, WIDE_SPINNER])
def test_it_is_found_with_missing_rotors_or_says_that_it_may_be_elsewhere(
    example: Example, sigma: float, rotors: int
) -> None:
    cycle = cycle_of(example, rotors)
    random = np.random.default_rng(rotors)
    found, frames = 0, 15
    for arc, frame in some_frames(cycle, sigma, rotors, frames):
        frame[random.random(rotors) < 0.1] = np.nan
        fit = fit_anywhere(cycle, frame)
        there = apart(cycle, fit.arc, arc) < 6 * sigma / math.sqrt(fit.information)
        found += there
        # Odds of e^20 against where the wall is not would be false.
        assert there or fit.lead < 20 * sigma**2
        if np.isfinite(frame[[0, -1]]).all() or cycle.chain.motion is Motion.SPINNER:
            assert there
    assert found > frames / 2


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER])
def test_an_edge_rotor_that_is_not_seen_may_have_toggled_or_not(example: Example) -> None:
    cycle = cycle_of(example)
    for leg in range(4):
        arc = cycle.arc_at(19.8, leg)
        frame = cycle.configuration(arc) + noise(cycle, 0.05, leg, 1)[0]
        seen = fit_anywhere(cycle, frame)
        other_legs = [
            fit_near(cycle, frame, cycle.arc_at(19.8, other)).arc
            for other in range(4)
            if other != leg
        ]
        likeness = [np.cos(frame - cycle.configuration(each)).sum() for each in other_legs]
        lead = np.cos(frame - cycle.configuration(seen.arc)).sum() - max(likeness)
        assert seen.lead == pytest.approx(lead, rel=0, abs=FITTED)
        assert seen.lead > 0.5
        for edge in (0, -1):
            hidden = frame.copy()
            hidden[edge] = np.nan
            fit = fit_anywhere(cycle, hidden)
            assert fit.lead < FITTED
            assert cycle.place(fit.arc) == pytest.approx(cycle.place(seen.arc), abs=0.05)


@pytest.mark.parametrize('example', CLASSES)
def test_where_nothing_is_known_it_says_so(example: Example) -> None:
    cycle = cycle_of(example)
    nothing = np.full(40, np.nan)
    anywhere = fit_anywhere(cycle, nothing)
    assert anywhere.information == 0
    assert math.isnan(anywhere.arc)
    assert math.isnan(anywhere.misfit)
    near = fit_near(cycle, nothing, 3.25)
    assert (near.arc, near.information) == (3.25, 0)
    assert math.isnan(near.misfit)


@pytest.mark.parametrize('example', CLASSES)
def test_an_unseen_wall_is_not_moved_by_the_noise_of_rotors_that_know_nothing_of_it(
    example: Example,
) -> None:
    cycle = cycle_of(example, 201)
    arc = cycle.arc_at(50.0, 0)
    frame = cycle.configuration(arc) + noise(cycle, 0.05, 1, 1)[0]
    frame[30:70] = np.nan
    fit = fit_near(cycle, frame, arc)
    assert fit.arc == arc
    assert fit.information < 1e-6
    anywhere = fit_anywhere(cycle, frame)
    assert anywhere.information < 0.01 or anywhere.lead < 20 * 0.05**2


def test_a_single_rotor_gives_an_arc_but_no_misfit() -> None:
    cycle = cycle_of(FLIPPER)
    arc = cycle.arc_at(20.0, 0)
    frame = np.full(40, np.nan)
    frame[20] = cycle.configuration(arc)[20]
    fit = fit_near(cycle, frame, arc + 0.05)
    assert fit.arc == pytest.approx(arc, abs=FITTED)
    assert math.isnan(fit.misfit)


def from_the_start(cycle: Cycle, angles: Array) -> CycleFit:
    return fit_near(cycle, angles, 0.0)


FITS = pytest.mark.parametrize('fit', [from_the_start, fit_anywhere])


@FITS
@pytest.mark.parametrize('shape', [(39,), (41,), (1, 40), ()])
def test_angles_that_are_not_one_a_rotor_are_refused(
    fit: Callable[[Cycle, Array], CycleFit], shape: tuple[int, ...]
) -> None:
    with pytest.raises(ValueError, match='do not fit a chain of 40 rotors; give one a rotor'):
        fit(cycle_of(FLIPPER), np.zeros(shape))


@FITS
@pytest.mark.parametrize('infinity', [math.inf, -math.inf])
def test_infinite_angles_are_refused(
    fit: Callable[[Cycle, Array], CycleFit], infinity: float
) -> None:
    angles = np.zeros(40)
    angles[7], angles[3] = infinity, math.nan
    with pytest.raises(ValueError, match=r'angle of rotor 7 = -?inf must be a finite number'):
        fit(cycle_of(FLIPPER), angles)


@pytest.mark.parametrize('arc', [math.nan, math.inf])
def test_an_arc_that_is_no_number_is_refused(arc: float) -> None:
    with pytest.raises(ValueError, match=r'arc = .* rad must be a finite number'):
        fit_near(cycle_of(FLIPPER), np.zeros(40), arc)
