# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages to pictures and back, and files in the format of camera_calibration."""

from __future__ import annotations

import array
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.camera import Camera
from soliton_linkage.vision.opencv import Picture, opencv
from soliton_linkage_nodes.runtime.stamps import time_to_msg

_QUALITY = 80
"""JPEG quality [%]. At this quality text is sharp, and a picture of 1280 x 720 pixels has about
150 kB."""

_CHANNELS = {
    'bgr8': (3, [0, 1, 2]),
    '8UC3': (3, [0, 1, 2]),
    'rgb8': (3, [2, 1, 0]),
    'bgra8': (4, [0, 1, 2]),
    'rgba8': (4, [2, 1, 0]),
    'mono8': (1, [0]),
    '8UC1': (1, [0]),
}
"""Number of bytes of a pixel, and indices of its blue, green and red byte, for each encoding."""
_JPEG_HEADER = b'\xff\xd8\xff'
_MODELS = {'plumb_bob': 5, 'rational_polynomial': 8}
"""Number of distortion coefficients of each lens model [1]."""


def picture_from_msg(message: Image) -> Picture:
    """Return the pixels of a picture. Raises ValueError if the message is invalid.

    The shape is (rows, columns, 3) with the colours in the order blue, green, red. For a grey
    picture the shape is (rows, columns).
    """
    if message.encoding not in _CHANNELS:
        raise ValueError(
            f'encoding {message.encoding!r} is none of {", ".join(_CHANNELS)}; convert the '
            'pictures or change the encoding of the camera'
        )
    channels, order = _CHANNELS[message.encoding]
    height, width, step = message.height, message.width, message.step
    data = np.frombuffer(message.data, dtype=np.uint8)
    if not height or not width or step < width * channels or len(data) < height * step:
        raise ValueError(
            f'{len(data)} bytes are no picture of {width} x {height} pixels, {step} bytes a row'
        )
    rows = data[: height * step].reshape(height, step)[:, : width * channels]
    pixels = rows.reshape(height, width, channels)
    return np.ascontiguousarray(pixels[..., 0] if channels == 1 else pixels[..., order])


def jpeg_from_msg(message: CompressedImage, most: int) -> bytes:
    """Return the JPEG bytes in a message.

    Raises ValueError if the bytes are not a JPEG picture or if their number exceeds `most`.
    """
    data = bytes(message.data)
    if len(data) > most:
        raise ValueError(
            f'a picture of {len(data)} bytes exceeds the limit of {most}; send smaller pictures'
        )
    if not data.startswith(_JPEG_HEADER):
        raise ValueError(f'{len(data)} bytes of format {message.format!r} are no JPEG; send jpeg')
    return data


def picture_from_compressed_msg(message: CompressedImage) -> Picture:
    """Return the BGR pixels of a compressed picture, shape (rows, columns, 3).

    Raises ValueError if the picture is damaged.
    """
    cv2 = opencv()
    data = np.frombuffer(message.data, dtype=np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if picture is None:
        raise ValueError(
            f'{len(data)} bytes of format {message.format!r} are no picture; send jpeg or png'
        )
    return np.asarray(picture)


def picture_to_compressed_msg(stamp: int, frame_id: str, picture: Picture) -> CompressedImage:
    """Return a message with a JPEG picture and a `stamp` [ns].

    The shape of the BGR pixels `picture` is (rows, columns, 3).
    """
    cv2 = opencv()
    _, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return CompressedImage(
        header=Header(stamp=time_to_msg(stamp), frame_id=frame_id),
        format='jpeg',
        data=array.array('B', data.tobytes()),
    )


def read_camera(path: Path) -> Camera:
    """Return the camera that a calibration file describes.

    Raises ValueError if the file is invalid.
    """
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


def write_camera(path: Path, camera: Camera) -> None:
    """Write a calibration file, which this software and ROS camera drivers can read."""
    plain = len(camera.distortion) <= _MODELS['plumb_bob']
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def table(values: Array) -> dict[str, Any]:
        rows, columns = values.shape
        return {'rows': rows, 'cols': columns, 'data': values.ravel().tolist()}

    content: dict[str, Any] = {
        'image_width': camera.width,
        'image_height': camera.height,
        'camera_name': 'camera',
        'camera_matrix': table(matrix),
        'distortion_model': 'plumb_bob' if plain else 'rational_polynomial',
        'distortion_coefficients': table(np.array([camera.distortion], dtype=np.float64)),
        'rectification_matrix': table(np.eye(3)),
        'projection_matrix': table(np.pad(matrix, ((0, 0), (0, 1)))),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')


def camera_from_msg(message: CameraInfo) -> Camera | None:
    """Return the camera that a message describes, or None if the message has no calibration.

    Raises ValueError if the calibration is invalid.
    """
    if not message.k[0]:
        return None
    return _camera(message.width, message.height, message.distortion_model, message.k, message.d)


def _camera(width: int, height: int, model: str, matrix: Any, distortion: Any) -> Camera:
    numbers = [float(each) for each in matrix]
    if len(numbers) != 9:
        raise ValueError(f'camera matrix has {len(numbers)} numbers; it must have 9')
    if model not in _MODELS and len(distortion):
        raise ValueError(f'distortion_model {model!r} is none of {", ".join(_MODELS)}')
    fx, _, cx, _, fy, cy, *_ = numbers
    return Camera(width, height, (fx, fy), (cx, cy), tuple(map(float, distortion)))
