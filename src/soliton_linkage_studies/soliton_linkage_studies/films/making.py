# SPDX-License-Identifier: Apache-2.0
"""Films that processes make side by side, each of which appears whole or not at all."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Sequence
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

import matplotlib as mpl

from soliton_linkage.progress import ProgressLine
from soliton_linkage_studies.films.files import FileKind, write_film
from soliton_linkage_studies.films.film import Film, scene_of
from soliton_linkage_studies.films.scenes import STYLE
from soliton_linkage_studies.plates import save_caption
from soliton_linkage_studies.workers import Processes, local_processes

_POLLING = 0.1
"""After which the frames are counted that processes have made meanwhile [s]."""


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
    """Write one film and put it in its place, with its caption beside it."""
    name = film.name + kind.suffix
    with mpl.rc_context(STYLE):
        scene = scene_of(film)
        write_film(scene, film.shape.frame_rate, scratch / name, kind, _count)
    save_caption(f'{scene.headline}\n\n{scene.caption}', output / f'{film.name}.txt')
    (scratch / name).replace(output / name)
