# SPDX-License-Identifier: Apache-2.0
"""Files of films: MP4 where there is an ffmpeg that can write it, GIF where there is none."""

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
"""How many times smaller a GIF is, each frame of which stays in memory until the end."""


@dataclass(frozen=True)
class FileKind:
    """What films are written as, and why."""

    ffmpeg: str
    """Path of the program; empty for a GIF, which Pillow writes."""
    reason: str
    """One line for people."""

    @property
    def suffix(self) -> str:
        """Of the names of the files."""
        return '.mp4' if self.ffmpeg else '.gif'


def file_kind() -> FileKind:
    """Choose MP4 with the command ffmpeg or else that of the package imageio_ffmpeg, or GIF."""
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
    """Write every frame of a scene to a file, and tell after each."""
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
    """Takes finished pixels; `grab_frame` would draw everything anew, which never moves."""

    def write(self, pixels: memoryview) -> None:
        """Write one frame, RGBA."""
        process: Any = vars(self)['_proc']
        process.stdin.write(pixels)


def _packaged() -> str | None:
    """Path of the ffmpeg in the package imageio_ffmpeg, if it is here and has one."""
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
