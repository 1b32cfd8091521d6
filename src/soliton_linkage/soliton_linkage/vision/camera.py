# SPDX-License-Identifier: Apache-2.0
"""Camera model with exposure times, and calibration of a camera with a chessboard.

The coordinates of the camera are x to the right, y downwards and z ahead. With the distortion
coefficients k1 to k6, p1 and p2, the lens maps a ray (x, y, 1) to

    x' = x R(q) + 2 p1 x y + p2 (q + 2 x^2),   y' = y R(q) + p1 (q + 2 y^2) + 2 p2 x y,
    q = x^2 + y^2,   R = (1 + k1 q + k2 q^2 + k3 q^3) / (1 + k4 q + k5 q^2 + k6 q^3),

the model `rational_polynomial` of sensor_msgs/CameraInfo. The pixel is (fx x' + cx, fy y' + cy)
for the focal lengths fx, fy and the principal point (cx, cy), relative to the centre of the first
pixel.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.opencv import Picture, grey_picture, opencv

_MAX_PIXELS = 32_768
"""Largest accepted width and height of a picture [pixels]; no sensor has more."""
_COEFFICIENTS = 8
"""Number of distortion coefficients of the model rational_polynomial."""
_MAX_ITERATIONS, _TOLERANCE = 50, 1e-6
"""The inversion of the lens model ends after this number of iterations [1], or when a step is
smaller than this [pixels]. After 5 iterations, errors at wide angles are still 0.8 pixels."""
_MIN_PICTURES, _MAX_PICTURES = 3, 60
"""Smallest and largest number of pictures for a calibration [1]. With fewer pictures, effects of
focal lengths and distortion cannot be separated. Further pictures are ignored."""
_MIN_MOVE = 0.02
"""A picture is used for the calibration if the corners of the chessboard have moved, on average,
by at least this times the width of the picture since the last used picture [1]."""


@dataclass(frozen=True)
class Camera:
    """Size [pixels], intrinsics and exposure of a camera; raises ValueError for invalid values."""

    width: int
    height: int
    focal: tuple[float, float]
    """Focal lengths fx and fy [pixels]."""
    centre: tuple[float, float]
    """Principal point cx and cy [pixels]."""
    distortion: tuple[float, ...] = ()
    """Coefficients k1, k2, p1, p2, k3, k4, k5, k6 [1]; omitted ones are 0."""
    row_time: float = 0.0
    """Delay between the exposures of successive rows [s]; 0 for a global shutter."""
    exposure: float = 0.0
    """Exposure time of each row [s]; 0 if it is unknown."""

    def __post_init__(self) -> None:
        for name in ('width', 'height'):
            pixels = getattr(self, name)
            if not 1 <= pixels <= _MAX_PIXELS:
                raise ValueError(
                    f'camera {name} = {pixels} must lie in the range 1 to {_MAX_PIXELS} pixels'
                )
        numbers = (*self.focal, *self.centre, *self.distortion, self.row_time, self.exposure)
        if not all(math.isfinite(number) for number in numbers):
            raise ValueError('a parameter of the camera is not finite; calibrate the camera again')
        if min(self.focal) <= 0:
            raise ValueError(f'focal lengths {self.focal} must be above 0 pixels')
        if len(self.distortion) > _COEFFICIENTS:
            raise ValueError(
                f'{len(self.distortion)} distortion coefficients exceed the {_COEFFICIENTS} of '
                'rational_polynomial; calibrate with fewer'
            )
        if min(self.row_time, self.exposure) < 0:
            raise ValueError('row_time and exposure of a camera must be 0 s or more')

    @property
    def middle_delay(self) -> float:
        """Time from the start of the exposure to the mid-exposure of the middle row [s].

        The exposure of a picture starts with its first row.
        """
        return self.exposure / 2 + self.row_time * self.height / 2

    def checked_grey(self, picture: Picture) -> Picture:
        """Return a picture in grey; raise ValueError if its size is not that of the camera."""
        size = (self.height, self.width)
        if picture.dtype != np.uint8 or picture.shape not in (size, (*size, 3)):
            raise ValueError(
                f'picture of {picture.dtype} and shape {picture.shape} does not match the camera, '
                f'which needs uint8 and shape {size} or {(*size, 3)}; check the calibration file'
            )
        return grey_picture(picture)

    def rays(self, pixels: Array) -> Array:
        """Return the rays (x, y) that the lens maps to given pixels, (..., 2)."""
        if not any(self.distortion) or not np.size(pixels):
            return np.asarray((pixels - np.array(self.centre)) / self.focal)
        cv2 = opencv()
        criteria = cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, _MAX_ITERATIONS, _TOLERANCE
        # Before OpenCV 5 the function with termination criteria has another name.
        undistort = getattr(cv2, 'undistortPointsIter', cv2.undistortPoints)
        points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        rays = undistort(points, *self._lens(), R=None, P=None, criteria=criteria)
        return np.asarray(rays).reshape(np.shape(pixels))

    def pixels(self, rays: Array) -> Array:
        """Return the pixels to which the lens maps rays (x, y), (..., 2)."""
        if not any(self.distortion) or not np.size(rays):
            return np.asarray(rays * np.array(self.focal) + self.centre)
        points = np.insert(np.reshape(rays, (-1, 1, 2)), 2, 1.0, axis=2)
        pixels, _ = opencv().projectPoints(points, np.zeros(3), np.zeros(3), *self._lens())
        return np.asarray(pixels).reshape(np.shape(rays))

    def _lens(self) -> tuple[Array, Array]:
        (fx, fy), (cx, cy) = self.focal, self.centre
        distortion = np.zeros(_COEFFICIENTS)
        distortion[: len(self.distortion)] = self.distortion
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), distortion


def uncalibrated_camera(width: int, height: int) -> Camera:
    """Return a camera without distortion, given the width and height of pictures [pixels].

    The principal point is the middle of the picture. Both focal lengths are the larger one of
    width and height.
    """
    focal = float(max(width, height))
    return Camera(width, height, (focal, focal), ((width - 1) / 2, (height - 1) / 2))


@dataclass(frozen=True)
class Calibration:
    """Calibrated camera and the quality of the calibration."""

    camera: Camera
    misfit: float
    """Root mean square reprojection error of the corners [pixels]."""
    pictures: int
    """Number of pictures that were used."""


def calibrate(pictures: Iterable[Picture], columns: int, rows: int, square: float) -> Calibration:
    """Calibrate a camera with pictures of a chessboard of `columns` x `rows` inner corners.

    `square` is the side of a square of the chessboard [m]. Raises ValueError if fewer than 3
    pictures of one size show the whole chessboard.
    """
    cv2 = opencv()
    found: list[Array] = []
    size: tuple[int, int] | None = None
    for picture in pictures:
        height, width = picture.shape[:2]
        if size not in (None, (width, height)):
            raise ValueError(
                f'a picture has {width} x {height} pixels and the first one {size}; use pictures '
                'of one size'
            )
        size = width, height
        complete, seen = cv2.findChessboardCornersSB(
            grey_picture(picture), (columns, rows), cv2.CALIB_CB_EXHAUSTIVE
        )
        if complete:
            corners = np.asarray(seen, dtype=np.float64).reshape(-1, 2)
            moved = np.hypot(*(corners - found[-1]).T) if found else np.inf
            if np.mean(moved) >= _MIN_MOVE * width:
                found.append(corners)
        if len(found) == _MAX_PICTURES:
            break
    if size is None or len(found) < _MIN_PICTURES:
        raise ValueError(
            f'{len(found)} pictures show the whole board of {columns} x {rows} inner corners, and '
            f'{_MIN_PICTURES} or more are needed; tilt the board differently in each picture'
        )
    across, down = np.meshgrid(np.arange(columns), np.arange(rows))
    board = square * np.column_stack([across.ravel(), down.ravel(), np.zeros(columns * rows)])
    misfit, matrix, distortion, *_ = cv2.calibrateCamera(
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
