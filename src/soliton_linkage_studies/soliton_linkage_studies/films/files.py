# SPDX-License-Identifier: Apache-2.0
"""Film files: MP4 if an ffmpeg with H.264 is available, otherwise GIF."""

from __future__ import annotations

import importlib
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.animation import FFMpegWriter, PillowWriter

from soliton_linkage_studies.films.scenes import Scene

_CODEC = 'libx264'
_QUALITY = ('-crf', '20', '-preset', 'veryfast', '-movflags', '+faststart')
SHRINKING = 2
"""Size reduction of a GIF [1], because all its frames stay in memory until the end."""


@dataclass(frozen=True)
class FileKind:
    """File format of the films, and the reason for it."""

    ffmpeg: str
    """Path of the program; empty for a GIF, which Pillow writes."""
    reason: str
    """One line for the user."""

    @property
    def suffix(self) -> str:
        """Suffix of the file names."""
        return '.mp4' if self.ffmpeg else '.gif'


def file_kind() -> FileKind:
    """Return MP4 if the command ffmpeg or the package imageio_ffmpeg can write H.264, else GIF."""
    complaints = []
    programs = {'command ffmpeg': shutil.which('ffmpeg'), 'package imageio_ffmpeg': _packaged()}
    for name, program in programs.items():
        if program is None:
            complaints.append(f'no {name}')
        elif not _writes_h264(program):
            complaints.append(f'no {_CODEC} in {program}')
        else:
            return FileKind(program, f'MP4 (H.264), written with {program}')
    return FileKind(
        '',
        f'GIF of half the size, because there is {" and ".join(complaints)}; install ffmpeg for '
        'MP4',
    )


def write_film(
    scene: Scene, frame_rate: float, path: Path, kind: FileKind, on_frame: Callable[[], None]
) -> None:
    """Write every frame of a scene to a file, and call `on_frame` after each."""
    rate: Any = frame_rate  # annotated as int in matplotlib, which takes any number
    options = ['-pix_fmt', 'yuv420p', *_QUALITY]
    writer = (
        _Painter(rate, codec=_CODEC, extra_args=options) if kind.ffmpeg else PillowWriter(rate)
    )
    settings: Any = {'animation.ffmpeg_path': kind.ffmpeg or 'ffmpeg'}
    with (
        mpl.rc_context(settings),
        writer.saving(scene.figure, str(path), scene.figure.get_dpi()),
    ):
        for frame in range(len(scene.times)):
            if isinstance(writer, _Painter):
                writer.write(scene.paint(frame))
            else:
                scene.show(frame)
                writer.grab_frame()
            on_frame()


class _Painter(FFMpegWriter):
    """FFmpeg writer of rendered pixels; `grab_frame` would redraw the static artists."""

    def write(self, pixels: memoryview) -> None:
        """Write one frame, RGBA."""
        process: Any = vars(self)['_proc']
        process.stdin.write(pixels)


def _packaged() -> str | None:
    """Return the path of the ffmpeg in imageio_ffmpeg, or None if it is not installed."""
    try:
        package: Any = importlib.import_module('imageio_ffmpeg')
        return str(package.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return None


def _writes_h264(program: str) -> bool:
    try:
        listed = subprocess.run(
            [program, '-hide_banner', '-encoders'],
            capture_output=True,
            check=True,
            text=True,
            timeout=30,
        )
    except (OSError, subprocess.SubprocessError):
        return False
    return _CODEC in listed.stdout
