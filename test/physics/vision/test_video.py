# SPDX-License-Identifier: Apache-2.0
"""Pictures that are missing in a film, and films that are none or damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from soliton_linkage.vision.video import (
    GapCounter,
    TimedPicture,
    capture_camera,
    read_video,
    write_video,
)


def test_pictures_that_did_not_come_are_counted() -> None:
    counter = GapCounter()
    times = [frame / 60 for frame in range(100) if frame not in (40, 41, 70)]
    assert [lost for time in times if (lost := counter.add(time))] == [2, 1]
    assert counter.missing == 3


def test_a_rate_that_varies_is_no_gap() -> None:
    counter = GapCounter()
    for frame in range(100):
        counter.add(frame / 30 + 0.008 * (frame % 2))
    assert not counter.missing


@pytest.mark.parametrize(('content', 'said'), [(b'', 'is not there'), (b'no film', 'be read')])
def test_what_is_no_film_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    pytest.importorskip('cv2', reason='cameras need OpenCV')
    path = tmp_path / 'film.mp4'
    if content:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=said):
        read_video(path)


def test_a_camera_that_is_not_there_is_said_once(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('cv2', reason='cameras need OpenCV')
    with pytest.raises(ValueError, match='camera 63 gives no picture; see that it is plugged in'):
        next(capture_camera(63))
    assert not capfd.readouterr().err


def test_a_film_that_is_damaged_says_where(tmp_path: Path) -> None:
    pytest.importorskip('av', reason='films are written with PyAV')
    path, random = tmp_path / 'film.mp4', np.random.default_rng(1)
    pictures = random.integers(0, 256, (60, 48, 64, 3), dtype=np.uint8)
    write_video(
        path, (TimedPicture(n / 60, picture) for n, picture in enumerate(pictures)), alone=True
    )
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 30_000] = bytes(30_000)
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"film\.mp4' is damaged after 0\.\d\d s"):
        list(read_video(path).pictures)
