# SPDX-License-Identifier: Apache-2.0
"""Film simulated chains and see their angles again: errors against the bound of the pixels.

Writes a table as Markdown. Interrupted, the same command goes on where it was, after whichever
clip of a film.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from soliton_linkage_studies.camera.study import read_film_study, table_of
from soliton_linkage_studies.program import run_study, study_parser
from soliton_linkage_studies.settings import load_settings
from soliton_linkage_studies.sweep.table import RESUMES, filled_table


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the films of a file of settings; return 1 where that fails, 130 on Ctrl-C."""
    parser = study_parser('camera', __doc__, 'a clip of two seconds a film')
    return run_study(parser, arguments, _made, RESUMES)


def _made(options: argparse.Namespace) -> str:
    study = read_film_study(load_settings(options.config), options.quick)
    _, rows = filled_table(study, options.output, options.workers)
    text = table_of(rows)
    (options.output / 'table.md').write_text(text, encoding='utf-8')
    return f'{text}\nthe table is in {options.output}'


if __name__ == '__main__':
    sys.exit(main())
