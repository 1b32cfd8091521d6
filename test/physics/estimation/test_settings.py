# SPDX-License-Identifier: Apache-2.0
"""A number that is changed in the settings has its effect, in the loops as well."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.encoder_offsets import EncoderOffsets
from soliton_linkage.estimation.measurement import FrameLikelihood
from soliton_linkage.estimation.motion_class import MotionObserver
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import (
    DEFAULTS,
    EstimationSettings,
    FilterSettings,
    LikelihoodSettings,
    MotionSettings,
    OffsetSettings,
    ReportSettings,
    TrackingSettings,
    WobbleSettings,
)
from soliton_linkage.estimation.state_report import StateReporter
from soliton_linkage.estimation.wobble import RestingWall, WobbleReporter
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import static_wall

ROTORS = 40
CHAIN = Chain(number_of_rotors=ROTORS, rotor_length=0.1, rest_angle=0.77)
PARTS = [getattr(DEFAULTS, each.name) for each in dataclasses.fields(EstimationSettings)]


def noisy_wall() -> Array:
    noise = 0.003 * np.random.default_rng(1).standard_normal(ROTORS)
    return static_wall(CHAIN, 19.3) + noise


@pytest.mark.parametrize('part', PARTS, ids=lambda part: type(part).__name__)
def test_each_number_is_described_and_is_that_of_the_record(part: MotionSettings) -> None:
    described = described_fields(type(part))
    assert set(described) == {each.name for each in dataclasses.fields(part)}
    assert all(each.description for each in described.values())
    for name in part.record.dtype.names or ():
        assert part.record[name] == [getattr(part, name)]
    with pytest.raises(ValueError, match='read-only'):
        part.record[0] = 0


def test_evidence_of_motion_follows_its_settings() -> None:
    angles = noisy_wall()
    weak = MotionSettings(strongest_frame=2.0, strongest=3.0, sure=1.1)
    for settings, flipping in ((MotionSettings(), 10.0), (weak, 2.0)):
        observer = MotionObserver(settings)
        observer.observe(angles)
        assert observer.evidence.flipping == pytest.approx(flipping)
    observer = MotionObserver(MotionSettings(fewest_rotors=20))
    observer.observe(angles)
    assert math.isnan(observer.evidence.place)
    observer = MotionObserver(weak)
    for _ in range(3):
        assert observer.observe(angles).motion is None
    assert observer.evidence.flipping == pytest.approx(3.0)


def test_offsets_are_believed_by_their_settings() -> None:
    offsets = [
        EncoderOffsets(1, OffsetSettings(significance=limit, fewest_means=fewest))
        for limit, fewest in ((5.5, 5), (1e3, 5), (5.5, 50))
    ]
    for number in range(40):
        for each in offsets:
            each.update(np.array([0.5]), np.array([1.0 if number % 2 else -1.0]), 1e-4)
    assert [each.corrections[0] != 0 for each in offsets] == [True, False, False]


@pytest.mark.parametrize(
    ('settings', 'kicks'),
    [(FilterSettings(), 1), (FilterSettings(kick_beyond_chance=1e9), 0)],
)
def test_kicks_are_believed_by_their_settings(settings: FilterSettings, kicks: int) -> None:
    tracker = MultipleModelFilter(0.0, 1e-4, 50.0, 0.99, settings)
    for number in range(1, 600):
        tracker.predict(1e-3, False)
        tracker.update(9.6e-3 * number + 9.6e-3 * max(number - 400, 0), 1e-4)
    assert tracker.kicks == kicks


def test_the_weight_of_a_kick_follows_its_settings() -> None:
    weights = []
    for rarity in (9.0, 3.0):
        tracker = MultipleModelFilter(
            0.0, 1e-4, 50.0, 0.99, FilterSettings(kick_rarity=rarity, kick_beyond_chance=1e9)
        )
        for number in range(1, 405):
            tracker.predict(1e-3, False)
            tracker.update(9.6e-3 * number + 9.6e-3 * max(number - 400, 0), 1e-4)
        weights.append(float(tracker.filters['weight'][-8:].sum()))
    assert 0 < weights[0] < weights[1]


def test_the_weights_of_a_frame_follow_their_settings() -> None:
    differences = np.array([0.3, 0.0, 0.0, 0.0, 0.0])
    tangent = np.array([0.5, 0.5, 0.5])
    views = [
        FrameLikelihood(2.0, LikelihoodSettings(bound=bound)).view(
            0.0, 0, tangent, differences.copy(), 0.1**2
        )
        for bound in (1.5, 9.0)
    ]
    assert views[0].weights[0] == pytest.approx(1.5**2 / 3**2, rel=0.02)
    assert views[1].weights[0] == 1.0


def test_the_reach_of_a_wall_and_its_tails_follow_their_settings() -> None:
    angles = noisy_wall()
    wakes = [
        StateReporter(CHAIN, settings).report(angles, [19.3]).energies.elastic_wake
        for settings in (ReportSettings(), ReportSettings(reach_in_depths=0, reach_beside=0))
    ]
    assert wakes[0] < wakes[1]
    orbit = UniformOrbit(CHAIN)
    about = orbit.stretch(orbit.arc_at(19.3, 0))
    wall = RestingWall(about.first, about.angles, 19.3)
    found = [
        WobbleReporter(CHAIN, WobbleSettings(above_noise=limit)).wobble(angles, wall, 0.003)
        for limit in (4.0, 40.0)
    ]
    assert found[0].tail_ratio_deviation < found[1].tail_ratio_deviation


def test_the_analyser_hands_its_settings_on() -> None:
    limited = EstimationSettings(tracking=TrackingSettings(clock_limit=0.1))
    angles = noisy_wall()
    for settings, late in ((DEFAULTS, 1), (limited, 0)):
        analyser = Analyser(CHAIN, settings=settings)
        analyser.analyse(10**9, angles)
        assert (analyser.analyse(5 * 10**8, angles) is None) == (late > 0)
        assert analyser.late == late
