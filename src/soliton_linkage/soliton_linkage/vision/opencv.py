# SPDX-License-Identifier: Apache-2.0
"""OpenCV and PyAV, which need not be installed until somebody looks through a camera."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

_REMEDIES = {
    'cv2': 'opencv-python-headless, or sudo apt install python3-opencv',
    'av': 'av, or sudo apt install python3-av',
}


def opencv() -> ModuleType:
    """Return OpenCV; raises ValueError that says how to install it."""
    return _imported('cv2', 'cameras need OpenCV')


def pyav() -> ModuleType | None:
    """Return PyAV, None where it is not installed."""
    try:
        return import_module('av')
    except ImportError:
        return None


def pyav_to_write() -> ModuleType:
    """Return PyAV; raises ValueError that says how to install it."""
    return _imported('av', 'to write films takes PyAV')


def _imported(name: str, needed: str) -> ModuleType:
    try:
        return import_module(name)
    except ImportError as error:
        raise ValueError(
            f'{needed}, which is not installed ({error}); run: pip install {_REMEDIES[name]}'
        ) from error
