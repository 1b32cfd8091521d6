# SPDX-License-Identifier: Apache-2.0
"""Class of motion from angles alone: correctness, stated probability, and symmetry."""

import math

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, SPINNER, STRONG_WOBBLER, WIDE_FLIPPER, WOBBLER, chain_of
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.motion_class import NO_EVIDENCE, MotionEvidence, MotionObserver
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.solitons.anti_kink import continuum_anti_kink
from soliton_linkage.solitons.static_wall import site_arc, static_wall

ROTORS = 50
SLIGHT_WOBBLER = (0.8, 0.77)
NEARLY_WOBBLING = (0.57, 0.97)
FLIPPERS = (WIDE_FLIPPER, NEARLY_WOBBLING, SLIGHT_WOBBLER, STRONG_WOBBLER)


def motion_evidence(angles: Array, noise: float = 0.0) -> MotionEvidence:
    observer = MotionObserver()
    observer.observe(angles, noise)
    return observer.evidence


def says_nothing(evidence: MotionEvidence) -> bool:
    return math.isnan(evidence.site) and evidence.flipping == 0 and not evidence.tails.any()


def walls(example: tuple[float, float], rotors: int = ROTORS) -> list[Array]:
    """Return walls at many sites on all legs of a chain."""
    chain = chain_of(example, rotors)
    legs = 2 if chain.motion is Motion.SPINNER else 4
    sites = rotors / 2 + np.linspace(-3.3, 3.4, 13)
    return [
        static_wall(chain, float(site), leg, turned)
        for number, site in enumerate(sites)
        for leg, turned in [(number % legs, number % 3 == 0)]
    ]


@pytest.mark.parametrize('example', [*EXAMPLES, NEARLY_WOBBLING, SLIGHT_WOBBLER])
def test_one_frame_without_noise_determines_the_class_and_the_tail_ratio(example):
    chain = chain_of(example, ROTORS)
    for angles in walls(example):
        evidence = motion_evidence(angles)
        found = evidence.verdict()
        if example in EXAMPLES:
            assert found.motion is chain.motion
            assert found.confidence > 0.95
        if chain.motion is not Motion.SPINNER:
            # The mean of the outer rotors is the reference, which have tails of wide walls.
            assert evidence.rest_angle == pytest.approx(chain.rest_angle, rel=0.02)
            expected = (1 - chain.lean_ratio) / (1 + chain.lean_ratio)
            assert evidence.tail_ratio == pytest.approx(expected, rel=0.1, abs=0.002)


@pytest.mark.parametrize('noise', [0.01, 0.2])
@pytest.mark.parametrize('example', EXAMPLES)
def test_flippers_and_spinners_are_never_confused(example, noise):
    random = np.random.default_rng(5)
    chain, frames, count = chain_of(example, 4), walls(example), 300
    spins, seen = chain.motion is Motion.SPINNER, 0
    for number in range(count):
        angles = frames[number % len(frames)] + noise * random.standard_normal(ROTORS)
        evidence = motion_evidence(angles)
        if math.isnan(evidence.site):
            continue
        seen += 1
        spinning = evidence.verdict().spinning
        assert (spinning > 0.95) if spins else (spinning < 0.05)
    # A chain that leans by little more than the noise may not be seen to have a wall.
    assert seen == count or 4 * noise > chain.rest_angle
    assert seen >= 0.9 * count


@pytest.mark.parametrize('noise', [0.003, 0.05])
@pytest.mark.parametrize('example', FLIPPERS)
def test_a_class_is_wrong_no_more_often_than_stated(example, noise):
    random = np.random.default_rng(17)
    motion, frames, count = chain_of(example, 4).motion, walls(example), 400
    doubt, wrong = 0.0, 0
    for number in range(count):
        angles = frames[number % len(frames)] + noise * random.standard_normal(ROTORS)
        found = motion_evidence(angles, noise).verdict()
        if found.motion is not None:
            doubt += 1 - found.confidence
            wrong += found.motion is not motion
    # The limit is four standard deviations of a Poisson count.
    assert wrong <= doubt + 4 * math.sqrt(doubt + 1)


@pytest.mark.parametrize('example', [FLIPPER, SLIGHT_WOBBLER, WOBBLER])
def test_the_error_of_the_tail_ratio_is_as_stated(example):
    random, noise = np.random.default_rng(29), 0.01
    errors = []
    for angles in walls(example):
        truth = motion_evidence(angles).tail_ratio
        for _ in range(40):
            noisy = angles + noise * random.standard_normal(ROTORS)
            *_, ratio, deviation = motion_evidence(noisy, noise)
            if math.isfinite(ratio):
                errors.append((ratio - truth) / deviation)
    # The prior of the bend includes springs in motion. Bars at rest bend less, so that errors are
    # smaller than stated by up to a half.
    assert 0.4 < float(np.sqrt(np.mean(np.square(errors)))) < 1.15
    assert abs(float(np.mean(errors))) < 0.35


@pytest.mark.parametrize('example', [NEARLY_WOBBLING, SLIGHT_WOBBLER])
def test_evidence_accumulates_until_a_restart(example):
    random, noise = np.random.default_rng(31), 0.01
    frames, motion = walls(example), chain_of(example, 4).motion
    observer = MotionObserver()
    found, unsure = [], []
    for n in range(600):
        frame = frames[n % len(frames)] + noise * random.standard_normal(ROTORS)
        found.append(observer.observe(frame, noise))
        unsure.append(observer.evidence.tail_ratio_deviation)
    assert found[0].motion in (None, motion)
    assert all(each.motion is motion for each in found[-50:])
    assert unsure[-1] < 0.3 * unsure[0]
    observer.restart()
    blank = observer.observe(np.full(ROTORS, math.nan))
    assert (blank.motion, blank.spinning) == (None, pytest.approx(1 / 3))
    assert math.isnan(observer.evidence.tail_ratio)


def test_contradicting_frames_change_the_class():
    observer = MotionObserver()
    for angles in 20 * walls(FLIPPER):
        observer.observe(angles)
    spinners = walls(SPINNER)
    for angles in spinners[:7]:
        found = observer.observe(angles)
    assert found.spinning > 0.95


@pytest.mark.parametrize('example', EXAMPLES)
def test_symmetries_do_not_change_the_evidence(example):
    random = np.random.default_rng(37)
    for angles in walls(example):
        noisy = angles + 0.01 * random.standard_normal(ROTORS)
        evidence = motion_evidence(noisy)
        last = ROTORS - 1
        turns = 2 * np.pi * random.integers(-3, 4, ROTORS)
        for image, mirrored in (
            (np.pi - noisy, False),
            (noisy + turns, False),
            (-noisy[::-1], True),
            (np.pi + noisy[::-1], True),
        ):
            found = motion_evidence(image)
            site = last - found.site if mirrored else found.site
            assert site == pytest.approx(evidence.site, abs=1e-9)
            assert found.flipping == pytest.approx(evidence.flipping)
            assert found.tails == pytest.approx(evidence.tails, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize('example', EXAMPLES)
def test_without_a_wall_there_is_no_evidence(example):
    for noise in [0.0, 0.05]:
        random = np.random.default_rng(41)
        chain = chain_of(example, ROTORS)
        for lean in (-1, 1):
            for _ in range(50):
                angles = chain.uniform_state(lean) + noise * random.standard_normal(ROTORS)
                assert says_nothing(motion_evidence(angles, noise))
        assert NO_EVIDENCE.verdict().motion is None


@given(st.integers(0, 9), st.floats(0.01, 3))
def test_a_short_or_disordered_chain_gives_no_evidence(rotors, spread):
    angles = spread * np.sin(np.arange(rotors) ** 2)
    assert says_nothing(motion_evidence(angles))


@pytest.mark.parametrize('example', EXAMPLES)
def test_missing_angles_reduce_the_evidence_without_bias(example):
    random = np.random.default_rng(43)
    motion, observer = chain_of(example, 4).motion, MotionObserver()
    for angles in 8 * walls(example):
        holed = np.where(random.random(ROTORS) < 0.2, math.nan, angles)
        found = observer.observe(holed + 0.003 * random.standard_normal(ROTORS), 0.003)
    assert found.motion is motion


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER])
def test_a_moving_wall_keeps_its_class(example):
    random, noise = np.random.default_rng(47), 0.005
    chain = chain_of(example, 40)
    start, kick = static_wall(chain, 10.3), 0.08
    speed = kick * chain.spacing / (chain.rotor_length * chain.time_unit)
    period = 0.15 * site_arc(chain) / speed
    rates = speed * mode_towards_last(chain, start)
    recording = simulate(chain, start, rates, 100 * period, period, 1e-7)
    observer = MotionObserver()
    for angles in recording.angles[20:]:
        found = observer.observe(angles + noise * random.standard_normal(40), noise)
    assert found.motion is chain.motion


def test_an_invalid_noise_and_angles_of_several_frames_are_rejected():
    for noise in [-0.1, math.nan, math.inf]:
        with pytest.raises(ValueError, match=f'noise = {noise} rad must be a finite number'):
            motion_evidence(np.zeros(20), noise)
    with pytest.raises(ValueError, match=r'angles have the shape \(2, 20\); give one row'):
        motion_evidence(np.zeros((2, 20)))


def test_motors_that_deform_a_kink_do_not_make_a_flipper_wobble():
    """Without the deformation by the motors, the tails would be those of a wobbling flipper."""
    rotors, inertia = 60, 0.02 * 0.05**2
    chain = Chain(rotors, 0.1, 0.05, 0.97, damping=4 * inertia, non_reciprocity=48 * inertia)
    start = with_soliton(chain, 24.0, 0.0)
    recording = simulate(chain, start.angles, start.rates, 1.6, 0.004)
    analyser = Analyser(chain)
    for time, angles in zip(recording.times, recording.angles, strict=True):
        found = analyser.analyse(round(1e9 * time), angles)
        assert found.measured_motion.motion is not Motion.WOBBLING_FLIPPER


def test_the_tails_of_an_anti_kink_do_not_make_a_flipper_wobble():
    chain = Chain(60, 0.1, 0.058, 0.97, damping=20 * 0.02 * 0.058**2)
    start = continuum_anti_kink(chain, 30.0)
    angles = simulate(chain, start, 0 * start, 2.0, 0.1).angles[-1]
    assert MotionObserver().observe(angles).motion is not Motion.WOBBLING_FLIPPER
