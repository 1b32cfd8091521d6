# SPDX-License-Identifier: Apache-2.0
"""Missing pictures are counted, and unreadable videos are reported."""

from typing import Any

import numpy as np
import pytest

from soliton_linkage.vision.video import (
    GapCounter,
    TimedPicture,
    capture_camera,
    read_video,
    write_video,
)


def test_missing_pictures_are_counted():
    counter = GapCounter()
    times = [frame / 60 for frame in range(100) if frame not in (40, 41, 70)]
    assert [lost for time in times if (lost := counter.add(time))] == [2, 1]
    assert counter.missing == 3


def test_a_varying_rate_is_not_a_gap():
    counter = GapCounter()
    for frame in range(100):
        counter.add(frame / 30 + 0.008 * (frame % 2))
    assert not counter.missing


@pytest.mark.parametrize(('content', 'message'), [(b'', 'not exist'), (b'no film', 'be read')])
def test_other_files_are_rejected(tmp_path, content, message):
    pytest.importorskip('av', reason='needs PyAV: pip install av')
    path = tmp_path / 'film.mp4'
    if content:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_video(path)


def test_a_directory_is_reported_as_one(tmp_path):
    with pytest.raises(ValueError, match='is a directory; give a file'):
        read_video(tmp_path)


@pytest.mark.parametrize('suffix', ['avi', 'mkv', 'ts'])
def test_a_film_that_was_cut_is_reported_after_its_pictures(tmp_path, suffix):
    av: Any = pytest.importorskip('av', reason='needs PyAV: pip install av')
    path, random = tmp_path / f'film.{suffix}', np.random.default_rng(1)
    with av.open(str(path), 'w') as container:
        stream = container.add_stream('mpeg4', rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, 'yuv420p'
        for _ in range(150):
            picture = random.integers(0, 256, (48, 64, 3), dtype=np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format='bgr24')
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    assert len(list(read_video(path).pictures)) == 150
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2 + 50])
    film = read_video(path).pictures
    for _ in range(30):
        next(film)
    with pytest.raises(ValueError, match=r'ends after [12]'):
        list(film)


@pytest.mark.parametrize(
    ('name', 'packet', 'reported'),
    [
        ('film.avi', 1, 'before its stated end'),
        ('film.ts', 188, 'within a picture'),
    ],
)
def test_a_film_of_the_suite_that_was_cut_is_reported(tmp_path, name, packet, reported):
    pytest.importorskip('av', reason='needs PyAV: pip install av')
    path, random = tmp_path / name, np.random.default_rng(1)
    pictures = (random.integers(0, 256, (48, 64, 3), dtype=np.uint8) for _ in range(60))
    write_video(path, (TimedPicture(n / 60, picture) for n, picture in enumerate(pictures)))
    assert len(list(read_video(path).pictures)) == 60
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // packet // 2 * packet])
    with pytest.raises(ValueError, match=reported):
        list(read_video(path).pictures)


def test_an_mp4_film_that_lost_its_index_must_be_copied_again(tmp_path):
    pytest.importorskip('av', reason='needs PyAV: pip install av')
    path, picture = tmp_path / 'film.mp4', np.zeros((48, 64, 3), dtype=np.uint8)
    write_video(path, (TimedPicture(n / 60, picture) for n in range(30)))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ValueError, match='if it was cut, copy it again'):
        read_video(path)


def test_rows_of_a_turned_film_are_rows_of_the_sensor(tmp_path):
    pytest.importorskip('av', reason='needs PyAV: pip install av')
    path, upper = tmp_path / 'film.mp4', np.zeros((48, 64, 3), dtype=np.uint8)
    upper[:24] = 255
    write_video(path, (TimedPicture(n / 30, upper) for n in range(5)))
    data = bytearray(path.read_bytes())
    matrix = data.index(b'tkhd') + 4 + 40
    turned = np.array([0, 1 << 16, 0, -1 << 16, 0, 0, 48 << 16, 0, 1 << 30], dtype='>i4')
    data[matrix : matrix + 36] = turned.tobytes()
    path.write_bytes(data)
    for taken in read_video(path).pictures:
        assert taken.picture.shape == upper.shape
        assert np.abs(taken.picture.astype(int) - upper)[[4, -4]].max() < 30


def test_an_absent_camera_is_reported_once(capfd):
    pytest.importorskip('cv2', reason='needs OpenCV: pip install opencv-python-headless')
    with pytest.raises(
        ValueError, match='camera 63 delivers no picture; check that it is connected'
    ):
        next(capture_camera(63))
    assert not capfd.readouterr().err


def test_the_error_for_a_damaged_video_states_the_time(tmp_path):
    pytest.importorskip('av', reason='needs PyAV: pip install av')
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
