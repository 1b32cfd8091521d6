# SPDX-License-Identifier: Apache-2.0
"""What an experiment sees and hears of the nodes that it runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.messages.conversions import chain_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.parameters import declare, refuse_unknown
from soliton_linkage_nodes.runtime.stamps import time_from_msg

_NEAR_EDGE = 2.0
"""How near the soliton comes to an edge to have been there [rotor spacings]; it turns there."""


@dataclass(frozen=True)
class ExperimentParameters:
    """Parameters of the experiment."""

    scenario: str = quantity('flipper', 'name of the experiment and of its bag')
    nudge: float = quantity(10.0, 'speed of the kick that is published on nudge', 'rad/s')
    time_limit: float = quantity(
        60.0, 'time within which the soliton must be back', 's', 1.0, 3600.0
    )


class Observer(Node):
    """Sees the solitons and hears how the nodes are; can nudge the chain."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('experiment', **kwargs)
        self.settings = declare(self, ExperimentParameters)
        refuse_unknown(self)
        self.reports: dict[str, DiagnosticStatus] = {}
        self.states: dict[int, tuple[float, ...]] = {}
        self.rotors = 0
        self.rotor = math.nan
        self.velocity = 0.0
        self._spacing = 1.0
        topic = interfaces.NUDGE
        self.nudge_publisher = self.create_publisher(topic.type, topic.name, topic.qos)
        topic = interfaces.SOLITON_STATE
        self.state_subscription = self.create_subscription(
            topic.type, topic.name, self._on_state, interfaces.whole_stream_qos()
        )
        self._subscribe(interfaces.CHAIN, self._on_chain)
        self._subscribe(interfaces.DIAGNOSTICS, self._on_diagnostics)

    def forget(self) -> None:
        """Begin anew, with what nodes say from now on."""
        self.reports.clear()
        self.states.clear()

    @property
    def informed(self) -> bool:
        """Whether the chain and a state of it have been heard, in whatever order."""
        return self.rotors > 0 and bool(self.states)

    def figures(self, node: str) -> dict[str, str]:
        """Return the figures of a node's latest report."""
        report = self.reports.get(node)
        return {} if report is None else {pair.key: pair.value for pair in report.values}

    def well(self, node: str) -> bool:
        """Whether a node has reported, without a warning."""
        return node in self.reports and self.reports[node].level == DiagnosticStatus.OK

    def _subscribe(self, topic: interfaces.Topic, callback: Callable[[Any], None]) -> Any:
        return self.create_subscription(topic.type, topic.name, callback, topic.qos)

    def _on_chain(self, message: Any) -> None:
        named = chain_from_msg(message)
        self.rotors, self._spacing = named.rotors, named.chain.spacing

    def _on_state(self, message: SolitonState) -> None:
        self.states[time_from_msg(message.header.stamp)] = places(message)
        self.rotor = message.solitons[0].rotor if message.solitons else math.nan
        if message.solitons:
            self.velocity = message.solitons[0].velocity / self._spacing

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.reports[status.name.partition(':')[0]] = status


class RoundTrip:
    """The way of a soliton through the chain and back, as an observer sees it."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._away = False

    def ended(self) -> bool:
        """Whether it is back; raises RuntimeError where the actuator refused the nudge."""
        refusal = self._observer.figures('edge_actuator').get('last refusal')
        if refusal:
            raise RuntimeError(f'edge_actuator refused {refusal}')
        rotor, last = self._observer.rotor, self._observer.rotors - 1
        self._away = self._away or rotor >= last - _NEAR_EDGE
        return self._away and rotor <= _NEAR_EDGE

    @property
    def remark(self) -> str:
        """Where it is and how it goes on, empty where none is seen."""
        rotor, velocity = self._observer.rotor, self._observer.velocity
        if not math.isfinite(rotor):
            return ''
        leg = 'coming back' if self._away else 'going out'
        return f'rotor {rotor:5.1f}  {velocity:+6.1f} rotors/s  {leg}'

    def missing(self) -> str:
        """What to say where it is not back in time."""
        rotor, settings = self._observer.rotor, self._observer.settings
        where = 'none is seen now' if math.isnan(rotor) else f'one is at rotor {rotor:.1f} now'
        return (
            f'no soliton crossed the chain and came back within {settings.time_limit:g} s after a '
            f'nudge of {settings.nudge:g} rad/s, {where}; nudge harder or raise time_limit'
        )


def places(state: SolitonState) -> tuple[float, ...]:
    """Return the rotors at which a state has solitons."""
    return tuple(soliton.rotor for soliton in state.solitons)
