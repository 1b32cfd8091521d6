# SPDX-License-Identifier: Apache-2.0
"""What a person may ask of a player, by services and by the keys of its terminal."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node

from soliton_linkage_nodes.bags.play.excerpt import Excerpt
from soliton_linkage_nodes.bags.play.keyboard import DOWN, RIGHT, SPACE, UP, Keyboard
from soliton_linkage_nodes.bags.play.transport import RATES, Transport
from soliton_linkage_nodes.bags.services import serve, tell
from soliton_linkage_nodes.runtime.stamps import time_from_msg

_FASTER = 1.1
"""By what a key changes the rate."""
_KEYS = 'space: pause; right: next message; up, down: faster, slower'


class PlayerControls:
    """Offers the services of a player and takes keys, until it is closed."""

    def __init__(
        self, node: Node, transport: Transport, excerpt: Excerpt, finished: Callable[[], bool]
    ) -> None:
        """Begin to listen; once it has finished, there is nothing to be sought."""
        self._finished = finished
        self._transport = transport
        self._excerpt = excerpt
        self._offer_services(node)
        self._keyboard = Keyboard(
            {
                SPACE: transport.toggle,
                RIGHT: transport.play_next,
                UP: lambda: self._set_rate(transport.rate * _FASTER),
                DOWN: lambda: self._set_rate(transport.rate / _FASTER),
            }
        )
        if self._keyboard.taken:
            node.get_logger().info(_KEYS)

    def close(self) -> None:
        """Give the terminal back."""
        self._keyboard.close()

    def _offer_services(self, node: Node) -> None:
        transport = self._transport
        serve(node, 'pause', 'Pause', lambda _: transport.pause())
        serve(node, 'resume', 'Resume', lambda _: transport.resume())
        serve(node, 'toggle_paused', 'TogglePaused', lambda _: transport.toggle())
        serve(node, 'play_next', 'PlayNext', lambda _: self._play_next())
        serve(node, 'seek', 'Seek', lambda request: self._seek(time_from_msg(request.time)))
        serve(node, 'set_rate', 'SetRate', lambda request: self._set_rate(request.rate))
        tell(node, 'is_paused', 'IsPaused', 'paused', lambda: transport.paused)
        tell(node, 'get_rate', 'GetRate', 'rate', lambda: transport.rate)

    def _play_next(self) -> str | None:
        return None if self._transport.play_next() else 'not paused, or at the end'

    def _seek(self, stamp: int) -> str | None:
        first, last = self._excerpt.origin, self._excerpt.end
        if self._finished() or not first <= stamp <= last:
            return f'{stamp} ns is not between {first} and {last} ns, or it is over'
        self._transport.seek(stamp)
        return None

    def _set_rate(self, rate: float) -> str | None:
        low, high = RATES
        if not low <= rate <= high:
            return f'rate = {rate:g} must lie in the range {low:g} to {high:g}'
        self._transport.set_rate(rate)
        return None
