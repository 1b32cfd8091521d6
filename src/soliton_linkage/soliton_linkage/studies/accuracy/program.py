# SPDX-License-Identifier: Apache-2.0
"""Measure how well walls are measured: estimators against their bound, and Lorentz contraction.

Writes tables as Markdown and CSV and pictures as PNG and PDF. They depend on the settings alone,
not on the number of processes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from soliton_linkage.studies.accuracy.contraction import read_contraction_study
from soliton_linkage.studies.accuracy.frames import read_frame_study
from soliton_linkage.studies.accuracy.record import read_record_study
from soliton_linkage.studies.program import run_study, side_by_side, study_parser
from soliton_linkage.studies.settings import Section, load_settings


class AccuracyPart(Protocol):
    """One of the studies that a file of settings may ask for."""

    def tasks(self) -> list[Callable[[], Any]]:
        """What there is to measure, in pieces for other processes."""

    def write(self, results: Sequence[Any], folder: Path) -> None:
        """Write tables and pictures into a folder, from the results of the tasks in order."""


PARTS: dict[str, Callable[[Section, bool], AccuracyPart]] = {
    'single_frame': read_frame_study,
    'contraction': read_contraction_study,
    'record': read_record_study,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what a file of settings says; return 1 where that fails, 130 on Ctrl-C."""
    parser = study_parser('accuracy', __doc__, 'fewer frames')
    return run_study(parser, arguments, _written, 'nothing new is written')


def _written(options: argparse.Namespace) -> str:
    parts = read_parts(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    results = measured([task for part in parts for task in part.tasks()], options.workers)
    for part in parts:
        count = len(part.tasks())
        part.write(results[:count], options.output)
        results = results[count:]
    return f'tables and pictures are in {options.output}'


def read_parts(settings: Section, quick: bool) -> list[AccuracyPart]:
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
    """Results of tasks in their order.

    They are begun in a mixed order, so that those done so far tell how long the rest will take.
    """
    order = np.random.default_rng(0).permutation(len(tasks)).tolist()
    results = side_by_side('accuracy', {number: tasks[number] for number in order}, workers)
    return [results[number] for number in range(len(tasks))]


if __name__ == '__main__':
    sys.exit(main())
