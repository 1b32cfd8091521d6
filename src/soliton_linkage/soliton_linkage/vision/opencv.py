# SPDX-License-Identifier: Apache-2.0
"""Import of OpenCV and PyAV on first use, because both are optional."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
"""Pixels of a picture: blue, green and red, (height, width, 3), or grey, (height, width)."""


def opencv() -> ModuleType:
    """Return the module cv2; raise ValueError if it is not installed."""
    return _imported('cv2', 'cameras need OpenCV', 'opencv-python-headless', 'opencv')


def pyav() -> ModuleType:
    """Return the module av; raise ValueError if it is not installed."""
    return _imported('av', 'films need PyAV', 'av', 'av')


def grey_picture(picture: Picture) -> Picture:
    """Return a picture in grey, (height, width)."""
    cv2 = opencv()
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)


def _imported(name: str, need: str, wheel: str, package: str) -> ModuleType:
    try:
        return import_module(name)
    except ImportError as error:
        raise ValueError(
            f'{need}, which is not installed ({error}); run: pip install {wheel}, or '
            f'sudo apt install python3-{package}'
        ) from error
