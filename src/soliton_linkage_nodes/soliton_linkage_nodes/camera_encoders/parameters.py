# SPDX-License-Identifier: Apache-2.0
"""Parameters of what sees angles."""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.linkage.quantities import quantity

_MOST_CAMERAS = 63
"""Number of the last camera that Linux has."""


@dataclass(frozen=True)
class SightParameters:
    """When a camera exposes, and what the chain wears."""

    row_time: float = quantity(
        0.0,
        'time from the exposure of a row of the picture to that of the next, 0 of a global '
        'shutter; a phone has about 2e-5',
        's',
        0.0,
        1e-3,
    )
    exposure: float = quantity(
        0.0, 'how long each row is exposed, 0 where that is not known', 's', 0.0, 1.0
    )
    markers_worn: bool = quantity(
        True,
        'whether pivots and masses wear markers; else rotors are dark on a light ground, and do '
        'not touch',
    )


@dataclass(frozen=True)
class CameraEncodersParameters:
    """Where the pictures come from."""

    pictures_from: str = quantity(
        'image',
        'whether pictures come from the topic image, from the topic image/compressed, or from a '
        'camera of this machine',
        choices=('image', 'compressed', 'camera'),
    )
    camera: int = quantity(0, 'number of the camera of this machine', '', 0, _MOST_CAMERAS)
    camera_file: str = quantity(
        '', 'path of a file of calibrate_camera, empty for what the topic camera_info says'
    )
    overlay_rate: float = quantity(
        20.0,
        'most pictures a second on camera_overlay, which are drawn while it is heard',
        'Hz',
        0.1,
        1000.0,
    )
