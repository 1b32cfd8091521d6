# SPDX-License-Identifier: Apache-2.0
"""The movies of the paper, from a file of settings: films CONFIG.yaml [--output FOLDER]."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import Any

import matplotlib as mpl

from soliton_linkage.studies.films.cell import Cell, CellScene, StaggeredScene, Staggering
from soliton_linkage.studies.films.chain import (
    CycleScene,
    Insulation,
    InsulatorScene,
    KickedWall,
    Tilting,
    TiltScene,
)
from soliton_linkage.studies.films.files import SHRINKING, FileKind, file_kind, write_film
from soliton_linkage.studies.films.scenes import STYLE, Format, Scene
from soliton_linkage.studies.progress import ProgressLine
from soliton_linkage.studies.settings import Section, load_settings
from soliton_linkage.studies.workers import Processes, local_processes, process_count

_KINDS: dict[str, tuple[Callable[[Section], Any], Callable[[str, Any, Format], Scene]]] = {
    'insulator': (Insulation.read, InsulatorScene),
    'tilt': (Tilting.read, TiltScene),
    'cycle': (KickedWall.read, CycleScene),
    'unit_cell': (Cell.read, CellScene),
    'staggered': (Staggering.read, StaggeredScene),
}
_OF_FILMS = ('kind', 'title', 'playing_time')
_QUICK_FRAMES = 4
_QUICK_SIZE = (320, 180)
_POLLING = 0.1
_FAILURES = (ArithmeticError, ValueError, OSError, RuntimeError, subprocess.SubprocessError)


@dataclass(frozen=True)
class Film:
    """What one film shows and how."""

    name: str
    kind: str
    title: str
    motion: Any
    """Settings of its kind."""
    shape: Format


def read_films(settings: Section) -> list[Film]:
    """Films of a file of settings, all checked; raises ValueError for what cannot be filmed."""
    settings.allow('frame_rate', 'size', 'films')
    frame_rate = settings.number('frame_rate', 1.0, 120.0)
    size = settings.numbers('size', 64, 8192)
    if len(size) != 2 or any(pixels % 2 for pixels in size):
        raise settings.complaint('size', 'must be two even numbers of pixels, as [1280, 720]')
    width, height = (int(pixels) for pixels in size)
    films = []
    for name, section in settings.section('films').sections().items():
        kind = section.text('kind', tuple(_KINDS))
        frames = max(round(frame_rate * section.number('playing_time', 0.1, 3600.0)), 2)
        of_motion = {key: section.values[key] for key in section.values if key not in _OF_FILMS}
        motion = _KINDS[kind][0](replace(section, values=of_motion))
        shape = Format(frames, frame_rate, width, height)
        films.append(Film(name, kind, section.text('title'), motion, shape))
    return films


def chosen(films: Sequence[Film], names: Sequence[str]) -> list[Film]:
    """Films of the given names, of which what comes before _ is enough; all if none is given."""
    for name in names:
        if not any(name in (film.name, film.name.split('_')[0]) for film in films):
            known = ', '.join(film.name for film in films)
            raise ValueError(f'--only {name}: there is no such film; there are {known}')
    return [
        film for film in films if not names or {film.name, film.name.split('_')[0]} & set(names)
    ]


def resized(film: Film, width: int, height: int, most_frames: int | None = None) -> Film:
    """Return a film of the same motion in frames of another size [pixels], and fewer of them."""
    frames = min(film.shape.frames, most_frames or film.shape.frames)
    return replace(film, shape=replace(film.shape, frames=frames, width=width, height=height))


def scene_of(film: Film) -> Scene:
    """Simulate the motion of a film and draw its first frame."""
    return _KINDS[film.kind][1](film.title, film.motion, film.shape)


def make_films(
    films: Sequence[Film], output: Path, kind: FileKind, workers: int | None = None
) -> None:
    """Write films into a folder, in a number of processes, by default one a core.

    Each appears under its name once it is finished; what was begun is deleted on failure.
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Film what a file of settings says; return 1 where that fails, 130 on Ctrl-C."""
    options = _parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        films = chosen(read_films(load_settings(options.config)), options.only)
        if options.quick:
            films = [resized(film, *_QUICK_SIZE, _QUICK_FRAMES) for film in films]
        kind = file_kind()
        if not kind.ffmpeg:
            films = [resized(film, *_shrunk(film.shape)) for film in films]
        print(f'{len(films)} films as {kind.reason}', file=sys.stderr)
        make_films(films, options.output, kind, options.workers)
    except KeyboardInterrupt:
        print('\nfilms: interrupted', file=sys.stderr)
        return 130
    except _FAILURES as error:
        print(f'films: {error}', file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='films',
        description='Film the motions of chains as MP4, or as GIF where there is no ffmpeg.',
    )
    parser.add_argument(
        'config', type=Path, metavar='CONFIG.yaml', help='films, as config/studies/films.yaml'
    )
    parser.add_argument(
        '--output', type=Path, default=Path('out/films'), help='folder for the films [%(default)s]'
    )
    parser.add_argument(
        '--only',
        nargs='+',
        default=[],
        metavar='NAME',
        help='films to make, by name or what comes before its first _, as S3 [all]',
    )
    parser.add_argument(
        '--workers',
        type=process_count,
        metavar='COUNT',
        help='processes on this machine, each with a film at a time [one a core]',
    )
    width, height = _QUICK_SIZE
    parser.add_argument(
        '--quick',
        action='store_true',
        help=f'{_QUICK_FRAMES} frames of {width} x {height} pixels a film, to try it out',
    )
    return parser


def _shrunk(shape: Format) -> tuple[int, int]:
    return shape.width // SHRINKING // 2 * 2, shape.height // SHRINKING // 2 * 2


def _follow(processes: Processes, done: Synchronized[int], total: int) -> None:
    """Show progress until all films are finished; raises what one has failed with."""
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
    """Set up a process: Ctrl-C reaches it through its parent alone, and so does its ffmpeg."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Done.frames = done


class _Done:
    frames: Synchronized[int]


def _count() -> None:
    with _Done.frames.get_lock():
        _Done.frames.value += 1


def _make(film: Film, scratch: Path, output: Path, kind: FileKind) -> None:
    """Write one film and put it in its place."""
    name = film.name + kind.suffix
    with mpl.rc_context(STYLE):
        write_film(scene_of(film), film.shape.frame_rate, scratch / name, kind, _count)
    (scratch / name).replace(output / name)


if __name__ == '__main__':
    sys.exit(main())
