# SPDX-License-Identifier: Apache-2.0
"""Topics of what is drawn, which is drawn while somebody subscribes to them."""

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
    lettering_to_msg,
    lines_to_msg,
    picture_to_msg,
    pose_to_msg,
)
from soliton_linkage_nodes.visualisation.figures import figures_of
from soliton_linkage_nodes.visualisation.heard_chain import HeardChain
from soliton_linkage_nodes.visualisation.kymograph import Kymograph
from soliton_linkage_nodes.visualisation.scene import ChainScene

_WALLS = 'solitons'
_OPACITY = 0.4
"""Of a wall, through which the rotors are seen [1]."""


class Outlet:
    """A topic of pictures."""

    name: str

    def __init__(self, publisher: Publisher) -> None:
        """Draw for this publisher."""
        self.publisher = publisher
        self._published = self._counted = 0
        self._subscribers = 0
        self._drawn = -1

    def count_since(self) -> int:
        """How many were published since this was last asked."""
        fresh = self._published - self._counted
        self._counted = self._published
        return fresh

    def _wanted(self, number: int) -> bool:
        """Whether somebody subscribes who has not seen what has this number."""
        subscribers = self.publisher.get_subscription_count()
        more, self._subscribers = subscribers > self._subscribers, subscribers
        if not subscribers or (number == self._drawn and not more):
            return False
        self._drawn = number
        return True

    def _publish(self, message: object) -> None:
        self.publisher.publish(message)
        self._published += 1


class MarkerOutlet(Outlet):
    """The chain in space."""

    name = 'markers'

    def __init__(self, publisher: Publisher, kick_shown: float) -> None:
        """Show a kick for so long after its end [s]."""
        super().__init__(publisher)
        self._kick_shown = kick_shown
        self._scene: ChainScene | None = None
        self._walls = 0
        self._clear = False

    def learn(self, named: NamedChain) -> None:
        """Draw this chain from now on, and nothing of another one."""
        self._clear = self._scene is not None
        self._scene = ChainScene(named.chain)
        self._walls = 0

    def draw(self, heard: HeardChain) -> None:
        """Draw the chain as it is."""
        if self._scene is None or not len(heard.angles) or not self._wanted(heard.frames):
            return
        header = Header(stamp=heard.stamp, frame_id=heard.frame)
        shapes = self._scene.shapes(heard.angles)
        impulses = heard.kick(self._kick_shown)
        if impulses is None:
            impulses = 0 * heard.angles
        shapes.append(self._scene.kick(heard.angles, impulses))
        markers = [lines_to_msg(header, *shape) for shape in shapes]
        markers += self._solitons(header, self._scene, heard)
        scene, figures = self._scene, '\n'.join(figures_of(heard))
        colour = (*shares(GREY), 1.0)
        markers.append(
            lettering_to_msg(header, 'figures', scene.above, scene.lettering, colour, figures)
        )
        if self._clear:
            markers.insert(0, Marker(header=header, action=Marker.DELETEALL))
            self._clear = False
        self._publish(MarkerArray(markers=markers))

    def _solitons(self, header: Header, scene: ChainScene, heard: HeardChain) -> list[Marker]:
        boxes = scene.boxes([(wall.position, wall.deviation) for wall in heard.walls])
        markers = [
            box_to_msg(
                header,
                _WALLS,
                number,
                (box.place, 0.0, 0.0),
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


class PoseOutlet(Outlet):
    """Where the first wall is."""

    name = 'soliton_pose'

    def learn(self, named: NamedChain) -> None:
        """The place of a wall is told without the chain."""

    def draw(self, heard: HeardChain) -> None:
        """Tell the place, where there is a wall that has one."""
        if not heard.walls or not self._wanted(heard.states):
            return
        place, deviation, *_ = heard.walls[0]
        if math.isfinite(place) and math.isfinite(deviation):
            header = Header(stamp=heard.state_stamp, frame_id=heard.frame)
            self._publish(pose_to_msg(header, place, deviation))


class KymographOutlet(Outlet):
    """The last seconds as a picture."""

    name = 'kymograph'

    def __init__(self, publisher: Publisher, length: float, rate: float) -> None:
        """Draw so many seconds, so often at most [Hz]."""
        super().__init__(publisher)
        self._length, self._period = length, 1 / rate
        self._kymograph: Kymograph | None = None
        self._next = 0.0

    def learn(self, named: NamedChain) -> None:
        """Draw this chain from now on."""
        self._kymograph = Kymograph(named.chain, self._length)

    def draw(self, heard: HeardChain) -> None:
        """Keep what is new, and draw what has been kept when it is time."""
        if self._kymograph is None or not len(heard.angles):
            return
        self._kymograph.add(heard.seconds, heard.angles, [wall.rotor for wall in heard.walls])
        if time.monotonic() >= self._next and self._wanted(heard.frames):
            self._next = time.monotonic() + self._period
            header = Header(stamp=heard.stamp, frame_id=heard.frame)
            self._publish(picture_to_msg(header, self._kymograph.picture()))
