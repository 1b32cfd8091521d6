# SPDX-License-Identifier: Apache-2.0
"""Node that draws the chain for RViz, Foxglove and other ROS viewers."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, ClassVar

from rclpy.publisher import Publisher
from std_msgs.msg import Header, String
from visualization_msgs.msg import Marker, MarkerArray

from soliton_linkage.colours import GREY, RED, shares
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.linkage.urdf import JointLimits, robot_description
from soliton_linkage_nodes.messages import marker_conversions as conversions
from soliton_linkage_nodes.messages.chain_source import CHAIN_SOURCE_PARAMETERS, ChainSource
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown
from soliton_linkage_nodes.runtime.subscriptions import create_inbox
from soliton_linkage_nodes.visualisation.kymograph import Kymograph
from soliton_linkage_nodes.visualisation.observed_chain import ObservedChain
from soliton_linkage_nodes.visualisation.scene import ChainScene

_MOST_BUSY = 0.5
"""Largest fraction of the time that is spent on drawing [1]. After a drawing, the node pauses for
as long as the drawing took, but at most for `_LONGEST_REST`. The fraction is therefore larger if a
drawing takes longer than 1 s."""
_LONGEST_REST = 1.0
"""Longest pause after a drawing [s]. Otherwise a long pause would follow the first drawing, which
takes long because it imports matplotlib."""
_SEARCH_PERIOD = 0.5
"""Time between two searches for new publishers [s]."""


@dataclass(frozen=True)
class VisualisationParameters:
    """Parameters of the visualisation node."""

    marker_rate: float = quantity(30.0, 'highest rate of markers and poses', 'Hz', 0.1, 30.0)
    kymograph_rate: float = quantity(10.0, 'highest rate of pictures', 'Hz', 0.1, 30.0)
    kymograph_length: float = quantity(20.0, 'time span of a picture', 's', 1.0, 600.0)
    kick_shown: float = quantity(
        3.0, 'time for which the last kick is shown, 0: until the next kick', 's', 0.0, 86_400.0
    )


_WALLS = 'solitons'
_OPACITY = 0.4
"""Opacity of the box around a soliton [1]. The rotors in the box remain visible."""


class DrawingPublisher:
    """Base class for publishers of a drawing of the chain."""

    name: str

    def __init__(self, publisher: Publisher) -> None:
        self.publisher = publisher
        self.published = 0
        self._subscribers = 0
        self._drawn = -1

    def set_chain(self, named: NamedChain) -> None:
        """Set the chain to draw, and delete the drawing of the previous chain."""

    def _wanted(self, number: int) -> bool:
        """Return whether a subscriber still needs a drawing of the newest message.

        `number` is the number of messages that have arrived. A drawing is needed if this number
        has changed since the last drawing, or if there are more subscribers than at the last call.
        """
        subscribers = self.publisher.get_subscription_count()
        more, self._subscribers = subscribers > self._subscribers, subscribers
        if not subscribers or (number == self._drawn and not more):
            return False
        self._drawn = number
        return True

    def _publish(self, message: object) -> None:
        self.publisher.publish(message)
        self.published += 1


class MarkerPublisher(DrawingPublisher):
    """Publisher of markers that show the chain in space."""

    name = 'markers'

    def __init__(self, publisher: Publisher, kick_shown: float) -> None:
        """Set `kick_shown`, the time for which a kick is shown after its end [s]."""
        super().__init__(publisher)
        self._kick_shown = kick_shown
        self._scene: ChainScene | None = None
        self._walls = 0
        self._clear = False

    def set_chain(self, named: NamedChain) -> None:
        """Set the chain to draw, and delete the markers of the previous chain."""
        self._clear = self._scene is not None
        self._scene = ChainScene(named.chain)
        self._walls = 0

    def draw(self, chain: ObservedChain) -> None:
        """Publish markers for the newest messages if a subscriber has not received them yet."""
        scene = self._scene
        if scene is None or not len(chain.angles) or not self._wanted(chain.frames):
            return
        header = Header(stamp=chain.stamp, frame_id=chain.frame)
        shapes = scene.shapes(chain.angles)
        impulses = chain.kick(self._kick_shown)
        if impulses is None:
            impulses = 0 * chain.angles
        shapes.append(scene.kick(chain.angles, impulses))
        markers = [conversions.lines_to_msg(header, *shape) for shape in shapes]
        markers += self._solitons(header, scene, chain)
        size, colour = scene.lettering, (*shares(GREY), 1.0)
        markers.append(
            conversions.text_to_msg(header, 'figures', scene.above, size, colour, chain.describe())
        )
        if self._clear:
            markers.insert(0, Marker(header=header, action=Marker.DELETEALL))
            self._clear = False
        self._publish(MarkerArray(markers=markers))

    def _solitons(self, header: Header, scene: ChainScene, chain: ObservedChain) -> list[Marker]:
        boxes = scene.boxes([(wall.position, wall.position_deviation) for wall in chain.walls])
        colour, markers = (*shares(RED), _OPACITY), []
        for number, box in enumerate(boxes):
            centre, size = (box.position, 0.0, 0.0), (box.length, scene.width, box.height)
            markers.append(conversions.box_to_msg(header, _WALLS, number, centre, size, colour))
        gone, self._walls = range(len(boxes), self._walls), len(boxes)
        action = Marker.DELETE
        return markers + [Marker(header=header, ns=_WALLS, id=n, action=action) for n in gone]


class PosePublisher(DrawingPublisher):
    """Publisher of the position of the first soliton, which is the one nearest to rotor 0."""

    name = 'soliton_pose'

    def draw(self, chain: ObservedChain) -> None:
        """Publish the pose of the first soliton if a subscriber has not received it yet."""
        if not chain.walls or not self._wanted(chain.states):
            return
        position, deviation = chain.walls[0].position, chain.walls[0].position_deviation
        if math.isfinite(position) and math.isfinite(deviation):
            header = Header(stamp=chain.state_stamp, frame_id=chain.frame)
            self._publish(conversions.pose_to_msg(header, position, deviation))


class KymographPublisher(DrawingPublisher):
    """Publisher of a picture of the recent displacements over time."""

    name = 'kymograph'

    def __init__(self, publisher: Publisher, length: float, rate: float) -> None:
        """Set the time span of a picture, `length` [s], and the highest rate of pictures [Hz]."""
        super().__init__(publisher)
        self._length, self._period = length, 1 / rate
        self._kymograph: Kymograph | None = None
        self._next = 0.0

    def set_chain(self, named: NamedChain) -> None:
        """Set the chain to draw, and start with an empty picture."""
        self._kymograph = Kymograph(named.chain, self._length)

    def draw(self, chain: ObservedChain) -> None:
        """Add the newest frame to the picture, and publish the picture when it is due."""
        if self._kymograph is None or not len(chain.angles):
            return
        self._kymograph.add(chain.seconds, chain.angles, [wall.rotor for wall in chain.walls])
        if time.monotonic() >= self._next and self._wanted(chain.frames):
            self._next = time.monotonic() + self._period
            header = Header(stamp=chain.stamp, frame_id=chain.frame)
            self._publish(conversions.picture_to_msg(header, self._kymograph.picture()))


class Visualisation(GuardedNode):
    """Node that draws a chain for RViz, Foxglove and other viewers.

    The node subscribes to `joint_states`, `soliton_state`, `last_kick`, `/diagnostics` and, unless
    parameters specify the chain, to `chain`. It publishes `robot_description` (URDF, latched) and
    `/diagnostics`. It also publishes `markers`, `soliton_pose` (pose of the first soliton) and
    `kymograph`. It draws each of these three only while the topic has a subscriber.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        VisualisationParameters: '',
        JointLimits: 'limits.',
        **CHAIN_SOURCE_PARAMETERS,
    }

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('visualisation', **kwargs)
        self.settings = settings = declare(self, VisualisationParameters)
        self._limits = declare(self, JointLimits, 'limits.')
        self._inbox = create_inbox(self)
        self.observed = ObservedChain(self._inbox, self)
        self._description = interfaces.ROBOT_DESCRIPTION.publisher(self)
        length, rate = settings.kymograph_length, settings.kymograph_rate
        self._drawings = (
            MarkerPublisher(interfaces.MARKERS.publisher(self), settings.kick_shown),
            PosePublisher(interfaces.SOLITON_POSE.publisher(self)),
            KymographPublisher(interfaces.KYMOGRAPH.publisher(self), length, rate),
        )
        self._busy, self._rest_until, self._searched = 0.0, 0.0, 0.0
        self._increments = Increments()
        self.diagnostics = Diagnostics(self, 'drawing', self._report)
        self._source = ChainSource(self, self.diagnostics, self._on_chain)
        reject_unknown(self)
        self.create_timer(1 / settings.marker_rate, self._draw)
        self.get_logger().info(f'drawing {self._source.description} for subscribers')

    def _on_chain(self, named: NamedChain) -> None:
        if named == self.observed.named:
            return
        text = robot_description(named.chain, named.joint_names, self._limits)
        self._description.publish(String(data=text))
        self.observed.set_chain(named)
        for drawing in self._drawings:
            drawing.set_chain(named)

    def _draw(self) -> None:
        begin = time.monotonic()
        if begin < self._rest_until:
            return
        if begin - self._searched >= _SEARCH_PERIOD:
            self._searched = begin
            self.observed.adapt()
        try:
            self.observed.take()
        except ValueError as error:
            self.diagnostics.reject('joint_states', error)
            return
        for drawing in self._drawings:
            drawing.draw(self.observed)
        took = time.monotonic() - begin
        self._busy += took
        self._rest_until = begin + min(took / _MOST_BUSY, took + _LONGEST_REST)

    def _report(self) -> Report:
        published = (drawing.published for drawing in self._drawings)
        seconds, busy, *new = self._increments.take(self._busy, *published)
        values: dict[str, Any] = {
            'frames': self.observed.frames,
            'share of time drawing': busy / seconds,
        }
        for drawing, messages in zip(self._drawings, new, strict=True):
            values[f'{drawing.name} [Hz]'] = messages / seconds
            values[f'{drawing.name}: subscribers'] = drawing.publisher.get_subscription_count()
        if self.observed.named is None:
            return Report('waiting for the topic chain', values, warning=True)
        if self.observed.age > _SEARCH_PERIOD:
            return Report('waiting for joint_states', values, warning=True)
        return Report('drawing', values)

    def destroy_node(self) -> None:
        """Destroy this node and the second node, which has the subscriptions."""
        self._inbox.destroy_node()
        super().destroy_node()
