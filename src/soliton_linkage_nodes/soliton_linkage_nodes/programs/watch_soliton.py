# SPDX-License-Identifier: Apache-2.0
"""Where the soliton is, live in the terminal."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from soliton_linkage.progress import ProgressLine
from soliton_linkage_msgs.msg import Chain, SolitonState
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.process import run


class WatchSoliton(Node):
    """Shows the first soliton of `soliton_state` on a line; `chain` tells how long it is."""

    def __init__(self, **kwargs: Any) -> None:
        """Listen."""
        super().__init__('watch_soliton', **kwargs)
        self._line = ProgressLine('rotor', 0, bar_of_place=True)
        self._spacing = 1.0
        for topic, callback in (
            (interfaces.CHAIN, self._on_chain),
            (interfaces.SOLITON_STATE, self._on_state),
        ):
            self.create_subscription(topic.type, topic.name, callback, topic.qos)

    def destroy_node(self) -> None:
        """Leave the line as it is."""
        self._line.end('')
        super().destroy_node()

    def _on_chain(self, message: Chain) -> None:
        self._line.total = len(message.joint_names) - 1
        self._spacing = message.spacing

    def _on_state(self, message: SolitonState) -> None:
        if not message.solitons:
            self._line.show(0, f'no soliton, {message.motion_name}')
            return
        first = message.solitons[0]
        speed = first.velocity / self._spacing
        self._line.show(first.rotor, f'{first.rotor:6.2f}  {speed:+7.2f} rotors/s')


def main() -> None:
    """Show the soliton until told to stop."""
    run(WatchSoliton)
