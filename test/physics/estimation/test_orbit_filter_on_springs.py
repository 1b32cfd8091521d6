# SPDX-License-Identifier: Apache-2.0
"""Filter along the orbit on chains of springs, with deviations and faulty encoders.

A moving chain of springs is not exactly on the orbit of rigid bars. The reference is the nearest
point of the orbit, averaged over the passage of a rotor, and its slope over three passages.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, SPINNER, WIDE_FLIPPER, WOBBLER, chain_of

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.estimation.estimates import OrbitEstimate, TrackingStatus
from soliton_linkage.estimation.frames import FrameImpulse
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.estimation.relocalisation import fit_anywhere, fit_near
from soliton_linkage.linear.rigidity import mode_towards_last, zero_mode
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS, drawn_deviations
from soliton_linkage.linkage.feedback import Feedback
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

SPEEDS = {FLIPPER: 10.0, WOBBLER: 4.0, SPINNER: 12.5, WIDE_FLIPPER: 4.0}
PERIOD = 0.004


@dataclass(frozen=True)
class Record:
    """Exact angles of a chain, and its position on the orbit."""

    orbit: UniformOrbit
    angles: Array
    arcs: Array
    rates: Array
    frames: int
    """Number of frames from one rotor to the next."""


def smoothed(values: Array, weights: Array) -> Array:
    """Return weighted moving means, with odd reflections at the ends."""
    beside = len(weights) // 2
    before = 2 * values[0] - values[beside:0:-1]
    after = 2 * values[-1] - values[-2 : -beside - 2 : -1]
    return np.convolve(np.concatenate([before, values, after]), weights[::-1], 'valid')


def recorded(chain: Chain, angles: Array) -> Record:
    orbit = UniformOrbit(dataclasses.replace(chain, deviations=NO_DEVIATIONS))
    sites = [fit_anywhere(orbit, image[30]) for image in (angles, math.pi - angles)]
    turned = sites[1].misfit < sites[0].misfit
    image = math.pi - angles if turned else angles
    nearest = np.zeros(len(angles))
    for frames in (range(30, -1, -1), range(30, len(angles))):
        arc = sites[turned].arc
        for frame in frames:
            arc = nearest[frame] = fit_near(orbit, image[frame], arc).arc
    frames = max(round(orbit.site_arc / abs(np.median(np.diff(nearest)))), 2)
    count = 2 * (frames // 2) + 1
    times = PERIOD * (np.arange(6 * (frames // 2) + 1) - 3 * (frames // 2))
    return Record(
        orbit,
        angles,
        smoothed(nearest, np.full(count, 1 / count)),
        smoothed(nearest, times / (times @ times)),
        frames,
    )


def moving(example: tuple[float, float], chain: Chain) -> ElasticSimulation:
    start = unstretched(chain, chain.uniform_state(-1))
    rates = SPEEDS[example] * mode_towards_last(chain, start)
    return ElasticSimulation(chain, start, rates, PERIOD, 1e-7)


@lru_cache(maxsize=16)
def passage(
    example: tuple[float, float], rotors: int, duration: float, disorder: int | None = None
) -> Record:
    chain = chain_of(example, rotors)
    if disorder is not None:
        drawn = drawn_deviations(rotors, disorder, spacing=0.05, rotor_length=0.05, stiffness=0.05)
        chain = dataclasses.replace(chain, deviations=drawn)
    return recorded(chain, moving(example, chain).record(duration).angles)


@dataclass(frozen=True)
class Followed:
    tracker: OrbitFilter
    estimates: list[OrbitEstimate]
    scores: Array
    """Normalised errors of arc and rate, shape (2, frames), without the ends of the record."""

    @property
    def largest_step(self) -> float:
        """Largest change of the place in a frame, after the first fifty."""
        sites = np.array([each.site for each in self.estimates[50:]])
        return float(np.abs(np.diff(sites)).max())


def followed(
    record: Record, noise: float, spoil: Callable[[int, Array], None] | None = None, seed: int = 3
) -> Followed:
    random = np.random.default_rng(seed)
    tracker = OrbitFilter(record.orbit, noise)
    scores, estimates = [], []
    for frame, exact in enumerate(record.angles):
        noisy = exact + noise * random.standard_normal(len(exact))
        if spoil:
            spoil(frame, noisy)
        estimate = tracker.update(frame * PERIOD, noisy)
        off = math.remainder(estimate.arc - record.arcs[frame], record.orbit.length)
        changed = estimate.rate - record.rates[frame]
        scores.append((off / estimate.arc_deviation, changed / estimate.rate_deviation))
        estimates.append(estimate)
    inside = slice(3 * record.frames, -3 * record.frames)
    return Followed(tracker, estimates, np.array(scores)[inside].T)


def test_stated_deviations_are_correct_on_chains_of_springs():
    variances = []
    for example, rotors in [(FLIPPER, 20), (WOBBLER, 20), (SPINNER, 20), (WIDE_FLIPPER, 40)]:
        record = passage(example, rotors, 5.0)
        for noise in (0.002, 0.05):
            made = followed(record, noise)
            assert np.abs(made.scores).max() < 6
            assert made.tracker.starts == 1
            assert not made.tracker.offsets.corrections.any()
            variances.append(np.mean(made.scores**2, axis=1))
            # Of one passage, in which frames after each other have much the same error.
            assert variances[-1].min() > 0.1
            assert variances[-1].max() < 2.5
    of_arc, of_rate = np.mean(variances, axis=0)
    assert 0.5 < of_arc < 1.5
    assert 0.5 < of_rate < 1.5


def test_unmodelled_deviations_increase_the_stated_uncertainty():
    even = followed(passage(FLIPPER, 20, 5.0), 0.01)
    variances = []
    for example, rotors, seed in [(FLIPPER, 40, 1), (FLIPPER, 40, 2)]:
        made = followed(passage(example, rotors, 4.0, seed), 0.01)
        assert made.tracker.starts == 1
        assert made.tracker.rejected == 0
        assert not made.tracker.offsets.corrections.any()
        assert made.largest_step < 0.3
        variances.append(np.mean(made.scores**2, axis=1))
        assert variances[-1].max() < 2.5
        stated = np.median([each.site_deviation for each in made.estimates])
        assert stated > 1.2 * np.median([each.site_deviation for each in even.estimates])
    assert np.mean(variances) < 1.5


@pytest.mark.parametrize('share', [-0.2, 0.5])
def test_a_kick_is_detected_within_a_few_rotors(share):
    chain = chain_of(FLIPPER, 40)
    simulation = moving(FLIPPER, chain)
    before = simulation.record(1.4).angles
    mode = zero_mode(chain, simulation.angles)
    simulation.kick(share * chain.moment_of_inertia * (simulation.rates @ mode) * mode)
    record = recorded(chain, np.concatenate([before, simulation.record(1.0).angles[1:]]))
    made = followed(record, 0.05)
    kicked, rotor = len(before), record.frames
    true = record.rates[kicked + 3 * rotor] / record.rates[kicked - 4 * rotor]
    found = made.estimates[kicked + 3 * rotor].rate / made.estimates[kicked - 1].rate
    assert found - 1 == pytest.approx(true - 1, rel=0.3)
    assert made.tracker.starts == 1
    assert made.largest_step < 0.3
    after = made.scores[:, kicked - 3 * rotor + 3 * rotor :]
    assert np.abs(after).max() < 6


@pytest.mark.parametrize(
    ('example', 'turned'), [(FLIPPER, False), (WOBBLER, True), (SPINNER, True)]
)
def test_after_a_reported_kick_the_rate_is_correct_in_the_next_frame(example, turned):
    chain, noise = chain_of(example, 20), 0.01
    simulation = moving(example, chain)
    before = simulation.record(0.8).angles
    mode = zero_mode(chain, simulation.angles)
    impulses = -0.3 * chain.moment_of_inertia * (simulation.rates @ mode) * mode
    simulation.kick(impulses)
    record = recorded(chain, np.concatenate([before, simulation.record(1.2).angles[1:]]))
    kicked, random = len(before) - 1, np.random.default_rng(5)
    reported, unknown = OrbitFilter(record.orbit, noise), OrbitFilter(record.orbit, noise)
    for frame, exact in enumerate(record.angles):
        noisy = exact + noise * random.standard_normal(len(exact))
        seen = math.pi - noisy if turned else noisy
        found, other = (each.update(frame * PERIOD, seen) for each in (reported, unknown))
        if frame == kicked:
            reported.apply_impulse(FrameImpulse(-impulses if turned else impulses))
            deviation, found = found.rate_deviation, reported.estimate
            assert found.rate_deviation < deviation + 0.05 * abs(found.rate)
            true = record.rates[min(frame + 3 * record.frames, len(record.rates) - 1)]
            assert abs(true - found.rate) < 4 * found.rate_deviation
            assert abs(true - other.rate) > 10 * other.rate_deviation
        if kicked <= frame < kicked + record.frames:
            image = math.pi - exact if found.upside_down != turned else exact
            nearest = fit_near(record.orbit, image, found.arc)
            assert abs(nearest.arc - found.arc) < 5 * found.arc_deviation


@pytest.mark.parametrize(
    ('example', 'rotors', 'factor'),
    [(FLIPPER, 16, 1.0), (WOBBLER, 12, 1.0), (SPINNER, 16, 1.0), (SPINNER, 20, 4.0)],
)
def test_a_wall_that_leaves_an_edge_is_located_correctly(example, rotors, factor):
    chain = chain_of(example, rotors)
    start = chain.uniform_state(-1)
    rates = factor * SPEEDS[example] * mode_towards_last(chain, start)
    angles = ElasticSimulation(chain, start, rates, PERIOD, 1e-7).record(1.2 / factor).angles
    orbit, random = UniformOrbit(chain), np.random.default_rng(5)
    for noise in (0.0, 0.002, 0.01):
        tracker = OrbitFilter(orbit)
        for frame, exact in enumerate(angles):
            noisy = exact + noise * random.standard_normal(rotors)
            estimate = tracker.update(frame * PERIOD, noisy)
            image = math.pi - exact if estimate.upside_down else exact
            off = estimate.arc - fit_near(orbit, image, estimate.arc).arc
            assert abs(off) < 6 * estimate.arc_deviation
        assert tracker.starts == 1
        assert not tracker.offsets.corrections.any()
        if noise == 0:
            # Deformations of a fast wall that change within a frame count as noise.
            limit = 1e-4 if factor == 1 else 0.02 * estimate.misfit
            assert estimate.noise < limit
            assert estimate.misfit > 1e-4


@pytest.mark.parametrize('example', CLASSES)
def test_a_kicked_chain_at_rest_is_tracked_without_noise(example):
    chain = chain_of(example, 16)
    start = chain.uniform_state(-1)
    simulation = ElasticSimulation(chain, start, 0 * start, PERIOD, 1e-7)
    resting = simulation.record(0.4).angles
    moment = chain.moment_of_inertia
    simulation.kick(SPEEDS[example] * moment * mode_towards_last(chain, start))
    orbit = UniformOrbit(chain)
    tracker = OrbitFilter(orbit)
    for frame, exact in enumerate(np.concatenate([resting, simulation.record(0.4).angles[1:]])):
        estimate = tracker.update(frame * PERIOD, exact)
        assert estimate.status is not TrackingStatus.COASTING
        if frame > len(resting) + 3:
            image = math.pi - exact if estimate.upside_down else exact
            off = estimate.arc - fit_near(orbit, image, estimate.arc).arc
            assert abs(off) < 4 * estimate.arc_deviation
    assert tracker.starts == 1


def test_in_a_strong_wake_the_site_is_continuous_though_the_edge_toggles_back():
    chain = chain_of(FLIPPER, 20)
    start = chain.uniform_state(-1)
    rates = 4 * SPEEDS[FLIPPER] * mode_towards_last(chain, start)
    angles = ElasticSimulation(chain, start, rates, PERIOD, 1e-7).record(1.6).angles
    orbit, random = UniformOrbit(chain), np.random.default_rng(1)
    tracker, legs, sites, true = OrbitFilter(orbit), [], [], []
    arc = 0.0
    for frame, exact in enumerate(angles):
        estimate = tracker.update(frame * PERIOD, exact + 0.01 * random.standard_normal(20))
        arc = fit_near(orbit, exact, arc).arc
        legs.append(estimate.leg)
        sites.append(estimate.site)
        true.append(orbit.site(arc))
    assert np.abs(np.diff(sites)).max() < 2 * np.abs(np.diff(true)).max()
    assert np.abs(np.subtract(sites, true)).max() < 0.2
    # The last rotor has toggled back.
    toggled = [orbit.background(orbit.arc_at(orbit.middle, leg))[1][-1] for leg in (0, 1)]
    apart = np.abs(np.angle(np.exp(1j * (np.array(toggled) - angles[-60:, -1].mean()))))
    assert apart[0] < apart[1]
    assert legs[-60] == 0


def test_another_pair_of_walls_has_no_effect():
    record = passage(FLIPPER, 40, 4.0)
    turned = record.orbit.chain.uniform_state(-1) - record.orbit.chain.uniform_state(1)

    def appear(frame: int, angles: Array) -> None:
        # The wall comes to rotor 26 in frame 680.
        share = min(max((frame - 300) / 25, 0), 1) * (frame < 500)
        angles[29:34] -= share * turned[29:34]

    made = followed(record, 0.01, appear)
    assert np.abs(made.scores).max() < 6
    assert made.tracker.starts == 1
    assert made.tracker.rejected == 0
    assert not made.tracker.offsets.corrections.any()


def test_a_stuck_encoder_is_excluded():
    record = passage(FLIPPER, 40, 4.0)
    frozen = {}

    def stick(frame: int, angles: Array) -> None:
        if frame >= 100:
            angles[20] = frozen.setdefault(20, angles[20])

    made = followed(record, 0.01, stick)
    assert made.estimates[-1].site > 30
    assert np.abs(made.scores).max() < 6
    assert made.tracker.starts == 1
    assert not made.tracker.offsets.corrections.any()


def test_offsets_of_a_few_encoders_are_found_in_one_passage():
    record = passage(FLIPPER, 40, 4.5)
    offsets = np.zeros(40)
    offsets[[7, 18, 29]] = 0.1, -0.1, 0.1

    def shift(_frame: int, angles: Array) -> None:
        angles += offsets

    made = followed(record, 0.01, shift)
    found = made.tracker.offsets
    assert found.corrections.nonzero()[0].tolist() == [7, 18, 29]
    wrong = (found.values - offsets)[[7, 18, 29]] / found.deviations[[7, 18, 29]]
    assert np.abs(wrong).max() < 3
    assert found.deviations[[7, 18, 29]].max() < 0.002
    # An encoder with a possible offset has no weight until the offset is known.
    assert np.abs(made.scores).max() < 6


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_a_chain_at_rest_stays_where_it_is(example):
    chain = chain_of(example, 40)
    tracker, random = OrbitFilter(UniformOrbit(chain)), np.random.default_rng(1)
    for frame in range(3000):
        noise = 0.01 * random.standard_normal(40)
        estimate = tracker.update(0.02 * frame, chain.uniform_state(-1) + noise)
    assert not tracker.offsets.corrections.any()
    assert tracker.starts == 1
    assert estimate.site == 0
    assert abs(estimate.rate) < 4.5 * estimate.rate_deviation
    # A persistent error of measurement would never vanish.
    assert estimate.arc_deviation < 0.003


@pytest.mark.parametrize('what', ['damping', 'tilt'])
def test_slow_forces_cause_no_detection(what):
    chain = chain_of(FLIPPER, 30)
    if what == 'damping':
        chain = dataclasses.replace(chain, damping=0.02 * chain.moment_of_inertia)
    simulation = moving(FLIPPER, chain)
    angles = [simulation.angles]
    for frame in range(400):
        if what == 'tilt':
            simulation.set_gravity(Gravity(9.81 * math.sin(1e-4 * frame), tilt=1.0))
        simulation.advance()
        angles.append(simulation.angles)
    made = followed(recorded(chain, np.array(angles)), 0.01)
    assert np.abs(made.scores).max() < 6
    assert made.tracker.starts == 1
    assert {each.status for each in made.estimates[1:]} == {TrackingStatus.TRACKING}


@pytest.mark.parametrize(
    'terms',
    [
        {'damping': 1e-4},
        {'dry_friction': 5e-5},
        {'quadratic_damping': 1e-5},
        {'non_reciprocity': 2e-4},
        {'on_site_torque': 2e-4, 'on_site_phase': 0.5},
        {'feedback': Feedback(rate=1e-4, left_angle=1e-4, right_angle=-1e-4, delay=2)},
    ],
    ids=lambda terms: next(iter(terms)),
)
def test_known_forces_are_predicted_while_no_angle_is_measured(terms):
    chain = dataclasses.replace(chain_of(FLIPPER, 40), **terms)
    start, random = with_soliton(chain, 8.0, 0.6), np.random.default_rng(2)
    simulation = ElasticSimulation(chain, start.angles, start.rates, PERIOD)
    orbit = UniformOrbit(chain)
    tracker, measured, gap = OrbitFilter(orbit, 0.003), 100, 100
    for frame in range(measured + gap):
        angles = simulation.angles + 0.003 * random.standard_normal(40)
        seen = angles if frame < measured else np.full(40, math.nan)
        estimate = tracker.update(PERIOD * frame, seen)
        if frame == measured - 1:
            straight = estimate.site + estimate.site_rate * PERIOD * gap
        simulation.advance()
    site = orbit.site(fit_anywhere(orbit, angles).arc)
    assert abs(straight - site) > 0.1
    assert abs(estimate.site - site) < 0.1 * abs(straight - site)


def predicted_and_true_shift(chain: Chain, noise: float) -> tuple[float, float]:
    """Return how far a fast wall is from its straight path after 100 frames without angles."""
    start, random = with_soliton(chain, 8.0, 0.6), np.random.default_rng(2)
    simulation = ElasticSimulation(chain, start.angles, start.rates, PERIOD)
    orbit = UniformOrbit(chain)
    tracker = OrbitFilter(orbit, noise)
    for frame in range(200):
        angles = simulation.angles + noise * random.standard_normal(chain.number_of_rotors)
        seen = angles if frame < 100 else np.full(chain.number_of_rotors, math.nan)
        estimate = tracker.update(PERIOD * frame, seen)
        if frame == 99:
            straight = estimate.site + estimate.site_rate * PERIOD * 100
        simulation.advance()
    return estimate.site - straight, orbit.site(fit_anywhere(orbit, angles).arc) - straight


def test_the_contraction_of_a_fast_wall_does_not_change_the_work_of_a_potential():
    # The torque of a motor on its own rotor is that of a potential.
    pulled = [Feedback(angle=1e-4, reference=at, limit=10.0) for at in (-0.5, 0.5)]
    chains = [dataclasses.replace(chain_of(FLIPPER, 40), feedback=each) for each in pulled]
    shifts = [predicted_and_true_shift(chain, 0.001) for chain in chains]
    predicted, true = np.diff(shifts, axis=0)[0]
    assert abs(true) > 0.25
    assert predicted == pytest.approx(true, rel=0.04)
