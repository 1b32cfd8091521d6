# SPDX-License-Identifier: Apache-2.0
"""Analyser: tracking, robustness against faulty encoders, and stated deviations."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from soliton_linkage.dynamics.elastic import ElasticSimulation, simulate
from soliton_linkage.dynamics.initial_states import with_pair
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.analysis import Analysis, UnknownChainAnalyser
from soliton_linkage.estimation.estimates import AnalysedSoliton, TrackingStatus
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import static_wall

CHAINS = {
    'flipper': Chain(number_of_rotors=16),
    'wobbler': Chain(number_of_rotors=12, rotor_length=0.1, rest_angle=0.77),
    'spinner': Chain(number_of_rotors=16, rotor_length=0.2, rest_angle=1.18),
}
KICKS = {'flipper': 10.0, 'wobbler': 4.0, 'spinner': 12.5}
DURATIONS = {'flipper': 4.0, 'wobbler': 7.0, 'spinner': 4.0}
PERIOD = 0.004
EPOCH = 1_700_000_000_123_456_789
NOISE = 0.01
GATE = 6.0
BEGUN = 50
FEW = 600
"""Frames in which a wall crosses the chain."""


@lru_cache
def record(name: str) -> Recording:
    chain = CHAINS[name]
    start = chain.uniform_state(-1)
    kick = KICKS[name] * mode_towards_last(chain, start)
    return simulate(chain, start, kick, DURATIONS[name], PERIOD)


@lru_cache
def noisy(name: str, seed: int = 1) -> Array:
    angles = record(name).angles
    return np.asarray(angles + NOISE * np.random.default_rng(seed).standard_normal(angles.shape))


def stamps(count: int) -> list[int]:
    return [EPOCH + round(number * PERIOD * 1e9) for number in range(count)]


def analysed(
    chain: Chain, angles: Array, rates: Array | None = None, when: Sequence[int] | None = None
) -> list[Analysis]:
    analyser = Analyser(chain)
    found = []
    for number, stamp in enumerate(when or stamps(len(angles))):
        moving = None if rates is None else rates[number]
        found.append(analyser.analyse(stamp, angles[number], moving))
    assert analyser.diagnostics.late == 0
    return [each for each in found if each is not None]


@lru_cache
def exact(name: str) -> tuple[Analysis, ...]:
    return tuple(analysed(CHAINS[name], record(name).angles, record(name).rates))


@lru_cache
def seen(name: str) -> tuple[Analysis, ...]:
    return tuple(analysed(CHAINS[name], noisy(name)))


@lru_cache
def seen_with_rates(name: str) -> tuple[Analysis, ...]:
    return tuple(analysed(CHAINS[name], noisy(name), record(name).rates))


def apart(one: Analysis, other: Analysis) -> float:
    """Return the difference of two phases over its standard deviation [1]."""
    difference = math.remainder(one.cycle.phase - other.cycle.phase, 2 * math.pi)
    return abs(difference) / math.hypot(one.cycle.phase_deviation, other.cycle.phase_deviation)


def assert_true(name: str, found: Sequence[Analysis], first: int = BEGUN) -> None:
    """Compare the phase with the noiseless phase, within its deviation, from a frame on."""
    errors = [apart(*both) for both in zip(found, exact(name)[: len(found)], strict=True)]
    assert max(errors[first:]) < GATE
    assert np.nanmax(errors) < GATE


def only(analysis: Analysis) -> AnalysedSoliton:
    (soliton,) = analysis.solitons
    return soliton


@pytest.mark.parametrize('name', CHAINS)
def test_a_wall_crosses_the_chain_and_its_phase_grows_evenly_through_the_reflection(name):
    chain, found = CHAINS[name], exact(name)
    last = chain.number_of_rotors - 1
    assert found[0].solitons == ()
    sites = np.array([only(each).rotor if each.solitons else math.nan for each in found])
    assert np.nanmin(sites) < 1
    assert np.nanmax(sites) > last - 1
    assert np.nanmax(np.abs(np.diff(sites))) < 0.1 * last
    turn = np.nanargmax(sites)
    out, back = found[turn // 2], found[turn + turn // 2]
    assert only(out).velocity > 0 > only(back).velocity
    assert only(out).charge == 1
    assert only(out).position == pytest.approx(only(out).rotor * chain.spacing)
    assert (out.cycle.leg, back.cycle.leg) == (0, 1)
    cycles = [each.cycle for each in found[BEGUN:]]
    phase = np.array([each.phase + 2 * math.pi * each.completed for each in cycles])
    grown = np.diff(phase)
    assert 0 <= phase[0] < 2 * math.pi / 10
    assert phase[-1] > 3
    assert (grown > 0).all()
    assert np.abs(grown / grown.mean() - 1).max() < 0.25


@pytest.mark.parametrize('name', CHAINS)
def test_wrapped_angles_give_the_same_result(name):
    whole = seen(name)[:FEW]
    wound = analysed(CHAINS[name], wrapped(noisy(name)[:FEW]))
    for one, other in zip(whole, wound, strict=True):
        assert only_difference(one, other) < 1e-9
        assert one.edge_rotors is not None
        assert other.edge_rotors is not None
        turned = np.subtract(one.edge_rotors.turns, other.edge_rotors.turns)
        first = np.subtract(whole[0].edge_rotors.turns, wound[0].edge_rotors.turns)
        np.testing.assert_allclose(turned, first, atol=1e-12)


def only_difference(one: Analysis, other: Analysis) -> float:
    assert len(one.solitons) == len(other.solitons)
    return max(
        [abs(a.rotor - b.rotor) for a, b in zip(one.solitons, other.solitons, strict=True)],
        default=0.0,
    )


@pytest.mark.parametrize('name', CHAINS)
def test_missing_rotors_leave_a_larger_uncertainty(name):
    angles, rates = noisy(name)[:FEW].copy(), record(name).rates[:FEW].copy()
    missing = np.random.default_rng(3).random(angles.shape) < 0.4
    angles[missing] = math.nan
    rates[missing] = math.inf
    found = analysed(CHAINS[name], angles, rates)
    assert_true(name, found)
    assert [each.unseen for each in found] == missing.sum(axis=1).tolist()
    larger = np.array(
        [
            (
                one.estimate.arc_deviation / other.estimate.arc_deviation,
                one.energies.elastic_deviation / other.energies.elastic_deviation,
            )
            for one, other in zip(found[BEGUN:], seen(name)[BEGUN:FEW], strict=True)
        ]
    )
    assert (larger.mean(axis=0) > 1).all()


@pytest.mark.parametrize('name', CHAINS)
def test_frames_without_any_rotor_are_coasted_through(name):
    angles = noisy(name)[:FEW].copy()
    gap = slice(250, 310)
    angles[gap] = math.nan
    found = analysed(CHAINS[name], angles)
    assert_true(name, found)
    assert all(each.estimate.status is TrackingStatus.COASTING for each in found[gap])
    deviations = [each.estimate.arc_deviation for each in found[gap]]
    assert (np.diff(deviations) > 0).all()
    assert all(only(each).charge == 1 for each in found[gap])
    assert all(each.unseen == CHAINS[name].number_of_rotors for each in found[gap])


def test_late_and_repeated_frames_have_no_effect():
    angles, when = noisy('flipper'), stamps(len(noisy('flipper')))
    analyser, other = Analyser(CHAINS['flipper']), Analyser(CHAINS['flipper'])
    generator = np.random.default_rng(8)
    for number, stamp in enumerate(when[:400]):
        assert str(analyser.analyse(stamp, angles[number])) == str(
            other.analyse(stamp, angles[number])
        )
        if number > 5 and generator.random() < 0.3:
            back = int(generator.integers(0, 5))
            assert other.analyse(when[number - back], angles[number - back]) is None
    assert analyser.diagnostics.late == 0
    assert other.diagnostics.late > 50


@pytest.mark.parametrize('jump', [-2, 5000])
def test_a_clock_that_is_set_back_starts_a_new_record(jump):
    angles, when = noisy('flipper'), stamps(len(noisy('flipper')))
    analyser = Analyser(CHAINS['flipper'])
    for number in range(300):
        analyser.analyse(when[number], angles[number])
    fresh = Analyser(CHAINS['flipper'])
    for number in range(300, 600):
        one = analyser.analyse(when[number] + jump * 10**9, angles[number])
        other = fresh.analyse(when[number], angles[number])
        assert one is not None
        assert other is not None
        assert one.estimate.status is other.estimate.status
        assert one.cycle.phase == pytest.approx(other.cycle.phase, abs=1e-6)
        assert only_difference(one, other) < 1e-6


@pytest.mark.parametrize('name', CHAINS)
def test_a_source_that_restarts_is_found_again(name):
    angles = np.concatenate([noisy(name)[:450], noisy(name, 2)[:FEW]])
    found = analysed(CHAINS[name], angles)
    clean = exact(name)[:450] + exact(name)[:FEW]
    errors = [apart(*both) for both in zip(found, clean, strict=True)]
    assert max(errors[460:]) < GATE


@lru_cache
def approached(chain: Chain) -> tuple[Array, Analysis]:
    """Return frames of a wall that moves to rotor 11.8, and the analysis of the last one."""
    orbit, generator = UniformOrbit(chain), np.random.default_rng(5)
    sites = 11.8 - 0.04 * np.arange(40)[::-1]
    frames = np.array([orbit.configuration(orbit.arc_at(each, 0)) for each in sites.tolist()])
    frames += NOISE * generator.standard_normal(frames.shape)
    return frames, analysed(chain, frames)[-1]


def test_one_wrong_reading_does_not_move_a_wall():
    for size in [0.1, 1.0, 3.0]:
        for rotor in [11, 13]:
            chain = Chain(40, rotor_length=0.1, rest_angle=0.77)
            frames, shown = approached(chain)
            wrong = frames.copy()
            wrong[-1, rotor] += size
            one, other = shown.estimate, analysed(chain, wrong)[-1].estimate
            assert abs(one.site - other.site) < 3 * other.site_deviation
            assert other.site_deviation < 2 * one.site_deviation


@pytest.mark.parametrize('name', CHAINS)
def test_random_wrong_readings_have_a_small_effect(name):
    generator = np.random.default_rng(7)
    angles = noisy(name)[:FEW].copy()
    wrong = generator.random(angles.shape) < 0.05
    angles[wrong] = generator.uniform(-math.pi, math.pi, int(wrong.sum()))
    found, clean = analysed(CHAINS[name], angles), exact(name)[:FEW]
    scores = [apart(*both) for both in zip(found[BEGUN:], clean[BEGUN:], strict=True)]
    assert np.sqrt(np.nanmean(np.square(scores))) < 1.2
    assert np.nanmax(scores) < GATE
    assert np.isfinite(scores).mean() > 0.98


@pytest.mark.parametrize(
    ('name', 'degrees'),
    [('flipper', False), ('wobbler', False), ('spinner', False), ('spinner', True)],
)
def test_frames_without_a_wall_are_lost_and_searched_at_a_limited_rate(name, degrees):
    chain, generator = CHAINS[name], np.random.default_rng(3)
    analyser, stated = Analyser(chain), 0
    for number, stamp in enumerate(stamps(100)):
        anything = generator.uniform(-math.pi, math.pi, chain.number_of_rotors)
        angles = np.degrees(noisy(name)[number]) if degrees else anything
        found = analyser.analyse(stamp, angles)
        assert found is not None
        assert found.estimate.status is TrackingStatus.LOST, number
        assert found.solitons or found.status is TrackingStatus.LOST
        stated += len(found.solitons)
    assert analyser.diagnostics.starts == 0
    assert stated <= 1


@pytest.mark.parametrize('name', CHAINS)
def test_energies_are_those_of_the_simulation(name):
    chain, states = CHAINS[name], record(name)
    whole = float(chain.kinetic_energy(states.rates[0]) + chain.elastic_energy(states.angles[0]))
    for each in exact(name):
        assert each.energies is not None
        assert each.energies.whole == pytest.approx(whole, rel=5e-3)
        assert each.energies.wall + each.energies.wake == pytest.approx(each.energies.whole)
    noisy_energies = [each.energies for each in seen_with_rates(name)]
    errors = [
        (each.elastic - float(chain.elastic_energy(angles))) / each.elastic_deviation
        for each, angles in zip(noisy_energies, states.angles, strict=True)
        if each is not None
    ]
    assert abs(np.mean(errors[50:])) < 0.5
    assert 0.6 < np.std(errors[50:]) < 1.3


@pytest.mark.parametrize('name', CHAINS)
def test_the_class_of_motion_agrees_with_the_chain(name):
    last = seen(name)[-1]
    assert last.motion is CHAINS[name].motion
    if name != 'flipper':
        assert last.measured_motion.motion is CHAINS[name].motion
    other = 'spinner' if name != 'spinner' else 'flipper'
    wrong = replace(CHAINS[other], number_of_rotors=CHAINS[name].number_of_rotors)
    reported = analysed(wrong, noisy(name)[:FEW])[-1]
    assert reported.motion is wrong.motion
    assert reported.measured_motion.motion in (None, CHAINS[name].motion)


def domains(chain: Chain, walls: Sequence[float]) -> Array:
    """Return angles of alternating domains between walls, charge +1 first."""
    orbit = UniformOrbit(chain)
    parts = [orbit.configuration(orbit.arc_at(site, 0)) for site in walls]
    between = [(a + b) / 2 for a, b in pairwise(walls)]
    angles = parts[0].copy()
    rotors = np.arange(chain.number_of_rotors)
    for number, begin in enumerate(between, start=1):
        part = parts[number]
        if number % 2:
            part = np.where(rotors % 2, 2 * math.pi - part, -part)
        angles[rotors > begin] = part[rotors > begin]
    return angles


def test_an_invalid_noise_is_rejected():
    for noise in [-1.0, 0.0, math.nan, math.inf]:
        with pytest.raises(ValueError, match='must be finite and above 0; give None to estimate'):
            Analyser(Chain(), noise)


def test_several_walls_are_all_reported():
    chain = Chain(number_of_rotors=40)
    generator = np.random.default_rng(2)
    one = domains(chain, [8.0])
    three = domains(chain, [8.0, 20.0, 30.0])
    frames = np.array([one] * 50 + [three] * 50 + [one] * 50)
    frames = frames + NOISE * generator.standard_normal(frames.shape)
    found = analysed(chain, frames)
    for each in found[55:100]:
        assert [(wall.id, wall.charge) for wall in each.solitons] == [(1, 1), (2, -1), (3, 1)]
        sites = [soliton.rotor for soliton in each.solitons]
        np.testing.assert_allclose(sites, [8.0, 20.0, 30.0], atol=0.05)
        assert each.topology is not None
        assert each.topology.charge == 1
    for each in (*found[:50], *found[105:]):
        assert only(each).rotor == pytest.approx(8.0, abs=0.05)


def test_a_chain_without_a_cycle_is_analysed_frame_by_frame():
    ring = Chain(number_of_rotors=16, periodic=True)
    analyser = Analyser(ring)
    assert 'periodic ends has no orbit' in analyser.limitation
    found = analyser.analyse(EPOCH, ring.uniform_state(1))
    assert found is not None
    assert found.solitons == ()
    assert found.estimate.status is TrackingStatus.LOST
    pair = Analyser(Chain(number_of_rotors=2))
    assert pair.limitation
    assert pair.analyse(EPOCH, Chain(number_of_rotors=2).uniform_state(1)) is not None


@pytest.mark.parametrize('name', CHAINS)
def test_an_unknown_chain_has_a_class_of_motion(name):
    analyser = UnknownChainAnalyser(CHAINS[name].number_of_rotors)
    found = [
        analyser.analyse(stamp, angles)
        for stamp, angles in zip(stamps(10**6), wrapped(noisy(name)), strict=False)
    ]
    last = found[-1]
    assert last is not None
    expected = {'flipper': (Motion.FLIPPER, None), 'wobbler': (Motion.WOBBLING_FLIPPER,)}
    assert last.motion in expected.get(name, (Motion.SPINNER,))
    for one, clean in zip(found, exact(name), strict=True):
        assert one is not None
        if one.solitons:
            assert only(one).charge == 1
            assert math.isnan(only(one).position_deviation)
            assert abs(only(one).rotor - only(clean).rotor) < 2


def test_frames_of_another_length_are_rejected():
    for rates in [None, np.zeros(15)]:
        with pytest.raises(ValueError, match='do not fit a chain of 16 rotors; give one'):
            Analyser(CHAINS['flipper']).analyse(
                EPOCH, np.zeros(15 if rates is None else 16), rates
            )


def test_any_numbers_are_analysed():
    generator = np.random.default_rng(4)
    analyser = Analyser(CHAINS['flipper'])
    for number in range(300):
        size = 10.0 ** generator.uniform(-150, 150)
        angles, rates = generator.uniform(-size, size, (2, 16))
        angles[generator.random(16) < 0.2] = generator.choice([math.nan, math.inf])
        assert analyser.analyse(EPOCH + number, angles, rates) is not None


@pytest.mark.parametrize(
    'sections',
    [
        [(5.5, 50, 0, 0.0), (None, 100, 0, 0.01), (None, 200, 0, 0.0)],
        [(3.2, 50, 0, 0.0), (None, 300, 8, 0.01), (8.5, 300, 8, 0.01)],
    ],
    ids=['struck', 'pulled'],
)
def test_a_wall_at_rest_does_not_remember_unmodelled_torques(sections):
    """Each section has a position to which the chain is reset, frames, a rotor and its torque."""
    chain, period, stamp = Chain(12), 0.02, 0
    analyser = Analyser(chain)
    found: list[Analysis | None] = []
    for site, frames, rotor, torque in [*sections, (5.5, 1500, 0, 0.0)]:
        if site is not None:
            at_rest = static_wall(chain, site)
            simulation = ElasticSimulation(chain, at_rest, np.zeros(12), period, 1e-9)
        torques = np.zeros(12)
        torques[rotor] = torque
        simulation.hold(torques)
        found = []
        for _ in range(frames):
            simulation.advance()
            stamp += round(1e9 * period)
            found.append(analyser.analyse(stamp, simulation.angles, simulation.rates))
    estimates = [each.estimate for each in found[150:] if each is not None]
    assert all(abs(each.site - 5.5) < GATE * each.site_deviation for each in estimates)
    assert estimates[-1].site == pytest.approx(5.5, abs=1e-3)
    assert estimates[-1].site_deviation < 2e-3
    assert not analyser.diagnostics.offsets.any()


def test_two_walls_in_waves_with_a_wrong_reading_are_analysed():
    chain, random = Chain(40), np.random.default_rng(1)
    analyser, phases = Analyser(chain), random.uniform(0, 2 * math.pi, 40)
    start = with_pair(chain, 26.0, 12.0).angles
    for frame in range(120):
        angles = start + 0.03 * np.sin(0.2 * frame + phases) + random.normal(0, 0.003, 40)
        angles[[13, 27]] += 1.5 * (frame > 60)
        analysis = analyser.analyse(4_000_000 * frame, angles)
        assert analysis is not None
        assert len(analysis.solitons) == 2


def test_the_error_of_the_rest_angle_has_the_same_sign_upside_down():
    chain = CHAINS['flipper']
    leaning = replace(chain, rest_angle=chain.rest_angle + 0.01)
    walls = np.array([static_wall(leaning, site) for site in np.linspace(3, 12, FEW)])
    angles = walls + NOISE * np.random.default_rng(3).standard_normal(walls.shape)
    for seen in (angles, math.pi - angles):
        analyser = Analyser(chain, NOISE)
        for stamp, frame in zip(stamps(FEW), seen, strict=True):
            analyser.analyse(stamp, frame)
        assert analyser.diagnostics.rest_angle_error == pytest.approx(0.01, abs=0.003)
