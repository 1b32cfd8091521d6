# SPDX-License-Identifier: Apache-2.0
"""Calibrate a camera with pictures or a film of a chessboard; print_markers prints a chessboard.

Take a dozen pictures of the whole board. Move and tilt the board after each picture. The output
file has the format of ROS's camera_calibration.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage.vision.camera import calibrate
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage.vision.video import read_video
from soliton_linkage_nodes.messages.picture_conversions import write_camera
from soliton_linkage_nodes.programs.command_line import add_output, add_quantity, exit_on_failure
from soliton_linkage_nodes.runtime.process import interrupt_on_signals

_PICTURES = ('.jpg', '.jpeg', '.png', '.tif', '.tiff', '.bmp')
_STRIDE = 10
"""Only every tenth picture of a film is searched for the board [1], because a search takes 0.1
s."""
_BOARD = {
    '--columns': (Quantity('columns of inner corners', '', 2, 100), 8, int),
    '--rows': (Quantity('rows of inner corners', '', 2, 100), 5, int),
    '--square': (Quantity('side of a square', 'm', 1e-4, 10.0), 0.025, float),
}
"""Options that describe the chessboard, each with its quantity, default and type."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Calibrate the camera as the command line specifies."""
    parser = PlainParser(prog='calibrate_camera', description=__doc__)
    parser.add_argument(
        'paths', type=Path, nargs='+', metavar='picture', help='pictures, or one film'
    )
    for name, described in _BOARD.items():
        add_quantity(parser, name, *described)
    add_output(parser, 'out/camera.yaml', 'calibration file to write')
    options = parser.parse(arguments)
    with exit_on_failure('calibrate_camera'):
        interrupt_on_signals()
        pictures = _pictures(options.paths)
        found = calibrate(pictures, options.columns, options.rows, options.square)
        write_camera(options.output, found.camera)
        print(
            f'{options.output}: rms residual of {found.misfit:.2f} pixels in '
            f'{found.pictures} pictures',
            file=sys.stderr,
        )


def _pictures(paths: Sequence[Path]) -> Iterator[Picture]:
    cv2 = opencv()
    for path in paths:
        if path.suffix.lower() not in _PICTURES:
            for count, taken in enumerate(read_video(path).pictures):
                if count % _STRIDE == 0:
                    yield taken.picture
            continue
        picture = cv2.imread(str(path))
        if picture is None:
            raise ValueError(f'picture {str(path)!r} does not exist or cannot be read')
        yield np.asarray(picture)
