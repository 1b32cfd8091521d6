# SPDX-License-Identifier: Apache-2.0
"""Services and keys that control the player."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Mapping
from typing import Any

from soliton_linkage_nodes.bags.play.playback import PlaybackRange, PlaybackThread
from soliton_linkage_nodes.bags.play.playback_clock import RATES, PlaybackClock
from soliton_linkage_nodes.bags.services import Reply, serve, serve_value
from soliton_linkage_nodes.runtime.managed import ManagedNode
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

_POLL_INTERVAL = 0.1
"""The thread waits at most this long for a key before it checks whether it was stopped [s]."""
_MOST_READ = 64
"""Most bytes that one read of the terminal returns [B]. A user types fewer in a poll interval."""
SPACE = ' '
UP, DOWN, RIGHT = '\x1b[A', '\x1b[B', '\x1b[C'


class Keyboard:
    """Thread that calls the action of each key pressed in the terminal, if there is a terminal."""

    def __init__(self, actions: Mapping[str, Callable[[], object]]) -> None:
        self._actions = actions
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        if not (sys.stdin and sys.stdin.isatty()):
            return
        self._terminal = sys.stdin.fileno()
        # A background process must not change the terminal settings. Otherwise the system would
        # stop this process.
        if os.tcgetpgrp(self._terminal) != os.getpgrp():
            return
        self._before = termios.tcgetattr(self._terminal)
        tty.setcbreak(self._terminal)
        self._thread = threading.Thread(target=self._run, name='keyboard', daemon=True)
        self._thread.start()

    @property
    def taken(self) -> bool:
        """Whether the thread was started and reads keys."""
        return self._thread is not None

    def close(self) -> None:
        """Stop the thread and restore the settings of the terminal."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
            termios.tcsetattr(self._terminal, termios.TCSADRAIN, self._before)
            self._thread = None

    def _run(self) -> None:
        while not self._stopping.is_set():
            ready, _, _ = select.select([self._terminal], [], [], _POLL_INTERVAL)
            pressed = os.read(self._terminal, _MOST_READ).decode(errors='replace') if ready else ''
            if ready and not pressed:
                return
            for key in _keys(pressed):
                self._actions.get(key, lambda: None)()


def _keys(pressed: str) -> list[str]:
    keys = []
    while pressed:
        size = 3 if pressed.startswith('\x1b[') else 1
        keys.append(pressed[:size])
        pressed = pressed[size:]
    return keys


_FASTER = 1.1
"""Each press of the key for faster (slower) multiplies (divides) the playback rate by this [1]."""
_KEYS = 'space: pause; right: next message; up, down: faster, slower'


class PlayerControls:
    """Services and keys by which a user controls the player."""

    def __init__(
        self, node: ManagedNode, clock: PlaybackClock, playing: PlaybackThread, part: PlaybackRange
    ) -> None:
        self._clock = clock
        self._playing = playing
        self._range = part
        self._offer_services(node)
        self._node = node
        self._keyboard = Keyboard(
            {
                SPACE: self._key(clock.toggle),
                RIGHT: self._key(clock.play_next),
                UP: self._key(lambda: self._change_rate(_FASTER)),
                DOWN: self._key(lambda: self._change_rate(1 / _FASTER)),
            }
        )
        if self._keyboard.taken:
            node.get_logger().info(_KEYS)

    def close(self) -> None:
        """Stop reading keys and restore the settings of the terminal."""
        self._keyboard.close()

    def _key(self, act: Callable[[], object]) -> Callable[[], object]:
        return lambda: self._node.active and act()

    def _change_rate(self, factor: float) -> None:
        low, high = RATES
        self._clock.set_rate(min(max(self._clock.rate * factor, low), high))

    def _offer_services(self, node: ManagedNode) -> None:
        clock = self._clock
        serve(node, 'pause', 'Pause', lambda _: self._paused(clock.pause))
        serve(node, 'resume', 'Resume', lambda _: self._paused(clock.resume))
        serve(node, 'toggle_paused', 'TogglePaused', lambda _: self._paused(clock.toggle))
        serve(node, 'play_next', 'PlayNext', lambda _: self._play_next())
        serve(node, 'burst', 'Burst', self._burst)
        serve(node, 'seek', 'Seek', lambda request: self._seek(time_from_msg(request.time)))
        serve(node, 'play', 'Play', self._play)
        serve(node, 'stop', 'Stop', lambda _: self._stop())
        serve(node, 'set_rate', 'SetRate', lambda request: self._set_rate(request.rate))
        serve_value(node, 'is_paused', 'IsPaused', 'paused', lambda: clock.paused)
        serve_value(node, 'get_rate', 'GetRate', 'rate', lambda: clock.rate)

    def _paused(self, act: Callable[[], None]) -> Reply:
        act()
        return Reply('paused' if self._clock.paused else 'playing')

    def _play_next(self) -> Reply:
        if not self._clock.play_next():
            raise ValueError(self._no_step())
        return Reply('played one message')

    def _burst(self, request: Any) -> Reply:
        wanted = getattr(request, 'num_messages', 0)
        passed = self._clock.burst(wanted)
        if not passed:
            raise ValueError(self._no_step())
        more = ', the rest follows' if self._clock.stepping else ''
        return Reply(f'played {passed} messages{more}', {'actually_burst': passed})

    def _no_step(self) -> str:
        if self._clock.paused:
            return 'no message is left, or none is ready yet; call it again, ~/seek or ~/play'
        return 'the playback is not paused; call ~/pause first'

    def _seek(self, stamp: int) -> Reply:
        first, last = self._range.origin, self._range.end
        if not self._playing.playing:
            raise ValueError('nothing is playing; call ~/play')
        if 0 <= stamp < first and stamp <= last - first:
            stamp += first
        if not first <= stamp <= last:
            raise ValueError(f'{stamp} ns is outside the bag, {first} to {last} ns')
        self._clock.seek(stamp)
        return Reply(f'continues at {(stamp - first) / SECOND:.3f} s')

    def _play(self, request: Any) -> Reply:
        part = self._range
        if hasattr(request, 'start_offset'):
            part = part.part(
                time_from_msg(request.start_offset),
                time_from_msg(request.playback_duration),
                time_from_msg(request.playback_until_timestamp),
            )
        self._playing.play(part)
        begin, end = ((t - part.origin) / SECOND for t in (part.start, part.end))
        paused = ', after ~/resume' if self._clock.paused else ''
        return Reply(f'plays from {begin:.3f} to {end:.3f} s{paused}')

    def _stop(self) -> Reply:
        was_playing = self._playing.playing
        self._playing.stop()
        return Reply('stopped; ~/play starts again' if was_playing else 'nothing was playing')

    def _set_rate(self, rate: float) -> Reply:
        low, high = RATES
        if not low <= rate <= high:
            raise ValueError(f'rate = {rate:g} must lie in the range {low:g} to {high:g}')
        self._clock.set_rate(rate)
        return Reply(f'{rate:g} times as fast as recorded')
