# SPDX-License-Identifier: Apache-2.0
"""A thread that plays a bag from its start to its end, wherever that is moved meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.play.outlets import ReplayOutlets
from soliton_linkage_nodes.bags.play.transport import Transport, Turn
from soliton_linkage_nodes.bags.read.reading import (
    find_topic,
    last_before,
    latched,
    open_bag,
    read_messages,
)
from soliton_linkage_nodes.runtime.stamps import SECOND


@dataclass(frozen=True)
class Excerpt:
    """From when to when a bag is played, and from when to when it was recorded [ns]."""

    start: int
    end: int
    origin: int
    last: int

    @property
    def duration(self) -> float:
        """Of the whole bag [s]."""
        return (self.last - self.origin) / SECOND

    def part(self, offset: int, duration: int, until: int) -> Excerpt:
        """Another part of the bag: from an offset on, for a duration or to a stamp [ns].

        As in rosbag2 the later end counts, with the message that is there; what is 0 or less is
        not given. Raises ValueError where nothing of the bag lies between.
        """
        start = self.origin + max(offset, 0)
        ends = [start + duration + 1] if duration > 0 else []
        ends += [until + 1] if until > 0 else []
        end = min(self.last, max(ends, default=self.last))
        if not start < end:
            raise ValueError(
                f'nothing is recorded from {start} to {end} ns; the bag reaches from '
                f'{self.origin} to {self.last} ns'
            )
        return replace(self, start=start, end=end)


def excerpt(reader: Reader, start_offset: float, playback_until: float) -> Excerpt:
    """The part between two times of a bag [s], 0 for its beginning and its end.

    Raises ValueError where there is nothing between.
    """
    empty = not reader.message_count
    origin, last = (0, 0) if empty else (reader.start_time, reader.end_time)
    start = origin + round(start_offset * SECOND)
    end = min(last, origin + round(playback_until * SECOND)) if playback_until else last
    if not (empty or start < end):
        raise ValueError(
            f'parameter start_offset of bag_player = {start_offset:g} must lie '
            f'before {(end - origin) / SECOND:g} s, where playing ends'
        )
    return Excerpt(start, end, origin, last)


def chosen(reader: Reader, names: Sequence[str]) -> list[Connection]:
    """Topics of some names, or, with none, all; raises ValueError where the bag lacks one."""
    if not names:
        return list(reader.connections)
    return list({c.topic: c for c in (find_topic(reader, name) for name in names)}.values())


def full_name(reader: Reader, name: str) -> str:
    """Full name of a topic, or '' where no topic of the bag ends in the name."""
    ends = (c.topic.rpartition('/')[2] for c in reader.connections)
    return find_topic(reader, name).topic if name in ends else ''


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
