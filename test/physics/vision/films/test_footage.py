# SPDX-License-Identifier: Apache-2.0
"""Pictures that are missing in a film, and films that are none."""

from __future__ import annotations

from pathlib import Path

import pytest

from soliton_linkage.vision.films.footage import GapWatch, read_film


def test_pictures_that_did_not_come_are_counted() -> None:
    watch = GapWatch()
    times = [frame / 60 for frame in range(100) if frame not in (40, 41, 70)]
    assert [lost for time in times if (lost := watch.look(time))] == [2, 1]
    assert watch.missing == 3


def test_a_rate_that_varies_is_no_gap() -> None:
    watch = GapWatch()
    for frame in range(100):
        watch.look(frame / 30 + 0.008 * (frame % 2))
    assert not watch.missing


def test_a_film_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match='is not there'):
        read_film(tmp_path / 'none.mp4')
