# SPDX-License-Identifier: Apache-2.0
"""The visualisation: the chain as RViz, Foxglove and other viewers of ROS show it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, ClassVar

import rclpy
from rclpy.clock import Clock, ClockType
from std_msgs.msg import String

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.linkage.urdf import JointLimits, robot_description
from soliton_linkage_nodes.messages.chain_source import (
    CHAIN_PARAMETERS,
    ChainSource,
    ChainSourceParameters,
)
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import declare, refuse_unknown
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription, newest_of
from soliton_linkage_nodes.visualisation.heard_chain import HeardChain
from soliton_linkage_nodes.visualisation.outlets import KymographOutlet, MarkerOutlet, PoseOutlet

_MOST_BUSY = 0.5
"""Share of the time that drawing may take [1]: a chain of thousands is drawn less often."""
_LONGEST_REST = 1.0
"""After a picture that took long [s]: the first one has to import what it needs."""
_SEARCH_PERIOD = 0.5
"""Between two looks at who publishes [s]."""


@dataclass(frozen=True)
class VisualisationParameters:
    """Parameters of the node."""

    marker_rate: float = quantity(30.0, 'most markers and poses a second', 'Hz', 0.1, 30.0)
    kymograph_rate: float = quantity(10.0, 'most pictures a second', 'Hz', 0.1, 30.0)
    kymograph_length: float = quantity(20.0, 'time that a picture shows', 's', 1.0, 600.0)
    kick_shown: float = quantity(
        3.0,
        'how long the last kick is shown after its end, 0 for until the next',
        's',
        0.0,
        86_400.0,
    )


class Visualisation(GuardedNode):
    """Draws a chain for RViz, Foxglove and the like: what nobody subscribes to is not drawn.

    Subscribes to `joint_states`, `soliton_state`, `last_kick`, `/diagnostics` and, unless told the
    chain by parameters, to `chain`. Publishes `robot_description` (URDF, latched), `markers`,
    `soliton_pose` of the first wall, `kymograph` of the last seconds, and `/diagnostics`.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        VisualisationParameters: '',
        JointLimits: 'limits.',
        ChainSourceParameters: '',
        **CHAIN_PARAMETERS,
    }

    def __init__(self, **kwargs: Any) -> None:
        """Listen to a chain, and wait for somebody who looks."""
        super().__init__('visualisation', **kwargs)
        self.settings = settings = declare(self, VisualisationParameters)
        self._limits = declare(self, JointLimits, 'limits.')
        self._inbox = rclpy.create_node(
            '_visualisation_inbox',
            namespace=self.get_namespace(),
            context=self.context,
            cli_args=[],
            enable_rosout=False,
            start_parameter_services=False,
        )
        self.heard = HeardChain(*map(self._newest, _HEARD))
        self._description = interfaces.ROBOT_DESCRIPTION.publisher(self)
        self._outlets = (
            MarkerOutlet(interfaces.MARKERS.publisher(self), settings.kick_shown),
            PoseOutlet(interfaces.SOLITON_POSE.publisher(self)),
            KymographOutlet(
                interfaces.KYMOGRAPH.publisher(self),
                settings.kymograph_length,
                settings.kymograph_rate,
            ),
        )
        self._busy, self._rest_until, self._searched = 0.0, 0.0, 0.0
        self._reported = (time.monotonic(), 0.0)
        self.diagnostics = Diagnostics(self, 'drawing', self._report)
        self._source = ChainSource(self, self.diagnostics, self._on_chain)
        refuse_unknown(self)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1 / settings.marker_rate, self._draw, clock=steady)
        self.get_logger().info(f'drawing {self._source.in_words} for whoever subscribes')

    def _newest(self, topic: interfaces.Topic) -> AdaptiveSubscription:
        if topic is interfaces.DIAGNOSTICS:
            return AdaptiveSubscription(self._inbox, topic)
        name = self.resolve_topic_name(topic.name)
        return newest_of(self._inbox, topic, name, raw=topic is interfaces.JOINT_STATES)

    def _on_chain(self, named: NamedChain) -> None:
        if named == self.heard.named:
            return
        text = robot_description(named.chain, named.joint_names, self._limits)
        self._description.publish(String(data=text))
        self.heard.learn(named)
        for outlet in self._outlets:
            outlet.learn(named)

    def _draw(self) -> None:
        """Draw what is newest, unless the last time has taken too long."""
        begin = time.monotonic()
        if begin < self._rest_until:
            return
        if begin - self._searched >= _SEARCH_PERIOD:
            self._searched = begin
            self.heard.adapt()
        try:
            self.heard.take()
        except ValueError as error:
            self.diagnostics.refuse('joint_states', error)
            return
        for outlet in self._outlets:
            outlet.draw(self.heard)
        took = time.monotonic() - begin
        self._busy += took
        self._rest_until = begin + min(took / _MOST_BUSY, took + _LONGEST_REST)

    def _report(self) -> Report:
        now = time.monotonic()
        before, busy_before = self._reported
        self._reported = (now, self._busy)
        values: dict[str, Any] = {
            'frames': self.heard.frames,
            'share of time drawing': (self._busy - busy_before) / (now - before),
        }
        for outlet in self._outlets:
            values[f'{outlet.name} [Hz]'] = outlet.count_since() / (now - before)
            values[f'{outlet.name}: subscribers'] = outlet.publisher.get_subscription_count()
        if self.heard.named is None:
            return Report('waiting for the topic chain', values, warning=True)
        if self.heard.age > _SEARCH_PERIOD:
            return Report('waiting for joint_states', values, warning=True)
        return Report('drawing', values)

    def destroy_node(self) -> None:
        """Stop listening, then go."""
        self._inbox.destroy_node()
        super().destroy_node()


_HEARD = (
    interfaces.JOINT_STATES,
    interfaces.SOLITON_STATE,
    interfaces.LAST_KICK,
    interfaces.DIAGNOSTICS,
)


def main() -> None:
    """Draw until it is told to stop."""
    run(Visualisation)
