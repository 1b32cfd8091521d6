# SPDX-License-Identifier: Apache-2.0
"""Pictures of cameras, as messages, to arrays of blue, green and red, and back."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from soliton_linkage_nodes.runtime.stamps import time_to_msg

_QUALITY = 80
"""Of JPEG [1]: letters are sharp, and a picture of 1280 x 720 pixels has some 150 kB."""

_CHANNELS = {
    'bgr8': (3, [0, 1, 2]),
    '8UC3': (3, [0, 1, 2]),
    'rgb8': (3, [2, 1, 0]),
    'bgra8': (4, [0, 1, 2]),
    'rgba8': (4, [2, 1, 0]),
    'mono8': (1, [0]),
    '8UC1': (1, [0]),
}
"""Bytes of a pixel, and which of them are blue, green and red."""
_BEGIN_OF_JPEG = b'\xff\xd8\xff'


def picture_from_msg(message: Image) -> NDArray[np.uint8]:
    """Blue, green and red, (height, width, 3), or grey, (height, width).

    Raises ValueError for another encoding, and for fewer bytes than it has pixels.
    """
    if message.encoding not in _CHANNELS:
        raise ValueError(
            f'encoding {message.encoding!r} is none of {", ".join(_CHANNELS)}; convert the '
            'pictures, or set what the camera sends'
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
    """Bytes of a JPEG; ValueError where it is none, or has more than so many."""
    data = bytes(message.data)
    if len(data) > most:
        raise ValueError(f'a picture of {len(data)} bytes is above {most}; send smaller ones')
    if not data.startswith(_BEGIN_OF_JPEG):
        raise ValueError(f'{len(data)} bytes of format {message.format!r} are no JPEG; send jpeg')
    return data


def picture_from_compressed_msg(cv2: Any, message: CompressedImage) -> NDArray[np.uint8]:
    """Blue, green and red, (height, width, 3), by OpenCV; ValueError where it cannot."""
    data = np.frombuffer(message.data, dtype=np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if picture is None:
        raise ValueError(
            f'{len(data)} bytes of format {message.format!r} are no picture; send jpeg or png'
        )
    return np.asarray(picture)


def picture_to_compressed_msg(
    cv2: Any, stamp: int, frame_id: str, picture: NDArray[np.uint8]
) -> CompressedImage:
    """JPEG, by OpenCV, of blue, green and red, (height, width, 3), with a stamp [ns]."""
    _, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return CompressedImage(
        header=Header(stamp=time_to_msg(stamp), frame_id=frame_id),
        format='jpeg',
        data=array.array('B', data.tobytes()),
    )
