# SPDX-License-Identifier: Apache-2.0
"""Frames near pushes stay, those in which rotors turn rather than others, no more than most."""

from __future__ import annotations

import numpy as np
import pytest
from passages import FLIPPER, passage, read

from soliton_linkage.identification.thinning import telling

PERIOD = 0.004
PASSING = slice(1000, 1400)
ANGLES = np.vstack([np.tile(frame, (1000, 1)) for frame in passage(FLIPPER, 2)])
ANGLES = np.insert(ANGLES, 1000, passage(FLIPPER, 400), axis=0)
READINGS = read(ANGLES, 1)[0]
TIMES = PERIOD * np.arange(len(READINGS))


def test_frames_of_a_wall_and_near_a_push_stay_rather_than_others() -> None:
    pushed = 300
    for wrapped in (READINGS, np.where(READINGS > 1, READINGS - 2 * np.pi, READINGS)):
        stay = telling(TIMES, wrapped, [PERIOD * pushed], 900)
        assert 800 < len(stay) <= 900
        assert set(range(pushed - 100, pushed + 100)) <= set(stay.tolist())
        assert np.sum((stay >= PASSING.start) & (stay < PASSING.stop)) > 350
        assert np.diff(stay).max() < 15


def test_frames_are_as_dense_in_time_whenever_they_are_thinned_out() -> None:
    early = telling(TIMES[:1200], READINGS[:1200], [], 200)
    stay = np.concatenate([early, np.arange(1200, len(TIMES))])
    times = TIMES[stay][telling(TIMES[stay], READINGS[stay], [], 250)]
    halves = [np.sum((times > begin) & (times < begin + 0.7)) for begin in (4.05, 4.85)]
    assert halves[0] == pytest.approx(halves[1], rel=0.2)


def test_all_stay_where_they_are_few_and_pushes_without_end_leave_room() -> None:
    assert len(telling(TIMES, READINGS, [], len(TIMES))) == len(TIMES)
    stay = telling(TIMES, READINGS, TIMES[200:].tolist(), 600)
    assert np.sum(stay < 450) < 400
    assert len(stay) <= 600
    assert stay[-1] > len(TIMES) - 100
