# SPDX-License-Identifier: Apache-2.0
"""Carry walls along simulated chains, and show where they end and what phonons they wake.

Writes a table as Markdown and a picture as PNG and PDF with its data as CSV.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from soliton_linkage_studies.moves.pictures import draw_moves
from soliton_linkage_studies.moves.study import read_move_study, runs_by_key, table_lines
from soliton_linkage_studies.program import run_study, side_by_side, study_parser
from soliton_linkage_studies.settings import load_settings


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the moves of a file of settings; return 1 where that fails, 130 on Ctrl-C."""
    parser = study_parser('moves', __doc__, 'fewer moves')
    return run_study(parser, arguments, _made, 'nothing new is written')


def _made(options: argparse.Namespace) -> str:
    study = read_move_study(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    runs = runs_by_key(side_by_side('moves', study.numbered, options.workers))
    table = '\n'.join(table_lines(runs)) + '\n'
    (options.output / 'table.md').write_text(table, encoding='utf-8')
    draw_moves(study.tasks, runs).save(options.output, 'moves')
    return f'{table}\ntable and picture are in {options.output}'


if __name__ == '__main__':
    sys.exit(main())
