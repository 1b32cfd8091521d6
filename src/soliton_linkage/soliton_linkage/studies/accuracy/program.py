# SPDX-License-Identifier: Apache-2.0
"""Measure how well walls are measured: estimators against their bound, and Lorentz contraction.

Writes tables as Markdown and CSV and pictures as PNG and PDF. They depend on the settings alone,
not on the number of processes.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from soliton_linkage.studies.accuracy.contraction import read_contraction_study
from soliton_linkage.studies.accuracy.frames import read_frame_study
from soliton_linkage.studies.accuracy.record import read_record_study
from soliton_linkage.studies.progress import ProgressLine
from soliton_linkage.studies.settings import Section, load_settings
from soliton_linkage.studies.workers import local_processes, process_count

_STOPPED = 130


class Part(Protocol):
    """One of the studies that a file of settings may ask for."""

    def tasks(self) -> list[Callable[[], Any]]:
        """What there is to measure, in pieces for other processes."""

    def write(self, results: Sequence[Any], folder: Path) -> None:
        """Write tables and pictures into a folder, from the results of the tasks in order."""


PARTS: dict[str, Callable[[Section, bool], Part]] = {
    'single_frame': read_frame_study,
    'contraction': read_contraction_study,
    'record': read_record_study,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what a file of settings says; return 1 where that fails, 130 on Ctrl-C."""
    options = _parser().parse_args(arguments)
    try:
        parts = read_parts(load_settings(options.config), options.quick)
        options.output.mkdir(parents=True, exist_ok=True)
        results = measured([task for part in parts for task in part.tasks()], options.workers)
        for part in parts:
            count = len(part.tasks())
            part.write(results[:count], options.output)
            results = results[count:]
    except (OSError, ValueError, ArithmeticError) as error:
        print(f'accuracy: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('\naccuracy: stopped; nothing new is written', file=sys.stderr)
        return _STOPPED
    print(f'tables and pictures are in {options.output}')
    return 0


def read_parts(settings: Section, quick: bool) -> list[Part]:
    """Parts of a file of settings, all checked; raises ValueError for what cannot be measured."""
    settings.allow(*PARTS)
    if not settings.values:
        raise ValueError(f'{settings.file}: is empty; give one or more of {", ".join(PARTS)}')
    return [
        read(settings.section(name), quick)
        for name, read in PARTS.items()
        if name in settings.values
    ]


def measured(tasks: Sequence[Callable[[], Any]], workers: int) -> list[Any]:
    """Results of tasks in their order, from processes side by side.

    They are begun in a mixed order, so that those done so far tell how long the rest will take.
    """
    progress = ProgressLine('accuracy', len(tasks))
    begin = time.monotonic()
    results: dict[int, Any] = {}
    with local_processes(min(workers, len(tasks))) as processes:
        order = np.random.default_rng(0).permutation(len(tasks)).tolist()
        futures = {processes.submit(tasks[number]): number for number in order}
        progress.show(0, 'building the orbits')
        for future in processes.finished():
            results[futures[future]] = future.result()
            left = (time.monotonic() - begin) * (len(tasks) / len(results) - 1)
            progress.show(len(results), f'{left:.0f} s left')
    progress.end(f'accuracy: measured in {time.monotonic() - begin:.0f} s')
    return [results[number] for number in range(len(tasks))]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='accuracy', description=__doc__)
    parser.add_argument('config', type=Path, help='settings, as config/studies/accuracy.yaml')
    parser.add_argument('--output', type=Path, default=Path('out/accuracy'), help='folder')
    parser.add_argument('--quick', action='store_true', help='fewer frames, to try it out')
    parser.add_argument(
        '--workers', type=process_count, default=os.cpu_count() or 1, help='processes [one a core]'
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
