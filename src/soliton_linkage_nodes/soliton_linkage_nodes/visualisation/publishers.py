# SPDX-License-Identifier: Apache-2.0
"""Publishers of markers, pose and kymograph, which draw only for subscribers."""

from __future__ import annotations

import math
import time

from rclpy.publisher import Publisher
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from soliton_linkage.colours import GREY, RED, shares
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.messages.marker_conversions import (
    box_to_msg,
    lines_to_msg,
    picture_to_msg,
    pose_to_msg,
    text_to_msg,
)
from soliton_linkage_nodes.visualisation.kymograph import Kymograph
from soliton_linkage_nodes.visualisation.observed_chain import ObservedChain
from soliton_linkage_nodes.visualisation.scene import ChainScene

_WALLS = 'solitons'
_OPACITY = 0.4
"""Opacity of the box of a soliton [1], so that its rotors are visible."""


class DrawingPublisher:
    """Publisher of drawings of a chain."""

    name: str

    def __init__(self, publisher: Publisher) -> None:
        """Draw for this publisher."""
        self.publisher = publisher
        self._published = self._counted = 0
        self._subscribers = 0
        self._drawn = -1

    def count_since(self) -> int:
        """Return the number of messages published since the last call."""
        fresh = self._published - self._counted
        self._counted = self._published
        return fresh

    def _wanted(self, number: int) -> bool:
        """Return whether a subscriber exists and drawing `number` is not published yet."""
        subscribers = self.publisher.get_subscription_count()
        more, self._subscribers = subscribers > self._subscribers, subscribers
        if not subscribers or (number == self._drawn and not more):
            return False
        self._drawn = number
        return True

    def _publish(self, message: object) -> None:
        self.publisher.publish(message)
        self._published += 1


class MarkerPublisher(DrawingPublisher):
    """Publisher of markers that show the chain in space."""

    name = 'markers'

    def __init__(self, publisher: Publisher, kick_shown: float) -> None:
        """Show a kick for `kick_shown` [s] after its end."""
        super().__init__(publisher)
        self._kick_shown = kick_shown
        self._scene: ChainScene | None = None
        self._walls = 0
        self._clear = False

    def learn(self, named: NamedChain) -> None:
        """Draw this chain from now on."""
        self._clear = self._scene is not None
        self._scene = ChainScene(named.chain)
        self._walls = 0

    def draw(self, chain: ObservedChain) -> None:
        """Publish markers of the present chain."""
        scene = self._scene
        if scene is None or not len(chain.angles) or not self._wanted(chain.frames):
            return
        header = Header(stamp=chain.stamp, frame_id=chain.frame)
        shapes = scene.shapes(chain.angles)
        impulses = chain.kick(self._kick_shown)
        if impulses is None:
            impulses = 0 * chain.angles
        shapes.append(scene.kick(chain.angles, impulses))
        markers = [lines_to_msg(header, *shape) for shape in shapes]
        markers += self._solitons(header, scene, chain)
        colour = (*shares(GREY), 1.0)
        markers.append(
            text_to_msg(header, 'figures', scene.above, scene.lettering, colour, chain.describe())
        )
        if self._clear:
            markers.insert(0, Marker(header=header, action=Marker.DELETEALL))
            self._clear = False
        self._publish(MarkerArray(markers=markers))

    def _solitons(self, header: Header, scene: ChainScene, chain: ObservedChain) -> list[Marker]:
        boxes = scene.boxes([(wall.position, wall.deviation) for wall in chain.walls])
        markers = [
            box_to_msg(
                header,
                _WALLS,
                number,
                (box.position, 0.0, 0.0),
                (box.length, scene.width, box.height),
                (*shares(RED), _OPACITY),
            )
            for number, box in enumerate(boxes)
        ]
        gone = range(len(boxes), self._walls)
        self._walls = len(boxes)
        return markers + [
            Marker(header=header, ns=_WALLS, id=number, action=Marker.DELETE) for number in gone
        ]


class PosePublisher(DrawingPublisher):
    """Publisher of the position of the first soliton."""

    name = 'soliton_pose'

    def learn(self, named: NamedChain) -> None:
        """Do nothing, because the pose does not depend on the chain."""

    def draw(self, chain: ObservedChain) -> None:
        """Publish the pose, if there is a soliton with a position."""
        if not chain.walls or not self._wanted(chain.states):
            return
        position, deviation, *_ = chain.walls[0]
        if math.isfinite(position) and math.isfinite(deviation):
            header = Header(stamp=chain.state_stamp, frame_id=chain.frame)
            self._publish(pose_to_msg(header, position, deviation))


class KymographPublisher(DrawingPublisher):
    """Publisher of the last seconds as a picture."""

    name = 'kymograph'

    def __init__(self, publisher: Publisher, length: float, rate: float) -> None:
        """Draw a time span [s] at most at a rate [Hz]."""
        super().__init__(publisher)
        self._length, self._period = length, 1 / rate
        self._kymograph: Kymograph | None = None
        self._next = 0.0

    def learn(self, named: NamedChain) -> None:
        """Draw this chain from now on."""
        self._kymograph = Kymograph(named.chain, self._length)

    def draw(self, chain: ObservedChain) -> None:
        """Keep the new frame, and publish the picture when it is due."""
        if self._kymograph is None or not len(chain.angles):
            return
        self._kymograph.add(chain.seconds, chain.angles, [wall.rotor for wall in chain.walls])
        if time.monotonic() >= self._next and self._wanted(chain.frames):
            self._next = time.monotonic() + self._period
            header = Header(stamp=chain.stamp, frame_id=chain.frame)
            self._publish(picture_to_msg(header, self._kymograph.picture()))
