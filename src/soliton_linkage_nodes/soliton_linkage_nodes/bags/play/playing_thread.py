# SPDX-License-Identifier: Apache-2.0
"""A thread that plays a bag from its start to its end, wherever that is moved meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from rosbags.rosbag2 import Reader

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.guards.limits import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.play.excerpt import Excerpt
from soliton_linkage_nodes.bags.play.outlets import ReplayOutlets
from soliton_linkage_nodes.bags.play.transport import Transport, Turn
from soliton_linkage_nodes.bags.read.reading import last_before, latched, open_bag, read_messages
from soliton_linkage_nodes.runtime.stamps import SECOND


class PlayingThread:
    """Publishes messages when they are due, and ahead of them what latched topics said last.

    After the first latched messages it calls `prepare`, and for each message that is due, with
    the time of its receipt [ns], `tell_time`. `finished` says whether it came to the end by
    itself, `rounds` how often it has begun at the start, `jumps` how often elsewhere.
    """

    def __init__(
        self,
        path: Path,
        outlets: ReplayOutlets,
        transport: Transport,
        loop: bool,
        prepare: Callable[[], None],
        tell_time: Callable[[int], None],
        pace: str = '',
        limits: BagLimits = DEFAULT_LIMITS,
    ) -> None:
        """Prepare to play, again and again if it is to `loop`; the pace is shown, or the rate."""
        self.failure: Exception | None = None
        self.finished = False
        self.playing = False
        self.rounds = 0
        self.jumps = 0
        self._path = path
        self._outlets = outlets
        self._transport = transport
        self._loop = loop
        self._prepare = prepare
        self._tell_time = tell_time
        self._pace = pace
        self._limits = limits
        self._thread: threading.Thread | None = None

    def play(self, excerpt: Excerpt) -> None:
        """Begin to play a part of the bag; ValueError where it is playing."""
        if self.playing:
            raise ValueError('it is playing; call ~/stop before, or ~/seek')
        self.stop()
        self._transport.reopen()
        self._outlets.begin()
        self._excerpt = excerpt
        self._progress = ProgressLine(f'playing {self._path}', excerpt.duration)
        self.finished = False
        self.playing = True
        self.rounds, self.jumps = 1, 0
        self._thread = threading.Thread(target=self._run, name='playing')
        self._thread.start()

    def stop(self) -> None:
        """End it."""
        self._transport.stop()
        if self._thread is not None:
            self._thread.join()

    def account(self, of: str = '') -> str:
        """How many messages were played, `of` what, and how often it has begun again."""
        played, total = self._outlets.published, self._outlets.total
        again = [f'{self.rounds} rounds'] if self.rounds > 1 else []
        again += [f'{self.jumps} jump{"s" if self.jumps > 1 else ""}'] if self.jumps else []
        line = f'{played} of {total} messages{of}'
        if again:
            line = f'{played} messages{of} in {" and ".join(again)} (the bag holds {total})'
        left_out = self._outlets.left_out
        return f'{line}, {left_out} recorded states left out' if left_out else line

    def _run(self) -> None:
        try:
            with open_bag(self._path, self._limits) as reader:
                self._play(reader)
            self._outlets.deliver()
        except Exception as error:
            self.failure = error
        self.finished = not self._transport.stopping.is_set()
        self.playing = False

    def _play(self, reader: Reader) -> None:
        start = self._excerpt.start
        ahead = self._send_latched(reader, start)
        self._prepare()
        while (turn := self._play_from(reader, start, ahead)) is not Turn.STOP:
            if turn is Turn.SEEK:
                self.jumps += 1
                start = self._transport.take_sought()
            elif self._loop:
                self.rounds += 1
                start = self._excerpt.start
            else:
                break
            ahead = self._send_latched(reader, start)
        self._progress.end(f'played {self.account(f" of {self._path}")}')

    def _play_from(self, reader: Reader, start: int, ahead: dict[str, int]) -> Turn:
        """Play from an instant on, without what latched topics have said ahead of it."""
        self._transport.start(start)
        connections = self._outlets.of(reader.connections)
        messages = read_messages(reader, connections, start, self._excerpt.end)
        for connection, stamp, serialized in messages:
            if ahead.get(connection.topic) == stamp:
                del ahead[connection.topic]
                continue
            if self._outlets.leave_out(connection):
                continue
            turn = self._transport.wait_for(stamp, partial(self._show, stamp))
            if turn is not Turn.PLAY:
                return turn
            self._tell_time(stamp)
            self._outlets.publish(connection, serialized)
            self._show(stamp)
        return self._transport.wait_at_end()

    def _send_latched(self, reader: Reader, start: int) -> dict[str, int]:
        """Publish the last latched messages before an instant, or, with none, the first after.

        Return when those were received that come after.
        """
        ahead = {}
        for connection in filter(latched, self._outlets.of(reader.connections)):
            found = last_before(reader, connection, start)
            if found is None:
                after = read_messages(reader, [connection], start)
                found = next(((stamp, data) for _, stamp, data in after), None)
                if found is not None:
                    ahead[connection.topic] = found[0]
            if found is not None:
                self._outlets.publish(connection, found[1])
        return ahead

    def _show(self, stamp: int) -> None:
        at = (stamp - self._excerpt.origin) / SECOND
        pace = self._pace or f'x {self._transport.rate:.3g}'
        state = 'paused' if self._transport.paused else pace
        self._progress.show(at, f'{at:.1f} of {self._excerpt.duration:.1f} s, {state}')
