# SPDX-License-Identifier: Apache-2.0
"""Pictures of films and of cameras of this machine, each with its time.

The times are those of the file, so that films with a variable rate keep theirs. PyAV reads films;
without it OpenCV does.
"""

from __future__ import annotations

import datetime
import time
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from soliton_linkage.vision.opencv import Picture, opencv, pyav, pyav_for_writing

_TICKS = 90_000
"""Time base of films that are written [Hz]: that of video since MPEG."""
_SILENT = 0
"""Log level at which OpenCV logs nothing [1]."""
_GAP = 1.6
"""Interval between pictures, over the usual one, beyond which some are missing [1]."""
_REMEMBERED = 31
"""Pictures whose intervals define the usual one [1]."""
_USUAL = 75
"""Percentile of these that is the usual one: rates of phones change from picture to picture."""


class TimedPicture(NamedTuple):
    """A picture and its time."""

    time: float
    """Time since the first picture [s]."""
    picture: Picture


class Video(NamedTuple):
    """A film."""

    start: float
    """Time of the first picture since the epoch [s]."""
    frames: int
    """Approximate number of pictures, 0 if it is unknown."""
    pictures: Iterator[TimedPicture]


class GapCounter:
    """Counter of missing pictures."""

    def __init__(self) -> None:
        self.missing = 0
        """Number of missing pictures."""
        self._last: float | None = None
        self._periods: list[float] = []

    def add(self, taken: float) -> int:
        """Return how many pictures are missing before one at a time [s]."""
        period = 0.0 if self._last is None else taken - self._last
        self._last = taken
        if period <= 0:
            return 0
        usual = float(np.percentile(self._periods, _USUAL)) if len(self._periods) > 2 else period
        self._periods = [*self._periods, period][-_REMEMBERED:]
        lost = round(period / usual) - 1 if period > _GAP * usual else 0
        self.missing += lost
        return lost


def read_video(path: Path) -> Video:
    """Return the pictures of a film; ValueError or OSError if it cannot be read."""
    if not path.is_file():
        raise ValueError(f'film {str(path)!r} is not there')
    av = pyav()
    return _read_by_opencv(path) if av is None else _read_by_av(av, path)


def capture_camera(number: int) -> Iterator[TimedPicture]:
    """Yield the pictures of a camera of this machine; ValueError if it delivers none."""
    begun = None
    for picture in _captured(_opened_camera(number)):
        now = time.monotonic()
        begun = now if begun is None else begun
        yield TimedPicture(now - begun, picture)
    raise ValueError(
        f'camera {number} gives no picture; see that it is plugged in, and that no other program '
        'has it'
    )


def write_video(
    path: Path, pictures: Iterable[TimedPicture], quality: int = 18, alone: bool = False
) -> int:
    """Write pictures with their times as H.264; return their number. Lower qualities are better.

    Pictures that are stored `alone`, not as changes, take more bytes and keep all small motions.
    """
    av: Any = pyav_for_writing()
    count = 0
    with av.open(str(path), 'w') as container:
        stream = container.add_stream('libx264', rate=Fraction(60))
        stream.options = {'crf': str(quality), 'preset': 'veryfast'}
        if alone:
            stream.gop_size = 1
        stream.pix_fmt = 'yuv420p'
        stream.codec_context.time_base = Fraction(1, _TICKS)
        for taken in pictures:
            if not count:
                stream.height, stream.width = taken.picture.shape[:2]
            frame = av.VideoFrame.from_ndarray(taken.picture, format='bgr24')
            frame.pts, frame.time_base = round(taken.time * _TICKS), Fraction(1, _TICKS)
            container.mux(stream.encode(frame))
            count += 1
        container.mux(stream.encode())
    return count


def _read_by_av(av: Any, path: Path) -> Video:
    try:
        container = av.open(str(path))
        stream = container.streams.video[0]
    except (av.error.FFmpegError, IndexError) as error:
        reason = getattr(error, 'strerror', None) or 'there are no pictures in it'
        raise ValueError(
            f'film {str(path)!r} cannot be read ({reason}); give one such as an MP4 or a MOV'
        ) from error

    def pictures() -> Iterator[TimedPicture]:
        first, taken = None, 0.0
        with container:
            try:
                for frame in container.decode(stream):
                    if frame.pts is None:
                        continue
                    taken = float(frame.pts * frame.time_base)
                    first = taken if first is None else first
                    yield TimedPicture(taken - first, frame.to_ndarray(format='bgr24'))
            except av.error.FFmpegError as error:
                raise ValueError(
                    f'film {str(path)!r} is damaged after {taken - (first or 0.0):.2f} s '
                    f'({error.strerror}); cut it there, or copy it anew'
                ) from error

    told = container.metadata.get('creation_time', '')
    length = float(container.duration or 0) / av.time_base
    return Video(_start(path, told, length), int(stream.frames), pictures())


def _read_by_opencv(path: Path) -> Video:
    cv2 = opencv()
    source = cv2.VideoCapture(str(path))
    if not source.isOpened():
        raise ValueError(
            f'film {str(path)!r} cannot be read; install PyAV, which reads more kinds'
        )
    frames = max(int(source.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
    rate = float(source.get(cv2.CAP_PROP_FPS)) or 30.0

    def pictures() -> Iterator[TimedPicture]:
        first = None
        for picture in _captured(source):
            taken = float(source.get(cv2.CAP_PROP_POS_MSEC)) / 1000
            first = taken if first is None else first
            yield TimedPicture(taken - first, picture)

    return Video(_start(path, '', frames / rate), frames, pictures())


def _opened_camera(number: int) -> Any:
    """Return a source of OpenCV, which logs nothing if there is no camera."""
    cv2 = opencv()
    log = cv2 if hasattr(cv2, 'setLogLevel') else cv2.utils.logging
    before = log.getLogLevel()
    log.setLogLevel(_SILENT)
    try:
        return cv2.VideoCapture(number)
    finally:
        log.setLogLevel(before)


def _captured(source: Any) -> Iterator[Picture]:
    """Yield the pictures of a source of OpenCV until it has no more."""
    try:
        while True:
            good, picture = source.read()
            if not good:
                return
            yield np.asarray(picture)
    finally:
        source.release()


def _start(path: Path, told: str, length: float) -> float:
    """Return the start of a film [s], by its metadata or else by the time of its file."""
    try:
        begun = datetime.datetime.fromisoformat(told.replace('Z', '+00:00'))
        return begun.timestamp()
    except ValueError:
        return path.stat().st_mtime - length
