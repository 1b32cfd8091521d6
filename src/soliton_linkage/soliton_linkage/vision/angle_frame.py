# SPDX-License-Identifier: Apache-2.0
"""What a picture shows of the rotors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.dots import Picture
from soliton_linkage.vision.lens.camera import Camera


@dataclass(frozen=True)
class AngleFrame:
    """What a picture shows of N rotors."""

    delay: float
    """From the time of the picture to that of the angles [s]."""
    angles: Array
    """Actual angles, unwrapped [rad], NaN of rotors that are not seen, shape (N,)."""
    deviations: Array
    """Standard deviation of each angle [rad], NaN of rotors that are not seen, shape (N,)."""
    masses: Array
    """Where the dots of the masses are [pixels], NaN where they are not seen, shape (N, 2)."""
    pivots: Array
    """Where the pivots are [pixels], NaN where that is not known, shape (N, 2)."""
    frame_dots: Array
    """Where the dots of the frame markers are [pixels], shape (K, 2)."""
    status: str
    """What keeps rotors from being seen; empty where all are."""

    @property
    def seen(self) -> int:
        """Number of rotors that are seen."""
        return int(np.isfinite(self.angles).sum())


def no_rotors(rotors: int, delay: float, status: str) -> AngleFrame:
    """A picture in which none of so many rotors is seen, and why."""
    none = np.full(rotors, np.nan)
    nowhere = np.full((rotors, 2), np.nan)
    return AngleFrame(delay, none, none.copy(), nowhere, nowhere.copy(), np.zeros((0, 2)), status)


def check_picture(camera: Camera, picture: Picture) -> None:
    """Raise ValueError for what is no picture of a camera."""
    size = (camera.height, camera.width)
    if picture.dtype != np.uint8 or picture.shape not in (size, (*size, 3)):
        raise ValueError(
            f'a picture of {picture.dtype} and shape {picture.shape} is none of the camera, '
            f'whose have uint8 and shape {size} or {(*size, 3)}'
        )
