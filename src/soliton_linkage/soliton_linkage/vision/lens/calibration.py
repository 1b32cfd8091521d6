# SPDX-License-Identifier: Apache-2.0
"""The lens of a camera by pictures of a chessboard (OpenCV's calibration)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.dots import Picture
from soliton_linkage.vision.lens.camera import Camera
from soliton_linkage.vision.opencv import opencv

_FEWEST_PICTURES = 3
"""That tell the focal lengths and the distortion apart [1]."""
_MOST_PICTURES = 60
"""That are used: more take long and tell nothing new [1]."""
_LEAST_MOVE = 0.02
"""Of the mean corner between two pictures that are used, over the width [1]: films may stand."""


@dataclass(frozen=True)
class Calibration:
    """A camera and how well it was found."""

    camera: Camera
    misfit: float
    """Root mean square distance of corners from where the camera has them [pixels]."""
    pictures: int
    """In which the board was seen and that were used."""


def chessboard_corners(picture: Picture, columns: int, rows: int) -> Array | None:
    """Inner corners of a chessboard in a picture [pixels], (columns rows, 2); None for none."""
    cv2 = opencv()
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    found, corners = cv2.findChessboardCornersSB(grey, (columns, rows), cv2.CALIB_CB_EXHAUSTIVE)
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2) if found else None


def calibrated(pictures: Iterable[Picture], columns: int, rows: int, square: float) -> Calibration:
    """Camera that has taken pictures of a board of so many inner corners and squares [m].

    Raises ValueError where too few show it, or their sizes differ.
    """
    found: list[Array] = []
    size: tuple[int, int] | None = None
    for picture in pictures:
        height, width = picture.shape[:2]
        if size not in (None, (width, height)):
            raise ValueError(
                f'a picture of {width} x {height} pixels is not of the size of the first; '
                'calibrate with pictures of one size'
            )
        size = width, height
        corners = chessboard_corners(picture, columns, rows)
        if corners is None or (found and _same(corners, found[-1], width)):
            continue
        found.append(corners)
        if len(found) == _MOST_PICTURES:
            break
    if size is None or len(found) < _FEWEST_PICTURES:
        raise ValueError(
            f'{len(found)} pictures show a board of {columns} x {rows} inner corners, and '
            f'{_FEWEST_PICTURES} or more are needed; show it whole, tilted differently in each'
        )
    return _camera_of(found, columns, rows, square, size)


def _same(corners: Array, before: Array, width: int) -> bool:
    return float(np.hypot(*(corners - before).T).mean()) < _LEAST_MOVE * width


def _camera_of(
    found: list[Array], columns: int, rows: int, square: float, size: tuple[int, int]
) -> Calibration:
    across, down = np.meshgrid(np.arange(columns), np.arange(rows))
    board = square * np.column_stack([across.ravel(), down.ravel(), np.zeros(columns * rows)])
    misfit, matrix, distortion, *_ = opencv().calibrateCamera(
        [board.astype(np.float32)] * len(found),
        [corners.astype(np.float32).reshape(-1, 1, 2) for corners in found],
        size,
        None,
        None,
    )
    camera = Camera(
        *size,
        focal=(float(matrix[0, 0]), float(matrix[1, 1])),
        centre=(float(matrix[0, 2]), float(matrix[1, 2])),
        distortion=tuple(float(each) for each in np.ravel(distortion)),
    )
    return Calibration(camera, float(misfit), len(found))
