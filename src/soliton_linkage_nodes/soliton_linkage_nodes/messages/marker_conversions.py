# SPDX-License-Identifier: Apache-2.0
"""Creation of the messages that ROS viewers display, and reading of the displayed quantities."""

from __future__ import annotations

import array
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseWithCovariance, PoseWithCovarianceStamped, Vector3
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import NamedChain


def lines_to_msg(
    header: Header, name: str, points: Array, colours: Array, width: float, spheres: bool = False
) -> Marker:
    """Return a marker that consists of lines or, if `spheres` is set, of spheres.

    The first line connects points 0 and 1, the second line connects points 2 and 3, and so on.
    `points` [m] has shape (points, 3), and `colours` (RGBA, 0 to 1) has shape (points, 4). `width`
    is the width of a line or the diameter of a sphere [m].
    """
    return Marker(
        header=header,
        ns=name,
        type=Marker.SPHERE_LIST if spheres else Marker.LINE_LIST,
        action=Marker.ADD if len(points) else Marker.DELETE,
        pose=_upright(),
        scale=Vector3(x=width, y=width, z=width) if spheres else Vector3(x=width),
        points=[Point(x=x, y=y, z=z) for x, y, z in points.tolist()],
        colors=[ColorRGBA(r=r, g=g, b=b, a=a) for r, g, b, a in colours.tolist()],
    )


def box_to_msg(
    header: Header,
    name: str,
    number: int,
    centre: Sequence[float],
    size: Sequence[float],
    colour: Sequence[float],
) -> Marker:
    """Return a box marker with a centre [m], a size along each axis [m] and an RGBA colour."""
    pose = _upright()
    pose.position.x, pose.position.y, pose.position.z = map(float, centre)
    return Marker(
        header=header,
        ns=name,
        id=number,
        type=Marker.CUBE,
        action=Marker.ADD,
        pose=pose,
        scale=Vector3(**dict(zip('xyz', size, strict=True))),
        color=ColorRGBA(**dict(zip('rgba', colour, strict=True))),
    )


def text_to_msg(
    header: Header,
    name: str,
    position: Sequence[float],
    size: float,
    colour: Sequence[float],
    text: str,
) -> Marker:
    """Return a marker that shows a text at `position` [m] in letters of the height `size` [m]."""
    marker = box_to_msg(header, name, 0, position, (0.0, 0.0, size), colour)
    marker.type, marker.text = Marker.TEXT_VIEW_FACING, text
    return marker


def pose_to_msg(header: Header, position: float, deviation: float) -> PoseWithCovarianceStamped:
    """Return the pose of a point on the x axis from its position and standard deviation [m]."""
    pose = _upright()
    pose.position.x = position
    covariance = np.zeros((6, 6))
    covariance[0, 0] = deviation**2
    estimate = PoseWithCovariance(pose=pose, covariance=covariance.ravel())
    return PoseWithCovarianceStamped(header=header, pose=estimate)


def picture_to_msg(header: Header, pixels: NDArray[np.uint8]) -> Image:
    """Return an image message from RGB pixels, shape (rows, columns, 3)."""
    rows, columns, colours = pixels.shape
    return Image(
        header=header,
        height=rows,
        width=columns,
        encoding='rgb8',
        step=columns * colours,
        data=array.array('B', pixels.tobytes()),
    )


def kick_from_msg(named: NamedChain, message: msg.LastKick) -> Array:
    """Return the impulse that each rotor received in a kick [N m s], shape (N,)."""
    impulses = np.zeros(named.rotors)
    for name, impulse in zip(message.name, message.impulse, strict=False):
        if name in named.numbers:
            impulses[named.numbers[name]] = impulse
    return impulses


def _upright() -> Pose:
    pose = Pose()
    pose.orientation.w = 1.0
    return pose
