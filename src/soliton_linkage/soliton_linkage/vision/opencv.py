# SPDX-License-Identifier: Apache-2.0
"""OpenCV and PyAV, which are imported when they are used, because they are optional."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
"""Blue, green and red, shape (height, width, 3), or grey, shape (height, width)."""


def opencv() -> ModuleType:
    """Return OpenCV; ValueError with the remedy if it is not installed."""
    return _imported('cv2', 'cameras need OpenCV', 'opencv-python-headless', 'opencv')


def pyav() -> ModuleType | None:
    """Return PyAV, None if it is not installed."""
    try:
        return import_module('av')
    except ImportError:
        return None


def pyav_for_writing() -> ModuleType:
    """Return PyAV; ValueError with the remedy if it is not installed."""
    return _imported('av', 'to write films takes PyAV', 'av', 'av')


def _imported(name: str, needed: str, wheel: str, package: str) -> ModuleType:
    try:
        return import_module(name)
    except ImportError as error:
        raise ValueError(
            f'{needed}, which is not installed ({error}); run: pip install {wheel}, or '
            f'sudo apt install python3-{package}'
        ) from error
