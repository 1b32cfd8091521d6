# SPDX-License-Identifier: Apache-2.0
"""Effect of settings, and compiled loops against closed forms and against Python."""

import dataclasses
import json
import math
import os
import subprocess
import sys

import analyse_record
import numpy as np
import pytest

from soliton_linkage.estimation import filter_bank, state_loops
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.frames import all_within
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


def test_each_setting_is_described_and_equals_its_record():
    for part in PARTS:
        described = described_fields(type(part))
        assert set(described) == {each.name for each in dataclasses.fields(part)}
        assert all(each.description for each in described.values())
        for name in part.record.dtype.names or ():
            assert part.record[name] == [getattr(part, name)]
        with pytest.raises(ValueError, match='read-only'):
            part.record[0] = 0


def test_evidence_of_motion_follows_its_settings():
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


def test_kicks_are_detected_by_the_settings():
    for settings, kicks in [(FilterSettings(), 1), (FilterSettings(decisive_odds=1e9), 0)]:
        tracker = MultipleModelFilter(0.0, 1e-4, 50.0, 0.99, settings)
        for number in range(1, 600):
            tracker.predict(1e-3, False)
            tracker.update(9.6e-3 * number + 9.6e-3 * max(number - 400, 0), 1e-4)
        assert tracker.impulses == kicks


def test_the_analyser_uses_its_settings():
    limited = EstimationSettings(tracking=TrackingSettings(clock_limit=0.1))
    angles = noisy_wall()
    for settings, late in ((DEFAULTS, 1), (limited, 0)):
        analyser = Analyser(CHAIN, settings=settings)
        analyser.analyse(10**9, angles)
        assert (analyser.analyse(5 * 10**8, angles) is None) == (late > 0)
        assert analyser.diagnostics.late == late


def test_loops_reject_other_types_instead_of_compiling():
    # A loop rejects an argument of another type instead of compiling for it.
    with pytest.raises(TypeError):
        all_within(np.zeros(4, dtype=np.float32), 1.0)
    frozen = np.ones(4)
    frozen.flags.writeable = False
    assert all_within(frozen, 1.0)


def test_a_filter_without_weight_may_be_the_likeliest_by_any_amount():
    # The first two filters expect 0; one without probability and one with an impulse expect 1.
    made = np.zeros(4, filter_bank.FILTER)
    made['state'][:, filter_bank.ARC] = [0.0, 0.0, 1.0, 1.0]
    variance = 1e-12
    made['covariance'][:, filter_bank.ARC, filter_bank.ARC] = variance
    made['prior'][1:3] = 0.5
    made['probability'][1] = 1.0
    made['weight'][:2] = 0.5
    made['likelihood'][2] = -2000.0
    against, largest = filter_bank.update(made, 3, 1.0, variance, math.inf)
    assert against == pytest.approx(0.0, abs=1e-9)
    assert largest == made['odds'][3] == pytest.approx(1 / (4 * variance))
    assert made['probability'][1:3] == pytest.approx([0.0, 1.0])


def test_the_centre_of_the_mode_is_exact_over_800_decades():
    # Squares of 10^(2 k) as far as k = 400 below the largest, and up again.
    falls = np.concatenate([np.arange(500), np.arange(500)[::-1], np.full(3, 0)])
    exponents = 2.0 * falls
    ratios = 10.0 ** np.diff(exponents)
    rows = np.ones((3, len(ratios)))
    rows[1] = np.sqrt(ratios)
    *_, centre = state_loops.topology(rows, 1, 1, 0.5)
    weights = 10.0 ** (exponents - exponents.max())
    assert centre == pytest.approx(np.arange(len(weights)) @ weights / weights.sum(), rel=1e-9)


def test_results_are_the_same_without_a_compiler(capsys):
    plain = subprocess.run(
        [sys.executable, analyse_record.__file__],
        env={**os.environ, 'NUMBA_DISABLE_JIT': '1'},
        check=True,
        capture_output=True,
    )
    analyse_record.main()
    compiled, plain = (json.loads(said) for said in (capsys.readouterr().out, plain.stdout))
    assert (compiled['compiled'], plain['compiled']) == (True, False)
    np.testing.assert_allclose(plain['moved'], compiled['moved'], rtol=0, atol=1e-12)
    # Fused products change sums by 1e-16; over these frames this grows to 2e-12.
    for one, other in zip(compiled['said'], plain['said'], strict=True):
        for left, right in zip(one, other, strict=True):
            if isinstance(left, float):
                assert left == pytest.approx(right, rel=1e-10, abs=1e-12, nan_ok=True)
            else:
                assert left == right
