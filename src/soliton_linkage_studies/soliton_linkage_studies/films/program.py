# SPDX-License-Identifier: Apache-2.0
"""Make films of chain motions, as in the movies of the paper: MP4, or GIF if PyAV is missing."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.animation import PillowWriter

from soliton_linkage.vision.opencv import Picture, pyav
from soliton_linkage.vision.video import TimedPicture, write_video
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


MP4, GIF = '.mp4', '.gif'
"""Suffixes of the film files."""
_QUALITY = 20
"""Constant rate factor of the H.264 encoder [1], at which compression errors are invisible."""
SHRINKING = 2
"""Factor by which the width and height of a GIF are divided [1]; a larger GIF would not fit in
memory."""


def file_kind() -> tuple[str, str]:
    """Return the suffix of the films (MP4 if PyAV is installed) and a description of the files."""
    try:
        pyav()
    except ValueError as error:
        return GIF, f'GIF of half the size, because MP4 {error}'
    return MP4, 'MP4 (H.264)'


def write_film(scene: Scene, frame_rate: float, path: Path) -> None:
    """Write every frame of a scene to a file; the suffix of the path selects MP4 or GIF."""
    frames = range(len(scene.times))
    if path.suffix == MP4:
        pictures = (TimedPicture(frame / frame_rate, _pixels(scene, frame)) for frame in frames)
        write_video(path, pictures, _QUALITY, rate=frame_rate)
        return
    rate: Any = frame_rate  # matplotlib accepts any number, although its annotation is int
    writer = PillowWriter(rate)
    with writer.saving(scene.figure, str(path), scene.figure.get_dpi()):
        for frame in frames:
            scene.show(frame)
            writer.grab_frame()


def _pixels(scene: Scene, frame: int) -> Picture:
    return np.ascontiguousarray(np.asarray(scene.paint(frame))[..., 2::-1])


def make_films(
    films: Sequence[Film], output: Path, suffix: str, workers: int | None = None
) -> None:
    """Write films into a folder with `workers` processes, by default one per core.

    The suffix of the files is `MP4` or `GIF`. A film appears in the folder when it is finished. On
    failure, unfinished films are deleted.
    """
    output.mkdir(parents=True, exist_ok=True)
    longest_first = sorted(films, key=lambda film: -film.shape.frames)
    folder: Any = {'prefix': '.unfinished-', 'dir': output, 'ignore_cleanup_errors': True}
    with tempfile.TemporaryDirectory(**folder) as name:
        scratch = Path(name)
        tasks = {
            each.name: partial(_make, each, scratch, output, suffix) for each in longest_first
        }
        run_parallel('filming', tasks, workers or os.cpu_count() or 1)


def _make(film: Film, scratch: Path, output: Path, suffix: str) -> None:
    name = film.name + suffix
    with mpl.rc_context(STYLE):
        scene = scene_of(film)
        write_film(scene, film.shape.frame_rate, scratch / name)
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
    suffix, described = file_kind()
    if suffix == GIF:
        half = 2 * SHRINKING  # width and height stay even
        films = [
            resized(film, film.shape.width // half * 2, film.shape.height // half * 2)
            for film in films
        ]
    print(f'{len(films)} films as {described}', file=sys.stderr)
    make_films(films, options.output, suffix, options.workers)
    return f'{len(films)} films are in {options.output}'


_QUICK = '{} frames of {} x {} pixels a film'.format(_QUICK_FRAMES, *_QUICK_SIZE)
main = study_command(_filmed, 'finished films are kept', 'films', __doc__, _QUICK, selective=True)
