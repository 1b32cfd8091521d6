# SPDX-License-Identifier: Apache-2.0
"""Calibration files as camera_calibration of ROS writes them, and camera_info messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from sensor_msgs.msg import CameraInfo

from soliton_linkage.vision.camera import Camera

_MODELS = {'plumb_bob': 5, 'rational_polynomial': 8}
"""Coefficients of the models of lenses [1]."""


def read_camera(path: Path) -> Camera:
    """Camera of a calibration file; raises ValueError or OSError where it is none."""
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        return _camera(
            int(content['image_width']),
            int(content['image_height']),
            str(content['distortion_model']),
            content['camera_matrix']['data'],
            content['distortion_coefficients']['data'],
        )
    except (ValueError, KeyError, TypeError, yaml.YAMLError) as error:
        reason = ' '.join(str(error).split())
        raise ValueError(
            f'{path} is no calibration of a camera: {reason}; write one with calibrate_camera'
        ) from error


def write_camera(path: Path, camera: Camera, name: str = 'camera') -> None:
    """Write a calibration file, which camera drivers of ROS read too."""
    model = (
        'plumb_bob' if len(camera.distortion) <= _MODELS['plumb_bob'] else 'rational_polynomial'
    )
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    content: dict[str, Any] = {
        'image_width': camera.width,
        'image_height': camera.height,
        'camera_name': name,
        'camera_matrix': {'rows': 3, 'cols': 3, 'data': matrix},
        'distortion_model': model,
        'distortion_coefficients': {
            'rows': 1,
            'cols': len(camera.distortion),
            'data': list(camera.distortion),
        },
        'rectification_matrix': {'rows': 3, 'cols': 3, 'data': np.eye(3).ravel().tolist()},
        'projection_matrix': {
            'rows': 3,
            'cols': 4,
            'data': [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        },
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')


def camera_from_msg(message: CameraInfo) -> Camera | None:
    """Camera of a camera_info message, None where it was not calibrated; ValueError for none."""
    if not message.k[0]:
        return None
    return _camera(message.width, message.height, message.distortion_model, message.k, message.d)


def _camera(width: int, height: int, model: str, matrix: Any, distortion: Any) -> Camera:
    numbers = [float(each) for each in matrix]
    if len(numbers) != 9:
        raise ValueError(f'a camera matrix has 9 numbers, and this one {len(numbers)}')
    if model not in _MODELS and len(distortion):
        raise ValueError(f'distortion_model {model!r} is none of {", ".join(_MODELS)}')
    return Camera(
        width,
        height,
        (numbers[0], numbers[4]),
        (numbers[2], numbers[5]),
        tuple(float(each) for each in distortion),
    )
