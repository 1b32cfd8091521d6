# SPDX-License-Identifier: Apache-2.0
"""Playback clock, and the thread that publishes the messages of a bag when they are due."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import partial
from itertools import islice
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.play.replay_publishers import ReplayPublishers
from soliton_linkage_nodes.bags.reading import (
    latched,
    latched_before,
    open_bag,
    read_messages,
    types_of_topic,
)
from soliton_linkage_nodes.runtime.stamps import SECOND

RATES = (1e-3, 1e3)
"""Lowest and highest playback rate relative to the recording [1]."""
_LONGEST_WAIT = 0.1
"""Longest interval between two updates of the progress line [s]."""


class NextAction(Enum):
    """Action after waiting for a message."""

    PLAY = auto()
    SEEK = auto()
    STOP = auto()


class PlaybackClock:
    """Clock of the playback [ns] with a rate; other threads may pause, seek, step and stop it.

    The playback time is `p = p0 + rate (t - t0)`. Each change of the rate, pause or seek sets new
    values of t0 and p0. Without `paced`, every message is due immediately unless the playback is
    paused. `stopping` is set after a stop.
    """

    def __init__(
        self,
        rate: float = 1.0,
        paused: bool = False,
        paced: bool = True,
        clock: Callable[[], float] = time.monotonic,
        longest_step: float = 1.0,
        longest_burst: float = 2.0,
        changed: threading.Condition | None = None,
    ) -> None:
        """Create a clock that does not advance until `start` is called.

        `play_next` waits at most `longest_step` [s] and `burst` at most `longest_burst` [s]. These
        waits are limited because they block all other services of the node. All waits use the
        condition `changed`.
        """
        self.stopping = threading.Event()
        self._longest_step = longest_step
        self._longest_burst = longest_burst
        self._changed = changed or threading.Condition()
        self._clock = clock
        self._paced = paced
        self._rate = rate
        self._paused = paused
        self._position = 0.0
        self._since = clock()
        self._steps = 0
        self._passed = 0
        self._at_end = False
        self._sought: int | None = None

    @property
    def rate(self) -> float:
        """Playback rate relative to the recording [1]."""
        return self._rate

    @property
    def paced(self) -> bool:
        """Whether messages are published at their recorded intervals, scaled by the rate."""
        return self._paced

    @property
    def paused(self) -> bool:
        """Whether the playback is paused."""
        return self._paused

    @property
    def stepping(self) -> bool:
        """Whether a step or burst still has messages to play."""
        return bool(self._steps)

    def start(self, stamp: int) -> None:
        """Continue from an instant [ns]."""
        with self._changed:
            self._position = float(stamp)
            self._since = self._clock()

    def pause(self) -> None:
        """Pause the playback."""
        with self._changed:
            self._move()
            self._paused = True
            self._changed.notify_all()

    def resume(self) -> None:
        """End a pause."""
        with self._changed:
            self._move()
            self._paused = False
            self._steps = 0
            self._changed.notify_all()

    def toggle(self) -> None:
        """Pause or resume."""
        if self._paused:
            self.resume()
        else:
            self.pause()

    def set_rate(self, rate: float) -> None:
        """Change the rate."""
        with self._changed:
            self._move()
            self._rate = rate
            self._changed.notify_all()

    def play_next(self) -> bool:
        """Play one message of a paused playback; return False if none was played in time."""
        with self._changed:
            return bool(self._step(1, self._longest_step))

    def burst(self, number: int) -> int:
        """Play `number` messages (0: all) without waiting during a pause.

        Return the number of messages that were played within the time limit. If that is at least
        one, the player continues with the remaining messages.
        """
        with self._changed:
            return self._step(number or sys.maxsize, self._longest_burst)

    def seek(self, stamp: int) -> None:
        """Continue from another instant [ns] as soon as the player waits for a message."""
        with self._changed:
            self._sought = stamp
            self._changed.notify_all()

    def reopen(self) -> None:
        """Allow playing again after a stop. The clock remains paused if it was paused."""
        with self._changed:
            self.stopping.clear()
            self._sought = None
            self._steps = 0

    def stop(self) -> None:
        """Stop the playback."""
        with self._changed:
            self.stopping.set()
            self._changed.notify_all()

    def take_sought(self) -> int:
        """Return the requested instant of a seek [ns]; ValueError if no seek was requested."""
        with self._changed:
            sought, self._sought = self._sought, None
        if sought is None:
            raise ValueError('there was no seek; call this only after NextAction.SEEK')
        return sought

    def wait_for(self, stamp: int, meanwhile: Callable[[], None] = lambda: None) -> NextAction:
        """Wait until a message with `stamp` [ns] is due; call `meanwhile` ten times a second."""
        while True:
            with self._changed:
                early = self._early(stamp)
                if self.stopping.is_set():
                    return NextAction.STOP
                if self._sought is not None:
                    return NextAction.SEEK
                if early <= 0.0:
                    if self._paused:
                        self._pass_one(stamp)
                    return NextAction.PLAY
                self._changed.wait(min(early, _LONGEST_WAIT))
            meanwhile()

    def wait_at_end(self) -> NextAction:
        """Wait at the end of the bag until a seek, a stop or the end of a pause."""
        with self._changed:
            self._at_end, self._steps = True, 0
            self._changed.notify_all()
            self._changed.wait_for(
                lambda: not self._paused or self.stopping.is_set() or self._sought is not None
            )
            self._at_end = False
            if self.stopping.is_set():
                return NextAction.STOP
            return NextAction.PLAY if self._sought is None else NextAction.SEEK

    def _step(self, number: int, limit: float) -> int:
        if not self._paused or self._at_end or self.stopping.is_set():
            return 0
        before = self._passed
        self._steps += number
        self._changed.notify_all()
        self._changed.wait_for(lambda: not self._steps or self.stopping.is_set(), limit)
        passed = self._passed - before
        if not passed:
            self._steps = 0
        return passed

    def _early(self, stamp: int) -> float:
        """Return the time until a message is due [s]."""
        if self._paused:
            return 0.0 if self._steps else _LONGEST_WAIT
        if not self._paced:
            return 0.0
        return self._since + (stamp - self._position) * 1e-9 / self._rate - self._clock()

    def _pass_one(self, stamp: int) -> None:
        self._steps -= 1
        self._passed += 1
        self._position = max(self._position, float(stamp))
        self._changed.notify_all()

    def _move(self) -> None:
        now = self._clock()
        if not self._paused:
            self._position += (now - self._since) * 1e9 * self._rate
        self._since = now


@dataclass(frozen=True)
class PlaybackRange:
    """Start and end [ns] of the played range and of the whole bag."""

    start: int
    end: int
    origin: int
    last: int

    @property
    def duration(self) -> float:
        """Duration of the whole bag [s]."""
        return (self.last - self.origin) / SECOND

    def part(self, offset: int, duration: int, until: int) -> PlaybackRange:
        """Return the range that begins at `offset` and ends after `duration` or at `until` [ns].

        As in rosbag2, the later of the two ends is used, the end is included, and values <= 0 are
        ignored. Raises ValueError if the range is empty.
        """
        start = self.origin + max(offset, 0)
        ends = [start + duration + 1] if duration > 0 else []
        ends += [until + 1] if until > 0 else []
        end = min(self.last, max(ends, default=self.last))
        if not start < end:
            raise ValueError(
                f'nothing was recorded from {start} to {end} ns; the bag covers '
                f'{self.origin} to {self.last} ns'
            )
        return replace(self, start=start, end=end)


def playback_range(reader: Reader, start_offset: float, playback_until: float) -> PlaybackRange:
    """Return the range between two times since the start of the bag [s].

    `playback_until` = 0 means the end of the bag. Raises ValueError if the range is empty.
    """
    empty = not reader.message_count
    origin, last = (0, 0) if empty else (reader.start_time, reader.end_time)
    start = origin + round(start_offset * SECOND)
    end = min(last, origin + round(playback_until * SECOND)) if playback_until else last
    if not (empty or start < end):
        raise ValueError(
            f'parameter start_offset of bag_player = {start_offset:g} s must lie '
            f'before the end of the playback at {(end - origin) / SECOND:g} s'
        )
    return PlaybackRange(start, end, origin, last)


def find_topics(reader: Reader, names: Sequence[str]) -> list[Connection]:
    """Return the named topics, by default all of the bag; ValueError if one is missing."""
    if not names:
        return list(reader.connections)
    found = (each for name in names for each in types_of_topic(reader, name))
    return list({each.id: each for each in found}.values())


def full_name(reader: Reader, name: str) -> str:
    """Return the full name of a topic in any namespace, '' if the bag does not have it."""
    ends = (c.topic.rpartition('/')[2] for c in reader.connections)
    return types_of_topic(reader, name)[0].topic if name in ends else ''


class PlaybackThread:
    """Thread that publishes messages when they are due.

    The thread calls `prepare(True)`, publishes the last latched messages before the start, and
    calls `prepare(False)`. For each message it calls `publish_clock` with the receive time [ns].
    `finished` is set at the end of the bag, but not after a stop. `rounds` counts the starts from
    the beginning. `jumps` counts the seeks.
    """

    def __init__(
        self,
        path: Path,
        publishers: ReplayPublishers,
        clock: PlaybackClock,
        loop: bool,
        prepare: Callable[[bool], None],
        publish_clock: Callable[[int], None],
        longest_gap: float = 0.0,
        limits: BagLimits = DEFAULT_LIMITS,
    ) -> None:
        """Prepare the playback; gaps longer than `longest_gap` [s] are skipped (0: none)."""
        self.failure: Exception | None = None
        self.finished = False
        self.playing = False
        self.rounds = 0
        self.jumps = 0
        self._path = path
        self._publishers = publishers
        self._clock = clock
        self._loop = loop
        self._prepare = prepare
        self._publish_clock = publish_clock
        self._longest_gap = longest_gap
        self._limits = limits
        self._thread: threading.Thread | None = None

    def play(self, part: PlaybackRange) -> None:
        """Start playing a part of the bag; ValueError if it is playing already."""
        if self.playing:
            raise ValueError('the bag is already playing; call ~/stop first, or ~/seek')
        self.stop()
        self._clock.reopen()
        self._publishers.reset()
        self._range = part
        self._progress = ProgressLine(f'playing {self._path}', part.duration)
        self.finished = False
        self.playing = True
        self.rounds, self.jumps = 1, 0
        self._thread = threading.Thread(target=self._run, name='playing')
        self._thread.start()

    def stop(self) -> None:
        """Stop playing and wait for the end of the thread."""
        self._clock.stop()
        if self._thread is not None:
            self._thread.join()

    def summary(self, of: str = '') -> str:
        """Return a description of the played messages, rounds and jumps; `of` names the bag."""
        played, total = self._publishers.published, self._publishers.total
        again = [f'{self.rounds} rounds'] if self.rounds > 1 else []
        again += [f'{self.jumps} jump{"s" if self.jumps > 1 else ""}'] if self.jumps else []
        line = f'{played} of {total} messages{of}'
        if again:
            line = f'{played} messages{of} in {" and ".join(again)} (the bag contains {total})'
        left_out = self._publishers.left_out
        return f'{line}, {left_out} recorded states left out' if left_out else line

    def _run(self) -> None:
        try:
            with open_bag(self._path, self._limits) as reader:
                self._play(reader)
            self._publishers.deliver()
        except Exception as error:
            self.failure = error
        self.finished = not self._clock.stopping.is_set()
        self.playing = False

    def _play(self, reader: Reader) -> None:
        start = self._range.start
        self._prepare(True)
        ahead = self._publish_latched(reader, start)
        self._prepare(False)
        while (action := self._play_from(reader, start, ahead)) is not NextAction.STOP:
            if action is NextAction.SEEK:
                self.jumps += 1
                start = self._clock.take_sought()
            elif self._loop:
                self.rounds += 1
                start = self._range.start
            else:
                break
            ahead = self._publish_latched(reader, start)
        self._progress.end(f'played {self.summary(f" of {self._path}")}')

    def _play_from(self, reader: Reader, start: int, ahead: dict[str, int]) -> NextAction:
        """Play from `start` [ns] on, except messages in `ahead` (receive time [ns] by topic)."""
        self._clock.start(start)
        connections = self._publishers.of(reader.connections)
        messages = read_messages(reader, connections, start, self._range.end)
        before = start
        for connection, stamp, serialized in messages:
            if ahead.get(connection.topic) == stamp:
                del ahead[connection.topic]
                continue
            if self._publishers.leaves_out(connection):
                continue
            self._skip_long_gap(before, stamp)
            before = stamp
            action = self._clock.wait_for(stamp, partial(self._show, stamp))
            if action is not NextAction.PLAY:
                return action
            self._publish_clock(stamp)
            self._publishers.publish(connection, serialized)
            self._show(stamp)
        return self._clock.wait_at_end()

    def _skip_long_gap(self, before: int, stamp: int) -> None:
        gap = (stamp - before) / SECOND
        if self._longest_gap and gap > self._longest_gap:
            self._publishers.report_gap(stamp, gap)
            self._clock.start(stamp)

    def _publish_latched(self, reader: Reader, start: int) -> dict[str, int]:
        """Publish the last latched messages before `start` [ns].

        If a latched topic has none, publish its first message after `start`. Return the receive
        times [ns] of these later messages by topic.
        """
        ahead = {}
        for connection in filter(latched, self._publishers.of(reader.connections)):
            kept = latched_before(reader, connection, start)
            if not kept:
                after = read_messages(reader, [connection], start)
                for _, stamp, data in islice(after, 1):
                    ahead[connection.topic] = stamp
                    kept = [data]
            for data in kept:
                self._publishers.publish(connection, data)
        return ahead

    def _show(self, stamp: int) -> None:
        at = (stamp - self._range.origin) / SECOND
        pace = f'x {self._clock.rate:.3g}' if self._clock.paced else 'in lockstep'
        state = 'paused' if self._clock.paused else pace
        self._progress.show(at, f'{at:.1f} of {self._range.duration:.1f} s, {state}')
