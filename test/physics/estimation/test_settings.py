# SPDX-License-Identifier: Apache-2.0
"""A number that is changed in the settings has its effect, in the loops as well."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.motion_class import MotionObserver
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import (
    DEFAULTS,
    EstimationSettings,
    FilterSettings,
    MotionSettings,
    TrackingSettings,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import described_fields
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
    weak = MotionSettings(strongest_frame=2.0, strongest=3.0, least_probability=1.1)
    for settings, flipping in ((MotionSettings(), 10.0), (weak, 2.0)):
        observer = MotionObserver(settings)
        observer.observe(angles)
        assert observer.evidence.flipping == pytest.approx(flipping)
    observer = MotionObserver(MotionSettings(fewest_rotors=20))
    observer.observe(angles)
    assert math.isnan(observer.evidence.site)
    observer = MotionObserver(weak)
    for _ in range(3):
        assert observer.observe(angles).motion is None
    assert observer.evidence.flipping == pytest.approx(3.0)


@pytest.mark.parametrize(
    ('settings', 'kicks'),
    [(FilterSettings(), 1), (FilterSettings(impulse_odds=1e9), 0)],
)
def test_kicks_are_believed_by_their_settings(settings: FilterSettings, kicks: int) -> None:
    tracker = MultipleModelFilter(0.0, 1e-4, 50.0, 0.99, settings)
    for number in range(1, 600):
        tracker.predict(1e-3, False)
        tracker.update(9.6e-3 * number + 9.6e-3 * max(number - 400, 0), 1e-4)
    assert tracker.impulses == kicks


def test_the_analyser_hands_its_settings_on() -> None:
    limited = EstimationSettings(tracking=TrackingSettings(clock_limit=0.1))
    angles = noisy_wall()
    for settings, late in ((DEFAULTS, 1), (limited, 0)):
        analyser = Analyser(CHAIN, settings=settings)
        analyser.analyse(10**9, angles)
        assert (analyser.analyse(5 * 10**8, angles) is None) == (late > 0)
        assert analyser.late == late
