# SPDX-License-Identifier: Apache-2.0
"""A camera: where a ray of light ends in its picture, and when.

A ray (x, y, 1) in the camera's frame, x right, y down, z ahead, is moved by the lens to

    x' = x R(q) + 2 p1 x y + p2 (q + 2 x^2),   y' = y R(q) + p1 (q + 2 y^2) + 2 p2 x y,
    q = x^2 + y^2,   R = (1 + k1 q + k2 q^2 + k3 q^3) / (1 + k4 q + k5 q^2 + k6 q^3),

and ends at the pixel (fx x' + cx, fy y' + cy); the centre of the first pixel is (0, 0). These are
the models `plumb_bob` and `rational_polynomial` of sensor_msgs/CameraInfo.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.lens import lens_loops

_MOST_PIXELS = 32_768
"""Of a side of a picture: more than any sensor has."""
_COEFFICIENTS = 8
"""Of the fullest model, k1 k2 p1 p2 k3 k4 k5 k6; fewer are the first ones."""


@dataclass(frozen=True)
class Camera:
    """Intrinsics of a camera, and when it exposes; raises ValueError where they are invalid."""

    width: int
    """Of the picture [pixels]."""
    height: int
    """Of the picture [pixels]."""
    focal: tuple[float, float]
    """fx and fy [pixels]."""
    centre: tuple[float, float]
    """cx and cy [pixels]."""
    distortion: tuple[float, ...] = ()
    """k1, k2, p1, p2, k3, k4, k5, k6, as many as there are [1]."""
    calibrated: bool = True
    """Whether these are of a calibration; else the lens is taken for ideal."""
    row_time: float = 0.0
    """From the exposure of a row to that of the next [s]; 0 of a global shutter."""
    exposure: float = 0.0
    """How long each row is exposed [s]; 0 where it is not known."""

    def __post_init__(self) -> None:
        """Refuse what no camera has."""
        for name in ('width', 'height'):
            pixels = getattr(self, name)
            if not 1 <= pixels <= _MOST_PIXELS:
                raise ValueError(
                    f'camera {name} = {pixels} must lie in the range 1 to {_MOST_PIXELS} pixels'
                )
        numbers = (*self.focal, *self.centre, *self.distortion, self.row_time, self.exposure)
        if not all(math.isfinite(number) for number in numbers):
            raise ValueError('the camera has a number that is not finite; calibrate it again')
        if min(self.focal) <= 0:
            raise ValueError(f'focal lengths {self.focal} must be above 0 pixels')
        if len(self.distortion) > _COEFFICIENTS:
            raise ValueError(
                f'{len(self.distortion)} coefficients of distortion are more than the '
                f'{_COEFFICIENTS} of rational_polynomial; calibrate with fewer'
            )
        if min(self.row_time, self.exposure) < 0:
            raise ValueError('row_time and exposure of a camera must be 0 s or more')

    def rays(self, pixels: Array) -> Array:
        """Rays (x, y) that end at pixels, shape (..., 2)."""
        seen = (np.asarray(pixels, dtype=np.float64) - self.centre) / self.focal
        return self._each(lens_loops.undistort, seen)

    def pixels(self, rays: Array) -> Array:
        """Pixels at which rays (x, y) end, shape (..., 2)."""
        moved = self._each(lens_loops.distort, np.asarray(rays, dtype=np.float64))
        return np.asarray(moved * self.focal + self.centre)

    def _each(self, loop: Callable[[Array, Array, Array], None], rays: Array) -> Array:
        """Rays that a loop makes of others by the coefficients of the lens, (..., 2) each."""
        if not any(self.distortion):
            return np.asarray(rays)
        lens = np.zeros(_COEFFICIENTS)
        lens[: len(self.distortion)] = self.distortion
        others = np.empty(rays.shape)
        loop(np.ascontiguousarray(rays).reshape(-1, 2), lens, others.reshape(-1, 2))
        return others


def uncalibrated(width: int, height: int, row_time: float = 0.0, exposure: float = 0.0) -> Camera:
    """Camera of which only the size of its pictures is known: a lens without distortion."""
    focal = float(max(width, height))
    return Camera(
        width,
        height,
        (focal, focal),
        ((width - 1) / 2, (height - 1) / 2),
        calibrated=False,
        row_time=row_time,
        exposure=exposure,
    )
