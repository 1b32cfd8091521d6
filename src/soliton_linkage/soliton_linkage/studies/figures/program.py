# SPDX-License-Identifier: Apache-2.0
"""Draw the figures of the paper, and some of our own, with their data and a table.

Every figure is written as PNG and PDF with its data as CSV, and table.md sets side by side what
the paper says, what the corrected theory says and what the simulated chain does. Figures that
are not drawn again keep their rows in it.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from soliton_linkage.studies.figures.actuator import actuator_figure
from soliton_linkage.studies.figures.cell import figure_4
from soliton_linkage.studies.figures.linear import figure_1
from soliton_linkage.studies.figures.motion import snapshot_figure
from soliton_linkage.studies.figures.profiles import figure_5, figure_6, figure_s1, figure_s2
from soliton_linkage.studies.figures.survey import (
    anti_kink_figure,
    disorder_figure,
    energy_figure,
    rigid_limit_figure,
)
from soliton_linkage.studies.plates import Comparison, Plate, write_table
from soliton_linkage.studies.progress import ProgressLine
from soliton_linkage.studies.settings import Section, load_settings
from soliton_linkage.studies.workers import local_processes, process_count

_STOPPED = 130

FIGURES: dict[str, Callable[[Section, bool], Plate]] = {
    'figure_1': figure_1,
    'figure_2': snapshot_figure,
    'figure_3': snapshot_figure,
    'figure_4': figure_4,
    'figure_5': figure_5,
    'figure_6': figure_6,
    'figure_s1': figure_s1,
    'figure_s2': figure_s2,
    'energy_against_speed': energy_figure,
    'disorder_against_passage': disorder_figure,
    'elastic_against_rigid': rigid_limit_figure,
    'anti_kink_cost': anti_kink_figure,
    'soft_actuator': actuator_figure,
}


def draw(name: str, config: Path, output: Path, quick: bool) -> list[Comparison]:
    """Draw one figure into a folder and return its lines of the table."""
    section = load_settings(config).section(name)
    plate = FIGURES[name](section, quick)
    plate.save(output, name)
    return plate.comparisons


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the figures that the command line asks for."""
    options = _parser().parse_args(arguments)
    names = options.only or list(FIGURES)
    try:
        for name in names:
            load_settings(options.config).section(name)
        options.output.mkdir(parents=True, exist_ok=True)
        lines = _draw_all(names, options)
    except (OSError, ValueError, ArithmeticError) as error:
        print(f'figures: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('figures: stopped; the figures that were finished stay', file=sys.stderr)
        return _STOPPED
    write_table(lines, options.output / 'table.md', list(FIGURES))
    print(f'{len(names)} figures and table.md are in {options.output}')
    return 0


def _draw_all(names: list[str], options: argparse.Namespace) -> dict[str, list[Comparison]]:
    """Draw figures side by side; their lines of the table by name."""
    progress = ProgressLine('figures', len(names))
    done: dict[str, list[Comparison]] = {}
    with local_processes(min(options.workers, len(names))) as processes:
        futures = {
            processes.submit(draw, name, options.config, options.output, options.quick): name
            for name in names
        }
        for future in processes.finished():
            done[futures[future]] = future.result()
            waiting = [name for name in names if name not in done]
            progress.show(len(done), f'to do: {", ".join(waiting)}' if waiting else '')
    progress.end(f'figures: {len(done)} drawn')
    return done


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='figures', description=__doc__)
    parser.add_argument('config', type=Path, help='settings, as config/studies/figures.yaml')
    parser.add_argument('--output', type=Path, default=Path('out/figures'), help='folder')
    parser.add_argument(
        '--only', nargs='+', choices=FIGURES, metavar='NAME', help=', '.join(FIGURES)
    )
    parser.add_argument('--quick', action='store_true', help='fewer points, to try it out')
    parser.add_argument(
        '--workers', type=process_count, default=os.cpu_count() or 1, help='processes [one a core]'
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
