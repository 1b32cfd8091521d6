# SPDX-License-Identifier: Apache-2.0
"""Dots whose pixels are those of the picture before."""

from __future__ import annotations

import numpy as np

from soliton_linkage.vision.errors.repeats import Repeats

PLACES = np.array([[3.0, 10.0], [20.0, 10.0], [np.nan, np.nan]])


def test_dots_are_repeated_where_no_pixel_near_them_differs() -> None:
    repeats = Repeats()
    picture = np.random.default_rng(1).integers(0, 256, (20, 40), dtype=np.uint8)
    assert not repeats.look(picture, PLACES, 4.0).any()
    changed = picture.copy()
    changed[10, 10] += 1
    changed[7, 22] += 1
    assert repeats.look(changed, PLACES, 4.0).tolist() == [True, False, False]
    changed[8, 3] += 1
    assert repeats.look(changed, PLACES, 4.0).tolist() == [False, True, False]
