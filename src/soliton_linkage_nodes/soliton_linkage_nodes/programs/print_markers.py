# SPDX-License-Identifier: Apache-2.0
"""Write pages with the markers of a chain in true size, for film_encoders and camera_encoders.

Dots are the markers of the pivots and masses. Square markers belong on the frame of the chain.

Print the pages without scaling, and check the length of the printed ruler. Cut the markers out,
and stick each one at the position on the chain that is printed below it. The last page is a
chessboard for calibrate_camera.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from soliton_linkage.command_line import PlainParser
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage.vision.sheets import PAPERS, write_sheets
from soliton_linkage_nodes.messages.chain_source import chain_of_file, markers_of_file
from soliton_linkage_nodes.programs.command_line import add_output, exit_on_failure


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the pages as the command line specifies."""
    parser = PlainParser(prog='print_markers', description=__doc__)
    parser.add_argument('config', type=Path, help='parameter file such as config/flipper.yaml')
    add_output(parser, 'out/markers.pdf', 'file to write, .pdf or .svg')
    parser.add_argument(
        '--paper', choices=list(PAPERS), default='a4', help='size of the paper (%(default)s)'
    )
    options = parser.parse(arguments)
    with exit_on_failure('print_markers'):
        layout = MarkerLayout(chain_of_file(options.config).chain, markers_of_file(options.config))
        paths = write_sheets(layout, options.output, options.paper)
        sheets = f'{paths[0]} to {paths[-1]}' if len(paths) > 1 else str(paths[0])
        print(
            f'{sheets}: labels of {2e3 * layout.label_radius:.0f} mm and frame markers of '
            f'{1e3 * layout.paper_size:.0f} mm; print without scaling',
            file=sys.stderr,
        )
