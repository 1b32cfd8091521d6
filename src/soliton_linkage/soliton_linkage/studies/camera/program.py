# SPDX-License-Identifier: Apache-2.0
"""Film simulated chains and see their angles again: errors against the bound of the pixels.

Writes a table as Markdown.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from soliton_linkage.studies.camera.runs import COLUMNS, FilmedTask
from soliton_linkage.studies.program import run_study, side_by_side, study_parser
from soliton_linkage.studies.settings import Section, chain_from, load_settings
from soliton_linkage.vision.films.renderer import FilmSettings

_QUICK_FRAMES = 120
"""Pictures of a quick film, two seconds."""
_OF_FILMS = ('frames', 'kicks', 'films', 'chains')


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the films of a file of settings; return 1 where that fails, 130 on Ctrl-C."""
    parser = study_parser('camera', __doc__, f'{_QUICK_FRAMES} pictures a film')
    return run_study(parser, arguments, _made, 'nothing new is written')


def _made(options: argparse.Namespace) -> str:
    tasks = _tasks(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    runs = side_by_side('films', tasks, options.workers)
    lines = ['| ' + ' | '.join(['film', *COLUMNS]) + ' |']
    lines.append('| ' + ' | '.join('---' for _ in lines[0].split('|')[2:]) + ' |')
    lines += [f'| {name} | ' + ' | '.join(run.row) + ' |' for name, run in runs.items()]
    table = '\n'.join(lines) + '\n'
    (options.output / 'table.md').write_text(table, encoding='utf-8')
    return f'{table}\nthe table is in {options.output}'


def _tasks(settings: Section, quick: bool) -> dict[str, FilmedTask]:
    settings.allow(*_OF_FILMS)
    frames = settings.whole_number('frames', 20, 1_000_000)
    kicks = settings.section('kicks')
    tasks = {}
    for title, film in settings.section('films').sections().items():
        film.allow('noise', 'quality', 'h264')
        light = FilmSettings(
            noise=film.number('noise', 0.0, 50.0), quality=film.whole_number('quality', 0, 100)
        )
        for name, section in settings.section('chains').sections().items():
            task = FilmedTask(
                chain_from(section),
                kicks.number(name, 1e-6, 10.0),
                min(frames, _QUICK_FRAMES) if quick else frames,
                light,
                film.whole_number('h264', 0, 51),
            )
            tasks[f'{name}, {title}'] = task
    return tasks


if __name__ == '__main__':
    sys.exit(main())
