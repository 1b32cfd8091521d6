# SPDX-License-Identifier: Apache-2.0
"""What is drawn, as the messages that the viewers of ROS show."""

from __future__ import annotations

import array
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseWithCovariance, PoseWithCovarianceStamped, Vector3
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.conversions import NamedChain


class Wall(NamedTuple):
    """Where a wall is."""

    position: float
    """Along the chain [m]."""
    deviation: float
    """Its standard deviation [m]."""
    rotor: float
    """The same place [rotor spacings]."""
    charge: int


def lines_to_msg(
    header: Header, name: str, points: Array, colours: Array, width: float, balls: bool = False
) -> Marker:
    """Lines between each two of the points [m], or balls at them, with a colour a point."""
    return Marker(
        header=header,
        ns=name,
        type=Marker.SPHERE_LIST if balls else Marker.LINE_LIST,
        action=Marker.ADD if len(points) else Marker.DELETE,
        pose=_upright(),
        scale=Vector3(x=width, y=width, z=width) if balls else Vector3(x=width),
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
    """A box of a size [m] about its centre [m], in red, green, blue and opacity [1]."""
    red, green, blue, opacity = colour
    x, y, z = size
    pose = _upright()
    pose.position.x, pose.position.y, pose.position.z = map(float, centre)
    return Marker(
        header=header,
        ns=name,
        id=number,
        type=Marker.CUBE,
        action=Marker.ADD,
        pose=pose,
        scale=Vector3(x=x, y=y, z=z),
        color=ColorRGBA(r=red, g=green, b=blue, a=opacity),
    )


def text_to_msg(
    header: Header,
    name: str,
    place: Sequence[float],
    size: float,
    colour: Sequence[float],
    text: str,
) -> Marker:
    """A text of a size [m] at its place [m], in red, green, blue and opacity [1]."""
    marker = box_to_msg(header, name, 0, place, (0.0, 0.0, size), colour)
    marker.type, marker.text = Marker.TEXT_VIEW_FACING, text
    return marker


def walls_from_msg(message: msg.SolitonState) -> list[Wall]:
    """Walls of a state, from rotor 0 on."""
    return [
        Wall(each.position, each.position_deviation, each.rotor, int(each.charge))
        for each in message.solitons
    ]


def pose_to_msg(header: Header, place: float, deviation: float) -> PoseWithCovarianceStamped:
    """Where something is along the chain [m], with its standard deviation [m]."""
    pose = _upright()
    pose.position.x = place
    covariance = np.zeros((6, 6))
    covariance[0, 0] = deviation**2
    held = PoseWithCovariance(pose=pose, covariance=covariance.ravel())
    return PoseWithCovarianceStamped(header=header, pose=held)


def picture_to_msg(header: Header, pixels: NDArray[np.uint8]) -> Image:
    """A picture of red, green and blue, shape (rows, columns, 3)."""
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
    """Impulse of each rotor [N m s], shape (N,), 0 for those that it does not name."""
    impulses = np.zeros(named.rotors)
    for name, impulse in zip(message.name, message.impulse, strict=False):
        if name in named.numbers:
            impulses[named.numbers[name]] = impulse
    return impulses


def _upright() -> Pose:
    pose = Pose()
    pose.orientation.w = 1.0
    return pose
