# SPDX-License-Identifier: Apache-2.0
"""Simulate collisions of kinks and anti-kinks on rings of springs.

Write tables as CSV and Markdown, and figures as PNG and PDF. After an interruption, the same
command continues the study.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from soliton_linkage_studies.collisions.pictures import draw_pictures, draw_speeds, draw_windows
from soliton_linkage_studies.collisions.study import (
    finding_lines,
    read_collision_study,
    read_row,
)
from soliton_linkage_studies.program import run_study, study_parser
from soliton_linkage_studies.settings import load_settings
from soliton_linkage_studies.sweep.table import RESUMES, fill_table


def main(arguments: Sequence[str] | None = None) -> int:
    """Simulate the collisions of a settings file; return 1 on failure, 130 on Ctrl-C."""
    parser = study_parser('collisions', __doc__, 'few speeds')
    return run_study(parser, arguments, _collided, RESUMES)


def _collided(options: argparse.Namespace) -> str:
    study = read_collision_study(load_settings(options.config), options.quick)
    folder = options.output / ('quick' if options.quick else 'runs')
    _, cells = fill_table(study, folder, options.workers)
    rows = [read_row(each) for each in cells]
    draw_speeds(rows).save(options.output, 'collisions')
    draw_windows(rows).save(options.output, 'collision_windows')
    draw_pictures(study.pictures).save(options.output, 'collision_pictures')
    table = '\n'.join(finding_lines(rows)) + '\n'
    (options.output / 'table.md').write_text(table, encoding='utf-8')
    failed = sum(bool(row.failure) for row in rows)
    remark = f'; {failed} of {len(rows)} collisions failed' if failed else ''
    return f'{table}\ntables and pictures are in {options.output}{remark}'


if __name__ == '__main__':
    sys.exit(main())
