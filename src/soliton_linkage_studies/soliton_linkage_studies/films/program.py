# SPDX-License-Identifier: Apache-2.0
"""Make films of chain motions, as in the movies of the paper: MP4, or GIF without ffmpeg."""

from __future__ import annotations

import argparse
import importlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.animation import FFMpegWriter, PillowWriter

from soliton_linkage_studies.figure_report import save_caption
from soliton_linkage_studies.films.scenes import FILM_KINDS, STYLE, Format, Scene
from soliton_linkage_studies.program import (
    import_modules,
    run_parallel,
    select_names,
    study_command,
)
from soliton_linkage_studies.settings import Section, load_settings

import_modules('soliton_linkage_studies.films')


@dataclass(frozen=True)
class Film:
    """Motion and format of one film."""

    name: str
    kind: str
    scene: type[Scene]
    title: str
    motion: Any
    """Settings of the motion; the type depends on the kind of film."""
    shape: Format


def read_films(settings: Section) -> list[Film]:
    """Return the films of a settings file. Raises ValueError for invalid settings."""
    settings.check_keys('frame_rate', 'size', 'films')
    frame_rate = settings.number('frame_rate', 1.0, 120.0)
    size = settings.numbers('size', 64, 8192)
    if len(size) != 2 or any(pixels % 2 for pixels in size):
        raise settings.error('size', 'must be two even numbers of pixels, for example [1280, 720]')
    width, height = (int(pixels) for pixels in size)
    films = []
    for name, section in settings.sections('films').items():
        kind = section.text('kind', tuple(sorted(FILM_KINDS)))
        frames = max(round(frame_rate * section.number('playing_time', 0.1, 3600.0)), 2)
        of_motion = {
            key: section.values[key]
            for key in section.values
            if key not in ('kind', 'title', 'playing_time')
        }
        scene = FILM_KINDS[kind]
        motion = scene.settings.read(replace(section, values=of_motion))
        shape = Format(frames, frame_rate, width, height)
        films.append(Film(name, kind, scene, section.text('title'), motion, shape))
    return films


def resized(film: Film, width: int, height: int, most_frames: int | None = None) -> Film:
    """Return a film with another frame size [pixels] and at most `most_frames` frames."""
    frames = min(film.shape.frames, most_frames or film.shape.frames)
    return replace(film, shape=replace(film.shape, frames=frames, width=width, height=height))


def scene_of(film: Film) -> Scene:
    """Simulate the motion of a film and draw its first frame."""
    make: Any = film.scene
    made: Scene = make(film.title, film.motion, film.shape)
    return made


_CODEC = 'libx264'
_QUALITY = ('-crf', '20', '-preset', 'veryfast', '-movflags', '+faststart')
SHRINKING = 2
"""Factor by which the width and height of a GIF are divided [1]; a larger GIF would not fit in
memory."""


@dataclass(frozen=True)
class FileKind:
    """File format of the films, and the reason for it."""

    ffmpeg: str
    """Path of the program ffmpeg; if it is empty, Pillow writes a GIF."""
    reason: str
    """Reason for the format, in one line for the user."""

    @property
    def suffix(self) -> str:
        """Suffix of the file names."""
        return '.mp4' if self.ffmpeg else '.gif'


def file_kind() -> FileKind:
    """Return MP4 if an ffmpeg program that writes H.264 is found, otherwise GIF.

    The program is the command ffmpeg, or the one in the package imageio_ffmpeg.
    """
    complaints = []
    programs = {'command ffmpeg': shutil.which('ffmpeg'), 'package imageio_ffmpeg': None}
    with suppress(ImportError, RuntimeError):
        package: Any = importlib.import_module('imageio_ffmpeg')
        programs['package imageio_ffmpeg'] = str(package.get_ffmpeg_exe())
    for name, program in programs.items():
        if program is None:
            complaints.append(f'no {name}')
        elif not _writes_h264(program):
            complaints.append(f'no {_CODEC} in {program}')
        else:
            return FileKind(program, f'MP4 (H.264), written with {program}')
    reasons = ' and '.join(complaints)
    text = f'GIF of half the size, because there is {reasons}; install ffmpeg for MP4'
    return FileKind('', text)


def write_film(scene: Scene, frame_rate: float, path: Path, kind: FileKind) -> None:
    """Write every frame of a scene to a file."""
    rate: Any = frame_rate  # matplotlib accepts any number, although its annotation is int
    writer: Any = PillowWriter(rate)
    if kind.ffmpeg:
        writer = _Painter(rate, codec=_CODEC, extra_args=['-pix_fmt', 'yuv420p', *_QUALITY])
    settings: Any = {'animation.ffmpeg_path': kind.ffmpeg or 'ffmpeg'}
    with mpl.rc_context(settings), writer.saving(scene.figure, str(path), scene.figure.get_dpi()):
        for frame in range(len(scene.times)):
            if kind.ffmpeg:
                writer.write(scene.paint(frame))
            else:
                scene.show(frame)
                writer.grab_frame()


class _Painter(FFMpegWriter):
    """FFmpeg writer that takes rendered pixels; `grab_frame` would draw all artists again."""

    def write(self, pixels: memoryview) -> None:
        process: Any = vars(self)['_proc']
        process.stdin.write(pixels)


def _writes_h264(program: str) -> bool:
    command = [program, '-hide_banner', '-encoders']
    try:
        listed = subprocess.run(command, capture_output=True, check=True, text=True, timeout=30)
    except (OSError, subprocess.SubprocessError):
        return False
    return _CODEC in listed.stdout


def make_films(
    films: Sequence[Film], output: Path, kind: FileKind, workers: int | None = None
) -> None:
    """Write films into a folder with `workers` processes, by default one per core.

    A film appears in the folder when it is finished. On failure, unfinished films are deleted.
    """
    output.mkdir(parents=True, exist_ok=True)
    longest_first = sorted(films, key=lambda film: -film.shape.frames)
    folder: Any = {'prefix': '.unfinished-', 'dir': output, 'ignore_cleanup_errors': True}
    with tempfile.TemporaryDirectory(**folder) as name:
        scratch = Path(name)
        tasks = {each.name: partial(_make, each, scratch, output, kind) for each in longest_first}
        run_parallel('filming', tasks, workers or os.cpu_count() or 1)


def _make(film: Film, scratch: Path, output: Path, kind: FileKind) -> None:
    name = film.name + kind.suffix
    with mpl.rc_context(STYLE):
        scene = scene_of(film)
        write_film(scene, film.shape.frame_rate, scratch / name, kind)
    save_caption(f'{scene.headline}\n\n{scene.caption}', output / f'{film.name}.txt')
    (scratch / name).replace(output / name)


_QUICK_FRAMES = 4
"""Number of frames of a film with the option `--quick`."""
_QUICK_SIZE = (320, 180)
"""Frame width and height of a film with the option `--quick` [pixels]."""


def _filmed(options: argparse.Namespace) -> str:
    films = read_films(load_settings(options.config))
    names = select_names([film.name for film in films], options.only)
    films = [film for film in films if film.name in names]
    if options.quick:
        films = [resized(film, *_QUICK_SIZE, _QUICK_FRAMES) for film in films]
    kind = file_kind()
    if not kind.ffmpeg:
        half = 2 * SHRINKING  # width and height stay even
        films = [
            resized(film, film.shape.width // half * 2, film.shape.height // half * 2)
            for film in films
        ]
    print(f'{len(films)} films as {kind.reason}', file=sys.stderr)
    make_films(films, options.output, kind, options.workers)
    return f'{len(films)} films are in {options.output}'


_QUICK = '{} frames of {} x {} pixels a film'.format(_QUICK_FRAMES, *_QUICK_SIZE)
main = study_command(_filmed, 'finished films are kept', 'films', __doc__, _QUICK, selective=True)
