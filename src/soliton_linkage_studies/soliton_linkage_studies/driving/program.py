# SPDX-License-Identifier: Apache-2.0
"""Drive chains in every way there is, and show on one page that what was promised holds.

Writes a page as PNG and PDF with its data as CSV, and a table as Markdown.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from soliton_linkage_studies.driving.findings import finding_lines, page
from soliton_linkage_studies.driving.study import Results, read_driving_study
from soliton_linkage_studies.moves.study import table_lines
from soliton_linkage_studies.program import run_study, side_by_side, study_parser
from soliton_linkage_studies.settings import load_settings


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the page of a file of settings; return 1 where that fails, 130 on Ctrl-C."""
    parser = study_parser('driving', __doc__, 'fewer runs')
    return run_study(parser, arguments, _driven, 'nothing new is written')


def _driven(options: argparse.Namespace) -> str:
    study = read_driving_study(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    results = Results.of(side_by_side('driving', study.tasks, options.workers))
    plate, findings = page(study, results)
    plate.save(options.output, 'driving')
    table = '\n'.join([*finding_lines(findings), '', *table_lines(results.moves)]) + '\n'
    (options.output / 'table.md').write_text(table, encoding='utf-8')
    return f'{table}\npage and table are in {options.output}'


if __name__ == '__main__':
    sys.exit(main())
