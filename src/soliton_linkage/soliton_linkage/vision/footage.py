# SPDX-License-Identifier: Apache-2.0
"""Pictures of films and of cameras on this machine, each with the time at which it was taken.

The times of a file are its own, so that pictures of phones, which come at no fixed rate, keep
theirs. PyAV reads them; without it OpenCV does.
"""

from __future__ import annotations

import datetime
import time
from collections.abc import Iterable, Iterator
from contextlib import closing
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from soliton_linkage.vision.opencv import Picture, opencv, pyav, pyav_to_write

_TICKS = 90_000
"""In which files tell times [Hz]: those of video since MPEG."""
_SILENT = 0
"""Level at which OpenCV logs nothing [1]."""
_GAP = 1.6
"""Time from a picture to the next, over the usual one, beyond which some are missing [1]."""
_REMEMBERED = 31
"""Pictures whose distances in time tell the usual one [1]."""
_USUAL = 75
"""Percentile of these that is the usual one: rates of phones change from picture to picture."""


class Shot(NamedTuple):
    """A picture and when it was begun."""

    time: float
    """Since the first one [s]."""
    picture: Picture
    """Blue, green and red, shape (height, width, 3)."""


class Footage(NamedTuple):
    """A film as a file tells of it."""

    start: float
    """When its first picture was taken, since the epoch [s]."""
    frames: int
    """About how many pictures it has, 0 where that is not told."""
    pictures: Iterator[Shot]
    """In the order of their times."""


class GapWatch:
    """Counts the pictures that are missing between others."""

    def __init__(self) -> None:
        """Have seen none."""
        self.missing = 0
        """Pictures that are missing."""
        self._last: float | None = None
        self._periods: list[float] = []

    def look(self, taken: float) -> int:
        """Take the time of a picture [s]; return how many are missing before it."""
        period = 0.0 if self._last is None else taken - self._last
        self._last = taken
        if period <= 0:
            return 0
        usual = float(np.percentile(self._periods, _USUAL)) if len(self._periods) > 2 else period
        self._periods = [*self._periods, period][-_REMEMBERED:]
        lost = round(period / usual) - 1 if period > _GAP * usual else 0
        self.missing += lost
        return lost


def read_film(path: Path) -> Footage:
    """Pictures of a film; raises ValueError or OSError where it is none."""
    if not path.is_file():
        raise ValueError(f'film {str(path)!r} is not there')
    av = pyav()
    return _read_by_opencv(path) if av is None else _read_by_av(av, path)


def camera_pictures(number: int) -> Iterator[Shot]:
    """Pictures of a camera of this machine as it takes them, since the first one."""
    with closing(_Capture(_opened_camera(number))) as capture:
        begun = None
        while True:
            picture = capture.read()
            now = time.monotonic()
            if picture is None:
                raise ValueError(
                    f'camera {number} gives no picture; see that it is plugged in, and that no '
                    'other program has it'
                )
            begun = now if begun is None else begun
            yield Shot(now - begun, picture)


def write_film(
    path: Path, pictures: Iterable[Shot], quality: int = 18, alone: bool = False
) -> int:
    """Write pictures with their times as H.264; return how many. Lower qualities are better.

    Pictures that are kept `alone`, not by what has changed since the last, take more bytes and
    keep the smallest motions.
    """
    av: Any = pyav_to_write()
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


def _read_by_av(av: Any, path: Path) -> Footage:
    try:
        container = av.open(str(path))
        stream = container.streams.video[0]
    except (av.error.FFmpegError, IndexError) as error:
        reason = getattr(error, 'strerror', None) or 'there are no pictures in it'
        raise ValueError(
            f'film {str(path)!r} cannot be read ({reason}); give one such as an MP4 or a MOV'
        ) from error

    def pictures() -> Iterator[Shot]:
        first, taken = None, 0.0
        with container:
            try:
                for frame in container.decode(stream):
                    if frame.pts is None:
                        continue
                    taken = float(frame.pts * frame.time_base)
                    first = taken if first is None else first
                    yield Shot(taken - first, frame.to_ndarray(format='bgr24'))
            except av.error.FFmpegError as error:
                raise ValueError(
                    f'film {str(path)!r} is damaged after {taken - (first or 0.0):.2f} s '
                    f'({error.strerror}); cut it there, or copy it anew'
                ) from error

    told = container.metadata.get('creation_time', '')
    length = float(container.duration or 0) / av.time_base
    return Footage(_start(path, told, length), int(stream.frames), pictures())


def _read_by_opencv(path: Path) -> Footage:
    cv2 = opencv()
    source = cv2.VideoCapture(str(path))
    if not source.isOpened():
        raise ValueError(
            f'film {str(path)!r} cannot be read; install PyAV, which reads more kinds'
        )
    frames = max(int(source.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
    rate = float(source.get(cv2.CAP_PROP_FPS)) or 30.0

    def pictures() -> Iterator[Shot]:
        with closing(_Capture(source)) as capture:
            first = None
            while True:
                picture = capture.read()
                if picture is None:
                    return
                taken = float(source.get(cv2.CAP_PROP_POS_MSEC)) / 1000
                first = taken if first is None else first
                yield Shot(taken - first, picture)

    return Footage(_start(path, '', frames / rate), frames, pictures())


def _opened_camera(number: int) -> Any:
    """Capture of OpenCV, which here writes no lines of its own where there is no camera."""
    cv2 = opencv()
    log = cv2 if hasattr(cv2, 'setLogLevel') else cv2.utils.logging
    before = log.getLogLevel()
    log.setLogLevel(_SILENT)
    try:
        return cv2.VideoCapture(number)
    finally:
        log.setLogLevel(before)


class _Capture:
    def __init__(self, source: Any) -> None:
        self._source = source

    def read(self) -> Picture | None:
        good, picture = self._source.read()
        return np.asarray(picture) if good else None

    def close(self) -> None:
        self._source.release()


def _start(path: Path, told: str, length: float) -> float:
    """When a film was begun, by what it tells or else by its file, which ended with it [s]."""
    try:
        begun = datetime.datetime.fromisoformat(told.replace('Z', '+00:00'))
        return begun.timestamp()
    except ValueError:
        return path.stat().st_mtime - length
