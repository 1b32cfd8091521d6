# SPDX-License-Identifier: Apache-2.0
"""Rounding is noise of a known size, and frames that are informative stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, passage, read, unequal

from soliton_linkage.identification.adjustment import adjust
from soliton_linkage.identification.bundle import Bundle
from soliton_linkage.identification.lengths import chain_lengths, initial_lengths, to_unknowns
from soliton_linkage.identification.readings import (
    informative_frames,
    repeat_counts,
    rounding_noise,
)

STEP = 2 * np.pi / 4096


def test_readings_repeat_as_long_as_they_are_the_same() -> None:
    rests = np.array([[1.0, 1.0, np.nan, 1.0, 2.0, 1.0, 1.0], np.arange(7.0)]).T
    expected = np.array([[3.0, 3.0, 1.0, 3.0, 1.0, 2.0, 2.0], np.ones(7)]).T
    np.testing.assert_array_equal(repeat_counts(rests), expected)
    assert rounding_noise(rests) == 1 / np.sqrt(12)
    assert rounding_noise(np.ones((3, 2))) == 0


def test_frames_that_repeat_tell_as_much_as_one() -> None:
    chain = unequal(FLIPPER, 5)
    lengths, angles = chain_lengths(chain), passage(chain, 20)
    repeated = np.repeat(angles, 7, axis=0)
    once, often = (Bundle(lengths, each, None, repeat_counts(each)) for each in (angles, repeated))
    matrix = once.normal_equations().matrix
    np.testing.assert_allclose(often.normal_equations().matrix, matrix, atol=1e-9)
    assert often.conditions == pytest.approx(once.conditions)


def test_what_is_stated_of_rounded_readings_is_true_however_long_rotors_rest() -> None:
    """Errors over what is stated are 5 where each reading counts as new."""
    over = []
    for seed in range(50, 58):
        chain = unequal(FLIPPER, seed)
        moving = passage(chain, 300)
        angles = np.concatenate([np.repeat(moving[:1], 600, axis=0), moving])
        readings, offsets = read(angles, seed, noise=0.0)
        rounded = STEP * np.rint(readings / STEP)
        found = adjust(rounded, initial_lengths(rounded))
        true = replace(chain_lengths(chain).scaled(1.0), offsets=offsets)
        errors = to_unknowns(found.lengths.scaled(1.0)) - to_unknowns(true)
        over.append(errors / found.deviations)
    assert np.sqrt(np.mean(np.square(over))) == pytest.approx(1.0, abs=0.2)


PERIOD = 0.004
PASSING = slice(1000, 1400)
ANGLES = np.vstack([np.tile(frame, (1000, 1)) for frame in passage(FLIPPER, 2)])
ANGLES = np.insert(ANGLES, 1000, passage(FLIPPER, 400), axis=0)
READINGS = read(ANGLES, 1)[0]
TIMES = PERIOD * np.arange(len(READINGS))


def test_frames_of_a_wall_and_near_a_push_stay_rather_than_others() -> None:
    pushed = 300
    for wrapped in (READINGS, np.where(READINGS > 1, READINGS - 2 * np.pi, READINGS)):
        stay = informative_frames(TIMES, wrapped, [PERIOD * pushed], 900)
        assert 800 < len(stay) <= 900
        assert set(range(pushed - 100, pushed + 100)) <= set(stay.tolist())
        assert np.sum((stay >= PASSING.start) & (stay < PASSING.stop)) > 350
        assert np.diff(stay).max() < 15


def test_frames_are_as_dense_in_time_whenever_they_are_thinned_out() -> None:
    early = informative_frames(TIMES[:1200], READINGS[:1200], [], 200)
    stay = np.concatenate([early, np.arange(1200, len(TIMES))])
    times = TIMES[stay][informative_frames(TIMES[stay], READINGS[stay], [], 250)]
    halves = [np.sum((times > begin) & (times < begin + 0.7)) for begin in (4.05, 4.85)]
    assert halves[0] == pytest.approx(halves[1], rel=0.2)


def test_all_stay_where_they_are_few_and_pushes_without_end_leave_room() -> None:
    assert len(informative_frames(TIMES, READINGS, [], len(TIMES))) == len(TIMES)
    stay = informative_frames(TIMES, READINGS, TIMES[200:].tolist(), 600)
    assert np.sum(stay < 450) < 400
    assert len(stay) <= 600
    assert stay[-1] > len(TIMES) - 100
