# SPDX-License-Identifier: Apache-2.0
"""Show the chain in one line of the terminal, with the position of the soliton.

The chain comes from the topics chain and joint_states. The position [rotor spacings] and velocity
of the first soliton come from soliton_state. If no node publishes chain, add --ros-args -p
chain_from:=parameters, and specify the parameters chain.* or a parameter file.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from soliton_linkage.command_line import PlainParser
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.messages.chain_source import ChainSourceParameters, declare_chain
from soliton_linkage_nodes.programs.chain_line import LEGEND, ChainLine
from soliton_linkage_nodes.programs.command_line import parse_own_arguments
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.start import INTERRUPTED

_PERIOD = 0.1
"""Time between two drawings [s]."""
_LONGEST_SILENCE = 1.0
"""A topic without messages for this time is reported as stopped [s]."""
_STARTED_BY = {
    interfaces.CHAIN.name: 'simulator',
    interfaces.JOINT_STATES.name: 'simulator',
    interfaces.SOLITON_STATE.name: 'soliton_analyser',
}


class WatchSoliton(Node):
    """Node that draws the chain and the first soliton in one line of the terminal."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('watch_soliton', **kwargs)
        source, given = declare(self, ChainSourceParameters), declare_chain(self)
        self._line = ChainLine(self, source.joint_names)
        self._received: tuple[bytes, float] | None = None
        if source.chain_from == 'parameters':
            self._line.use(given)
        interfaces.SOLITON_STATE.subscribe(self, self._on_state, raw=True)
        reject_unknown(self)
        self.create_timer(_PERIOD, self._draw, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy_node(self) -> None:
        """End the line and destroy the node."""
        self._line.end()
        super().destroy_node()

    def _on_state(self, serialized: Any) -> None:
        self._received = (serialized, time.monotonic())

    def _draw(self) -> None:
        unseen = [] if self._received else [interfaces.SOLITON_STATE.name]
        missing = [*self._line.missing, *unseen]
        if missing or self._received is None:
            nodes = ', '.join(dict.fromkeys(_STARTED_BY[name] for name in missing))
            self._line.show((), f'no {", ".join(missing)} yet; start {nodes}')
            return
        serialized, received_at = self._received
        now = time.monotonic()
        for name, silence in (
            (interfaces.JOINT_STATES.name, now - self._line.received_at),
            (interfaces.SOLITON_STATE.name, now - received_at),
        ):
            if silence > _LONGEST_SILENCE:
                self._line.show((), f'no {name} for {silence:.0f} s')
                return
        state: SolitonState = deserialize_message(serialized, SolitonState)
        rotors = [soliton.rotor for soliton in state.solitons]
        remark = f'no soliton, {state.motion_name}'
        if state.solitons:
            speed = state.solitons[0].velocity / self._line.spacing
            remark = f'rotor {rotors[0]:6.2f}  {speed:+7.2f} rotors/s'
        self._line.show(rotors, remark)


def main() -> None:
    """Show the soliton until Ctrl-C."""
    parser = PlainParser(
        prog='watch_soliton', description=__doc__, epilog=f'Marks: {LEGEND}. Stop with Ctrl-C.'
    )
    parse_own_arguments(parser)
    try:
        run(WatchSoliton)
    except SystemExit as end:
        # Only a signal ends the program without an error.
        sys.exit(end.code or INTERRUPTED)
