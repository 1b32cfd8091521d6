# SPDX-License-Identifier: Apache-2.0
"""Visualisation node, which draws the chain for RViz, Foxglove and other ROS viewers."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, ClassVar

from std_msgs.msg import String

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.linkage.urdf import JointLimits, robot_description
from soliton_linkage_nodes.messages.chain_source import CHAIN_SOURCE_PARAMETERS, ChainSource
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.subscriptions import create_inbox
from soliton_linkage_nodes.visualisation.observed_chain import ObservedChain
from soliton_linkage_nodes.visualisation.publishers import (
    KymographPublisher,
    MarkerPublisher,
    PosePublisher,
)

_MOST_BUSY = 0.5
"""Pauses limit the drawing to this fraction of the time [1]."""
_LONGEST_REST = 1.0
"""Longest pause after a drawing [s]. The first drawing takes long, as it imports matplotlib."""
_SEARCH_PERIOD = 0.5
"""Time between two searches for new publishers [s]."""


@dataclass(frozen=True)
class VisualisationParameters:
    """Parameters of the visualisation."""

    marker_rate: float = quantity(30.0, 'highest rate of markers and poses', 'Hz', 0.1, 30.0)
    kymograph_rate: float = quantity(10.0, 'highest rate of pictures', 'Hz', 0.1, 30.0)
    kymograph_length: float = quantity(20.0, 'time span of a picture', 's', 1.0, 600.0)
    kick_shown: float = quantity(
        3.0, 'time for which the last kick is shown, 0: until the next kick', 's', 0.0, 86_400.0
    )


class Visualisation(GuardedNode):
    """Node that draws a chain for RViz, Foxglove and other viewers.

    The node subscribes to `joint_states`, `soliton_state`, `last_kick`, `/diagnostics` and, unless
    parameters specify the chain, to `chain`. It publishes `robot_description` (URDF, latched) and
    `/diagnostics`. It also publishes `markers`, `soliton_pose` (the pose of the first soliton) and
    `kymograph`. Each of them is drawn only while it has a subscriber.
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
        """Draw the newest messages, unless drawing pauses after a slow picture."""
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
        """Destroy this node, and the second node that has the subscriptions."""
        self._inbox.destroy_node()
        super().destroy_node()


def main() -> None:
    """Run the visualisation."""
    run(Visualisation)
