# SPDX-License-Identifier: Apache-2.0
"""Node that drives the chain of an experiment, and receives soliton states and diagnostics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs.msg import EdgeCommand, SolitonState
from soliton_linkage_nodes.messages.conversions import chain_from_msg
from soliton_linkage_nodes.messages.view_conversions import NodeReport, reports_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown
from soliton_linkage_nodes.runtime.stamps import time_from_msg

_NEAR_EDGE = 2.0
"""A soliton that is closer to an edge than this counts as having reached it [rotor spacings]."""


@dataclass(frozen=True)
class ExperimentParameters:
    """Parameters of the experiment."""

    scenario: str = quantity('flipper', 'name of the experiment and of its bag')
    nudge: float = quantity(10.0, 'speed of the kick that is published on nudge', 'rad/s')
    burst_cycles: float = quantity(
        0.0, 'periods of a torque burst on rotor 0 in place of a nudge; 0: none', '', 0.0, 1e6
    )
    burst_frequency: float = quantity(0.0, 'angular frequency of the burst', 'rad/s', 0.0, 1e6)
    burst_torque: float = quantity(0.0, 'amplitude of the burst', 'N m', 0.0, 1e6)
    end: str = quantity(
        'return',
        'end of the experiment: the return of the soliton, or the time limit',
        choices=('return', 'time'),
    )
    time_limit: float = quantity(
        60.0, 'time limit for the return of the soliton', 's', 1.0, 3600.0
    )


class Observer(Node):
    """Node that receives soliton states and diagnostics, and can drive the chain."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('experiment', **kwargs)
        self.settings = declare(self, ExperimentParameters)
        reject_unknown(self)
        self.reports: dict[str, NodeReport] = {}
        self.states: dict[int, tuple[float, ...]] = {}
        self.rotors = 0
        self.rotor = math.nan
        self.rotors_of_walls: list[float] = []
        self.velocity = 0.0
        self._spacing = 1.0
        self.nudge_publisher = interfaces.NUDGE.publisher(self)
        self.edge_publisher = interfaces.EDGE_COMMAND.publisher(self)
        states = replace(interfaces.SOLITON_STATE, qos=interfaces.lossless_stream_qos())
        states.subscribe(self, self._on_state)
        interfaces.CHAIN.subscribe(self, self._on_chain)
        interfaces.DIAGNOSTICS.subscribe(self, self._on_diagnostics)

    def send_burst(self) -> None:
        """Publish the burst of torque on rotor 0 that the parameters specify."""
        command = EdgeCommand(
            edge=EdgeCommand.FIRST,
            kind=EdgeCommand.WAVEFORM,
            value=self.settings.burst_torque,
            frequency=self.settings.burst_frequency,
            cycles=self.settings.burst_cycles,
            window=EdgeCommand.HANN,
        )
        self.edge_publisher.publish(command)

    def forget(self) -> None:
        """Discard all reports and states received so far."""
        self.reports.clear()
        self.states.clear()

    @property
    def stamp(self) -> int:
        """Stamp of the newest state [ns], or 0 before the first state."""
        return next(reversed(self.states), 0)

    @property
    def informed(self) -> bool:
        """Whether both the chain and a soliton state have been received."""
        return self.rotors > 0 and bool(self.states)

    def figures(self, node: str) -> Mapping[str, str]:
        """Return the values in the latest report of a node, {} without a report."""
        return self.reports[node].figures if node in self.reports else {}

    def well(self, node: str) -> bool:
        """Return whether a node has reported, and its last report is neither warning nor error."""
        return node in self.reports and self.reports[node].ok

    def _on_chain(self, message: Any) -> None:
        named = chain_from_msg(message)
        self.rotors, self._spacing = named.rotors, named.chain.spacing

    def _on_state(self, message: SolitonState) -> None:
        self.states[time_from_msg(message.header.stamp)] = soliton_sites(message)
        self.rotors_of_walls = [wall.rotor for wall in message.solitons]
        self.rotor = next(iter(self.rotors_of_walls), math.nan)
        if message.solitons:
            self.velocity = message.solitons[0].velocity / self._spacing

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for report in reports_from_msg(message):
            self.reports[report.node.rpartition('/')[2]] = report


class RoundTrip:
    """Motion of a soliton from the first edge to the last edge of the chain and back."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._away = False

    def ended(self) -> bool:
        """Return whether the soliton has returned; RuntimeError if the nudge was rejected."""
        rejection = self._observer.figures('edge_actuator').get('last rejection')
        if rejection:
            raise RuntimeError(f'edge_actuator rejected {rejection}')
        rotor, last = self._observer.rotor, self._observer.rotors - 1
        self._away = self._away or rotor >= last - _NEAR_EDGE
        return self._away and rotor <= _NEAR_EDGE

    @property
    def remark(self) -> str:
        """Text with position, velocity and direction of the soliton, or '' without a soliton."""
        rotor, velocity = self._observer.rotor, self._observer.velocity
        if not math.isfinite(rotor):
            return ''
        leg = 'coming back' if self._away else 'going out'
        return f'rotor {rotor:5.1f}  {velocity:+6.1f} rotors/s  {leg}'

    def missing(self) -> str:
        """Return the error message for the case that the soliton has not returned in time."""
        rotor, settings = self._observer.rotor, self._observer.settings
        at = f'the soliton is at rotor {rotor:.1f} now'
        where = 'no soliton is visible now' if math.isnan(rotor) else at
        return (
            f'no soliton crossed the chain and came back within {settings.time_limit:g} s after a '
            f'nudge of {settings.nudge:g} rad/s; {where}; raise the parameter nudge or time_limit'
        )


def soliton_sites(state: SolitonState) -> tuple[float, ...]:
    """Return the site coordinate of each soliton in a state [rotor spacings]."""
    return tuple(soliton.rotor for soliton in state.solitons)
