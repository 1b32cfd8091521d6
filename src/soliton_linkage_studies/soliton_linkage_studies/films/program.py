# SPDX-License-Identifier: Apache-2.0
"""Make films of chain motions, as in the movies of the paper: MP4, or GIF without ffmpeg."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

import matplotlib as mpl

from soliton_linkage.progress import ProgressLine
from soliton_linkage_studies.figure_report import save_caption
from soliton_linkage_studies.films.files import SHRINKING, FileKind, file_kind, write_film
from soliton_linkage_studies.films.scenes import FILM_KINDS, STYLE, Format, Scene
from soliton_linkage_studies.program import run_study, select_names, study_parser
from soliton_linkage_studies.settings import Section, load_settings
from soliton_linkage_studies.workers import Processes, local_processes

_OF_FILMS = ('kind', 'title', 'playing_time')


@dataclass(frozen=True)
class Film:
    """Content and format of one film."""

    name: str
    kind: str
    make: Callable[[str, Any, Format], Scene]
    """Function that makes the scene of this kind of film."""
    title: str
    motion: Any
    """Settings of the motion, specific to the kind of film."""
    shape: Format


def read_films(settings: Section) -> list[Film]:
    """Return the films of a settings file; raise ValueError for invalid settings."""
    settings.check_keys('frame_rate', 'size', 'films')
    frame_rate = settings.number('frame_rate', 1.0, 120.0)
    size = settings.numbers('size', 64, 8192)
    if len(size) != 2 or any(pixels % 2 for pixels in size):
        raise settings.error('size', 'must be two even numbers of pixels, for example [1280, 720]')
    width, height = (int(pixels) for pixels in size)
    films = []
    for name, section in settings.section('films').sections().items():
        kind = section.text('kind', tuple(FILM_KINDS))
        frames = max(round(frame_rate * section.number('playing_time', 0.1, 3600.0)), 2)
        of_motion = {key: section.values[key] for key in section.values if key not in _OF_FILMS}
        motion = FILM_KINDS[kind].read(replace(section, values=of_motion))
        shape = Format(frames, frame_rate, width, height)
        films.append(
            Film(name, kind, FILM_KINDS[kind].scene, section.text('title'), motion, shape)
        )
    return films


def resized(film: Film, width: int, height: int, most_frames: int | None = None) -> Film:
    """Return a film of the same motion with another frame size [pixels] and fewer frames."""
    frames = min(film.shape.frames, most_frames or film.shape.frames)
    return replace(film, shape=replace(film.shape, frames=frames, width=width, height=height))


def scene_of(film: Film) -> Scene:
    """Simulate the motion of a film and draw its first frame."""
    return film.make(film.title, film.motion, film.shape)


_POLLING = 0.1
"""Interval between updates of the progress line [s]."""


def make_films(
    films: Sequence[Film], output: Path, kind: FileKind, workers: int | None = None
) -> None:
    """Write films into a folder, by `workers` processes, one per core by default.

    A film appears under its name when it is finished; unfinished files are deleted on failure.
    """
    output.mkdir(parents=True, exist_ok=True)
    total = sum(film.shape.frames for film in films)
    context = multiprocessing.get_context('spawn')
    done: Synchronized[int] = context.Value('q', 0)
    count = min(len(films), workers or os.cpu_count() or 1)
    with (
        tempfile.TemporaryDirectory(
            prefix='.unfinished-', dir=output, ignore_cleanup_errors=True
        ) as scratch,
        local_processes(count, _prepare, (done,)) as processes,
    ):
        for film in sorted(films, key=lambda film: -film.shape.frames):
            processes.submit(_make, film, Path(scratch), output, kind)
        _follow(processes, done, total)


def _follow(processes: Processes, done: Synchronized[int], total: int) -> None:
    """Show progress until all films are finished; raise the exception of a failed film."""
    started = time.monotonic()
    progress = ProgressLine('filming', total)
    films = processes.unfinished
    while processes.unfinished:
        finished = processes.next_finished(_POLLING)
        if finished:
            finished.result()
        frames = done.value
        left = (time.monotonic() - started) * (total - frames) / frames if frames else 0.0
        remark = f'{left:.0f} s left' if frames else 'simulating'
        progress.show(frames, f'{frames} of {total} frames, {remark}')
    progress.end(f'{films} films, {total} frames in {time.monotonic() - started:.0f} s')


def _prepare(done: Synchronized[int]) -> None:
    """Set up a worker that ignores SIGINT, because its parent stops it and its ffmpeg."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Done.frames = done


class _Done:
    frames: Synchronized[int]


def _count() -> None:
    with _Done.frames.get_lock():
        _Done.frames.value += 1


def _make(film: Film, scratch: Path, output: Path, kind: FileKind) -> None:
    """Write one film and its caption file, then move it into the output folder."""
    name = film.name + kind.suffix
    with mpl.rc_context(STYLE):
        scene = scene_of(film)
        write_film(scene, film.shape.frame_rate, scratch / name, kind, _count)
    save_caption(f'{scene.headline}\n\n{scene.caption}', output / f'{film.name}.txt')
    (scratch / name).replace(output / name)


_QUICK_FRAMES = 4
"""Number of frames of a quick film."""
_QUICK_SIZE = (320, 180)
"""Frame size of a quick film [pixels]."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the films of a settings file; return 1 on failure, 130 on Ctrl-C."""
    width, height = _QUICK_SIZE
    quick = f'{_QUICK_FRAMES} frames of {width} x {height} pixels a film'
    parser = study_parser('films', __doc__, quick, selective=True)
    return run_study(parser, arguments, _filmed, 'finished films are kept')


def _filmed(options: argparse.Namespace) -> str:
    films = read_films(load_settings(options.config))
    names = select_names([film.name for film in films], options.only)
    films = [film for film in films if film.name in names]
    if options.quick:
        films = [resized(film, *_QUICK_SIZE, _QUICK_FRAMES) for film in films]
    kind = file_kind()
    if not kind.ffmpeg:
        films = [resized(film, *_shrunk(film.shape)) for film in films]
    print(f'{len(films)} films as {kind.reason}', file=sys.stderr)
    make_films(films, options.output, kind, options.workers)
    return f'{len(films)} films are in {options.output}'


def _shrunk(shape: Format) -> tuple[int, int]:
    return shape.width // SHRINKING // 2 * 2, shape.height // SHRINKING // 2 * 2


if __name__ == '__main__':
    sys.exit(main())
