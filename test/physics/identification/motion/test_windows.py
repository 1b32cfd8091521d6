# SPDX-License-Identifier: Apache-2.0
"""Windows hold free motion alone, and are joined where nothing comes between."""

from __future__ import annotations

import numpy as np
from passages import FLIPPER

from soliton_linkage.identification.geometry.lengths import lengths_of
from soliton_linkage.identification.motion.free_motion import FreeMotion
from soliton_linkage.identification.motion.windows import first_windows, free_spans, joined

TIMES = np.arange(1000) / 250
NOTHING = np.zeros(10)
MOTION = FreeMotion(lengths_of(FLIPPER), np.ones(9), np.ones(10), 0.0, NOTHING, NOTHING)


def test_springs_move_freely_between_pushes_once_these_have_arrived() -> None:
    first, second = free_spans(TIMES, [2.0, 1.8, 1.9])
    assert first.stop == 450
    assert TIMES[second.start] > 2.0
    assert second.stop == 1000
    assert free_spans(TIMES, []) == [slice(0, 1000)]


def test_windows_grow_until_pushes_part_them() -> None:
    slopes = np.arange(10.0)
    windows = first_windows(TIMES, TIMES[:, None] * slopes, MOTION, [2.0])
    np.testing.assert_allclose(windows[7].motion.rates, slopes, atol=1e-9)
    np.testing.assert_allclose(windows[7].motion.angles, TIMES[175] * slopes, atol=1e-9)
    covered = [frame for window in windows for frame in range(1000)[window.frames]]
    while (longer := joined(windows, lambda *_: True)) != tuple(windows):
        windows = list(longer)
    assert [frame for window in windows for frame in range(1000)[window.frames]] == covered
    assert len(windows) == 2


def test_windows_are_of_frames_that_follow_each_other_where_rest_was_left_out() -> None:
    some = np.concatenate([np.arange(0, 40_000, 20), np.arange(40_000, 40_400)])
    windows = first_windows(some / 250, np.zeros((len(some), 10)), MOTION, [])
    assert windows[0].frames.start >= 2000
    assert windows[-1].frames.stop == len(some)
    assert len(windows) > 10
    pushed = np.concatenate([some, np.arange(40_400, 40_800)])
    push = 40_100 / 250
    parts = first_windows(pushed / 250, np.zeros((len(pushed), 10)), MOTION, [push])
    assert parts[0].frames.start == 2000
    lost = np.delete(TIMES, slice(500, 503))
    windows = first_windows(lost, np.zeros((len(lost), 10)), MOTION, [])
    assert sum(window.frames.stop - window.frames.start for window in windows) == len(lost)
