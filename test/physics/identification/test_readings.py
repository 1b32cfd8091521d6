# SPDX-License-Identifier: Apache-2.0
"""Rounding noise, repeated readings, and the selection of informative frames."""

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


def test_repeat_counts_are_lengths_of_runs():
    rests = np.array([[1.0, 1.0, np.nan, 1.0, 2.0, 1.0, 1.0], np.arange(7.0)]).T
    expected = np.array([[3.0, 3.0, 1.0, 3.0, 1.0, 2.0, 2.0], np.ones(7)]).T
    np.testing.assert_array_equal(repeat_counts(rests), expected)
    assert rounding_noise(rests) == 1 / np.sqrt(12)
    assert rounding_noise(np.ones((3, 2))) == 0


def test_repeated_frames_have_the_information_of_one():
    chain = unequal(FLIPPER, 5)
    lengths, angles = chain_lengths(chain), passage(chain, 20)
    repeated = np.repeat(angles, 7, axis=0)
    once, often = (Bundle(lengths, each, None, repeat_counts(each)) for each in (angles, repeated))
    matrix = once.normal_equations().matrix
    np.testing.assert_allclose(often.normal_equations().matrix, matrix, atol=1e-9)
    assert often.conditions == pytest.approx(once.conditions)


def test_stated_deviations_are_correct_for_rounded_readings_of_rotors_at_rest():
    """Without repeat counts errors are 5 stated deviations."""
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


def test_frames_with_a_moving_wall_or_near_an_impulse_are_kept():
    impulse = 300
    for wrapped in (READINGS, np.where(READINGS > 1, READINGS - 2 * np.pi, READINGS)):
        kept = informative_frames(TIMES, wrapped, [PERIOD * impulse], 900)
        assert 800 < len(kept) <= 900
        assert set(range(impulse - 100, impulse + 100)) <= set(kept.tolist())
        assert np.sum((kept >= PASSING.start) & (kept < PASSING.stop)) > 350
        assert np.diff(kept).max() < 15


def test_repeated_selection_keeps_a_uniform_density():
    early = informative_frames(TIMES[:1200], READINGS[:1200], [], 200)
    kept = np.concatenate([early, np.arange(1200, len(TIMES))])
    times = TIMES[kept][informative_frames(TIMES[kept], READINGS[kept], [], 250)]
    halves = [np.sum((times > begin) & (times < begin + 0.7)) for begin in (4.05, 4.85)]
    assert halves[0] == pytest.approx(halves[1], rel=0.2)


def test_few_frames_are_all_kept_and_many_impulses_leave_room_for_others():
    assert len(informative_frames(TIMES, READINGS, [], len(TIMES))) == len(TIMES)
    kept = informative_frames(TIMES, READINGS, TIMES[200:].tolist(), 600)
    assert np.sum(kept < 450) < 400
    assert len(kept) <= 600
    assert kept[-1] > len(TIMES) - 100


def test_a_long_rest_takes_a_small_part_of_the_selection():
    rest = 20_000
    times = PERIOD * np.arange(rest + len(TIMES))
    readings = np.vstack([np.repeat(READINGS[:1], rest, axis=0), READINGS])
    kept = informative_frames(times, readings, [], 300)
    passing = np.sum((kept >= rest + PASSING.start) & (kept < rest + PASSING.stop))
    assert passing > 0.85 * len(kept)
    assert len(kept) > 280
