# SPDX-License-Identifier: Apache-2.0
"""Dots whose pixels are those of the picture before, and jumps of those that were."""

from __future__ import annotations

import numpy as np

from soliton_linkage.vision.repeats import Repeats

PLACES = np.array([[3.0, 10.0], [20.0, 10.0], [np.nan, np.nan]])


def test_dots_are_repeated_where_no_pixel_near_them_differs() -> None:
    repeats = Repeats(3)
    picture = np.random.default_rng(1).integers(0, 256, (20, 40), dtype=np.uint8)
    assert not repeats.look(picture, PLACES, 4.0).any()
    changed = picture.copy()
    changed[10, 10] += 1
    changed[7, 22] += 1
    assert repeats.look(changed, PLACES, 4.0).tolist() == [True, False, False]
    changed[8, 3] += 1
    assert repeats.look(changed, PLACES, 4.0).tolist() == [False, True, False]


def test_a_dot_that_is_seen_anew_jumps_by_what_it_went_meanwhile() -> None:
    repeats = Repeats(2)
    new, old = np.array([False, False]), np.array([True, False])
    for angle, repeated in ((0.1, new), (0.1, old), (0.1, old)):
        jumps, _ = repeats.jumps(np.array([angle, 0.5]), repeated)
        assert np.isnan(jumps).all()
    jumps, runs = repeats.jumps(np.array([0.13, 0.6]), new)
    np.testing.assert_allclose(jumps, [0.03, np.nan])
    assert runs.tolist() == [2.0, 0.0]
