# SPDX-License-Identifier: Apache-2.0
"""Pictures with times, from video files (with the times in the file) and from cameras."""

from __future__ import annotations

import datetime
import math
import time
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from soliton_linkage.vision.opencv import Picture, opencv, pyav

_TICKS = 90_000
"""Time base of written videos [Hz], as in MPEG."""
_SILENT = 0
"""Log level at which OpenCV writes no messages."""
_GAP = 1.6
"""Pictures count as missing if an interval is longer than this times the typical interval [1]."""
_MEMORY = 31
"""Number of recent intervals from which the typical interval is computed."""
_PERCENTILE = 75
"""This percentile of the recent intervals is used as the typical interval [%]."""
_CUT = 3.0
"""A video file counts as incomplete if the time from its last picture to its stated end is longer
than this times the longest interval between pictures [1]."""
_SOUND = 1.0
"""Time by which the sound of a video file may be longer than its pictures [s]. It is added to the
limit of `_CUT` if a file with sound does not state the duration of the pictures."""
_SYNC, _PACKET = b'G', 188
"""First byte and length [bytes] of each packet of an MPEG transport stream."""
_TAIL = 5000
"""Number of last packets of a transport stream in which a packet of a picture is searched [1]."""


class TimedPicture(NamedTuple):
    """Picture, and its time since the first picture [s]."""

    time: float
    picture: Picture


class Video(NamedTuple):
    """Pictures of a video file or of a camera."""

    start: float
    """Time of the first picture since the Unix epoch [s]."""
    frames: int
    """Approximate number of pictures; 0 means that the number is unknown."""
    pictures: Iterator[TimedPicture]


class GapCounter:
    """Counter of missing pictures, which cause unusually long intervals between pictures."""

    def __init__(self) -> None:
        self.missing = 0
        self._last: float | None = None
        self._periods: list[float] = []

    def add(self, taken: float) -> int:
        """Add a picture at a time [s]; return the number of missing pictures before it."""
        period = 0.0 if self._last is None else taken - self._last
        self._last = taken
        if period <= 0:
            return 0
        periods = self._periods
        usual = float(np.percentile(periods, _PERCENTILE)) if len(periods) > 2 else period
        self._periods = [*periods, period][-_MEMORY:]
        lost = round(period / usual) - 1 if period > _GAP * usual else 0
        self.missing += lost
        return lost


def read_video(path: Path) -> Video:
    """Return the pictures of a video file; raise ValueError or OSError if it is unreadable."""
    if path.is_dir():
        raise ValueError(f'film {str(path)!r} is a directory; give a file')
    if not path.is_file():
        raise ValueError(f'film {str(path)!r} does not exist; check the path')
    av: Any = pyav()
    try:
        container = av.open(str(path))
        stream = container.streams.video[0]
    except (av.error.FFmpegError, IndexError) as error:
        reason = getattr(error, 'strerror', None) or 'it contains no pictures'
        remedy = 'give a video file such as MP4 or MOV'
        with path.open('rb') as file:
            # The index of an MP4 file is usually at its end.
            if file.read(8)[4:] == b'ftyp':
                remedy = 'if it was cut, copy it again'
        raise ValueError(f'film {str(path)!r} cannot be read ({reason}); {remedy}') from error

    incomplete = False

    def pictures() -> Iterator[TimedPicture]:
        nonlocal incomplete
        first, taken = None, 0.0
        with container:
            try:
                for frame in container.decode(stream):
                    if frame.pts is None:
                        continue
                    taken = float(frame.pts * frame.time_base)
                    first = taken if first is None else first
                    incomplete = bool(frame.is_corrupt)
                    yield TimedPicture(taken - first, frame.to_ndarray(format='bgr24'))
            except av.error.FFmpegError as error:
                raise ValueError(
                    f'film {str(path)!r} is damaged after {taken - (first or 0.0):.2f} s '
                    f'({error.strerror}); cut it there, or copy it again'
                ) from error

    created = container.metadata.get('creation_time', '').replace('Z', '+00:00')
    length = float(container.duration or 0) / av.time_base
    own = float(stream.duration * stream.time_base) if stream.duration else math.nan
    # If the pictures have no stated duration, the duration of the film may be that of the sound.
    slack = _SOUND if math.isnan(own) and container.streams.audio else 0.0
    length_of_pictures = length if math.isnan(own) else own
    end = partial(_missing_end, path, stream.id)
    film = _checked(path, pictures(), length_of_pictures, slack, lambda: end(incomplete))
    try:
        start = datetime.datetime.fromisoformat(created).timestamp()
    except ValueError:
        # The file was last changed at the end of the film.
        start = path.stat().st_mtime - length
    return Video(start, int(stream.frames), film)


def capture_camera(number: int) -> Iterator[TimedPicture]:
    """Yield the pictures of a camera; raise ValueError if it delivers none."""
    cv2, start = opencv(), None
    log = cv2 if hasattr(cv2, 'setLogLevel') else cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(_SILENT)
    try:
        source = cv2.VideoCapture(number)
    finally:
        log.setLogLevel(level)
    try:
        while True:
            good, picture = source.read()
            if not good:
                raise ValueError(
                    f'camera {number} delivers no picture; check that it is connected and that no '
                    'other program uses it'
                )
            now = time.monotonic()
            start = now if start is None else start
            yield TimedPicture(now - start, np.asarray(picture))
    finally:
        source.release()


def write_video(
    path: Path,
    pictures: Iterable[TimedPicture],
    quality: int = 18,
    alone: bool = False,
    rate: float = 60.0,
) -> int:
    """Write an H.264 video; return the number of pictures.

    `quality` is the constant rate factor (CRF); a lower value gives better pictures. If `alone`,
    each picture is a key frame, so that small motions are not lost. The last picture is shown for
    1 / `rate` [s].
    """
    av: Any = pyav()
    count = 0
    with av.open(str(path), 'w') as container:
        stream = container.add_stream('libx264', rate=Fraction(rate).limit_denominator(1000))
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


def _checked(
    path: Path,
    pictures: Iterator[TimedPicture],
    length: float,
    slack: float,
    missing_end: Callable[[], str],
) -> Iterator[TimedPicture]:
    """Yield the pictures of a video file; raise ValueError if it is incomplete.

    `length` is the stated duration [s], and `slack` [s] is added to the limit of `_CUT`. For
    `missing_end`, see `_missing_end`.
    """
    last, interval = 0.0, 0.0
    for taken in pictures:
        last, interval = taken.time, max(interval, taken.time - last)
        yield taken
    stated = f' of {length:.2f} s' if length - last > _CUT * interval + slack else ''
    if stated or (stated := missing_end()):
        raise ValueError(f'film {str(path)!r} ends after {last:.2f} s{stated}; copy it again')


def _missing_end(path: Path, identifier: int, incomplete: bool) -> str:
    """Return a description of the missing end of a video file; '' if nothing is missing.

    `identifier` is the number of the pictures in a transport stream, and `incomplete` is whether
    the last picture is known to be incomplete.
    """
    size = path.stat().st_size
    with path.open('rb') as file:
        head = file.read(_PACKET + 1)
        file.seek(max(size // _PACKET - _TAIL, 0) * _PACKET)
        tail = file.read()
    # An AVI file states its size.
    if head[:4] == b'RIFF' and int.from_bytes(head[4:8], 'little') + 8 > size:
        return ', before its stated end'
    packets = head[:1] == head[_PACKET:] == _SYNC
    if incomplete or (packets and size % _PACKET):
        return ', within a picture'
    if packets:
        # The last packet of a picture has an adaptation field (0x20), because stuffing bytes fill
        # the packet. Only one picture in 184 has a suitable length without stuffing.
        for start in range(len(tail) - _PACKET, -1, -_PACKET):
            number, flags = int.from_bytes(tail[start + 1 : start + 3]) & 0x1FFF, tail[start + 3]
            if number == identifier:
                return '' if flags & 0x20 else ', within a picture if the original is larger'
    return ''
