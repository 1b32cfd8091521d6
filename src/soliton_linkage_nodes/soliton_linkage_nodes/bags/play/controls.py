# SPDX-License-Identifier: Apache-2.0
"""What a person may ask of a player, by services and by the keys of its terminal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from soliton_linkage_nodes.bags.play.excerpt import Excerpt
from soliton_linkage_nodes.bags.play.keyboard import DOWN, RIGHT, SPACE, UP, Keyboard
from soliton_linkage_nodes.bags.play.playing_thread import PlayingThread
from soliton_linkage_nodes.bags.play.transport import RATES, Transport
from soliton_linkage_nodes.bags.services import Reply, serve, tell
from soliton_linkage_nodes.runtime.managed import ManagedNode
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

_FASTER = 1.1
"""By what a key changes the rate."""
_KEYS = 'space: pause; right: next message; up, down: faster, slower'


class PlayerControls:
    """Offers the services of a player and takes keys, until it is closed."""

    def __init__(
        self,
        node: ManagedNode,
        transport: Transport,
        playing: PlayingThread,
        excerpt: Excerpt,
    ) -> None:
        """Begin to listen; the excerpt is what is played where a request does not tell."""
        self._transport = transport
        self._playing = playing
        self._excerpt = excerpt
        self._offer_services(node)
        self._node = node
        self._keyboard = Keyboard(
            {
                SPACE: self._key(transport.toggle),
                RIGHT: self._key(transport.play_next),
                UP: self._key(lambda: self._change_rate(_FASTER)),
                DOWN: self._key(lambda: self._change_rate(1 / _FASTER)),
            }
        )
        if self._keyboard.taken:
            node.get_logger().info(_KEYS)

    def close(self) -> None:
        """Give the terminal back."""
        self._keyboard.close()

    def _key(self, act: Callable[[], object]) -> Callable[[], object]:
        return lambda: self._node.active and act()

    def _change_rate(self, factor: float) -> None:
        low, high = RATES
        self._transport.set_rate(min(max(self._transport.rate * factor, low), high))

    def _offer_services(self, node: ManagedNode) -> None:
        transport = self._transport
        serve(node, 'pause', 'Pause', lambda _: self._paused(transport.pause))
        serve(node, 'resume', 'Resume', lambda _: self._paused(transport.resume))
        serve(node, 'toggle_paused', 'TogglePaused', lambda _: self._paused(transport.toggle))
        serve(node, 'play_next', 'PlayNext', lambda _: self._play_next())
        serve(node, 'burst', 'Burst', self._burst)
        serve(node, 'seek', 'Seek', lambda request: self._seek(time_from_msg(request.time)))
        serve(node, 'play', 'Play', self._play)
        serve(node, 'stop', 'Stop', lambda _: self._stop())
        serve(node, 'set_rate', 'SetRate', lambda request: self._set_rate(request.rate))
        tell(node, 'is_paused', 'IsPaused', 'paused', lambda: transport.paused)
        tell(node, 'get_rate', 'GetRate', 'rate', lambda: transport.rate)

    def _paused(self, act: Callable[[], None]) -> Reply:
        act()
        return Reply('paused' if self._transport.paused else 'playing')

    def _play_next(self) -> Reply:
        if not self._transport.play_next():
            raise ValueError(self._no_step())
        return Reply('one message')

    def _burst(self, request: Any) -> Reply:
        wanted = getattr(request, 'num_messages', 0)
        passed = self._transport.burst(wanted)
        if not passed:
            raise ValueError(self._no_step())
        more = ', the rest follows' if self._transport.stepping else ''
        return Reply(f'{passed} messages{more}', {'actually_burst': passed})

    def _no_step(self) -> str:
        if self._transport.paused:
            return 'no message is left, or none is ready yet; call it again, ~/seek or ~/play'
        return 'it is not paused; call ~/pause before'

    def _seek(self, stamp: int) -> Reply:
        first, last = self._excerpt.origin, self._excerpt.end
        if not self._playing.playing:
            raise ValueError('nothing is playing; call ~/play')
        if not first <= stamp <= last:
            raise ValueError(f'{stamp} ns is not between {first} and {last} ns')
        self._transport.seek(stamp)
        return Reply(f'goes on at {(stamp - first) / SECOND:.3f} s')

    def _play(self, request: Any) -> Reply:
        excerpt = self._excerpt
        if hasattr(request, 'start_offset'):
            excerpt = excerpt.part(
                time_from_msg(request.start_offset),
                time_from_msg(request.playback_duration),
                time_from_msg(request.playback_until_timestamp),
            )
        self._playing.play(excerpt)
        begin, end = ((t - excerpt.origin) / SECOND for t in (excerpt.start, excerpt.end))
        paused = ', once ~/resume is called' if self._transport.paused else ''
        return Reply(f'plays from {begin:.3f} to {end:.3f} s{paused}')

    def _stop(self) -> Reply:
        was_playing = self._playing.playing
        self._playing.stop()
        return Reply('stopped; ~/play begins again' if was_playing else 'nothing was playing')

    def _set_rate(self, rate: float) -> Reply:
        low, high = RATES
        if not low <= rate <= high:
            raise ValueError(f'rate = {rate:g} must lie in the range {low:g} to {high:g}')
        self._transport.set_rate(rate)
        return Reply(f'{rate:g} times as fast as recorded')
