# SPDX-License-Identifier: Apache-2.0
"""Thread that publishes each message of a bag when it is due."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.bag_files import BagReader
from soliton_linkage_nodes.bags.guards import BagLimits
from soliton_linkage_nodes.bags.metadata import gaps_in, time_in_gaps
from soliton_linkage_nodes.bags.play.playback_clock import RATES, NextAction, PlaybackClock
from soliton_linkage_nodes.bags.play.replay_publishers import ReplayPublishers
from soliton_linkage_nodes.bags.reading import latched_before, open_bag, types_of_topic
from soliton_linkage_nodes.bags.storages.storage import LAST_STAMP
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.runtime.stamps import SECOND

_LAST = LAST_STAMP / SECOND
"""Latest time that a 64-bit stamp can hold [s]."""


@dataclass(frozen=True)
class BagPlayerParameters:
    """Parameters of the bag player."""

    bag: str = quantity('', 'path of the bag to play')
    rate: float = quantity(1.0, 'playback rate relative to the recording', '', *RATES)
    topics: tuple[str, ...] = quantity((), 'topics to play; empty: all in the bag')
    start_offset: float = quantity(0.0, 'start time in the bag', 's', 0.0, _LAST)
    playback_until: float = quantity(
        0.0, 'end time in the bag, 0: end of the bag', 's', 0.0, _LAST
    )
    loop: bool = quantity(False, 'restart at the end of the bag')
    stay: bool = quantity(False, 'keep running at the end of the bag, for ~/play')
    start_paused: bool = quantity(False, 'begin paused, until ~/resume is called')
    wait_for: tuple[str, ...] = quantity(
        (), 'topics that must have a subscriber before the start; empty: joint_states'
    )
    subscriber_timeout: float = quantity(
        5.0, 'longest wait for each of these subscribers', 's', 0.0, 3600.0
    )
    publish_clock: bool = quantity(
        False, 'publish the receive times on /clock; a recorded /clock is then not played'
    )
    longest_gap: float = quantity(
        3600.0, 'gap between messages above which the player skips it; 0: never', 's', 0.0, _LAST
    )
    lockstep: bool = quantity(
        False, 'play as fast as the analyser answers each frame with a soliton_state'
    )
    lockstep_window: int = quantity(
        100, 'largest number of unanswered frames in lockstep', '', 1, 1000
    )
    lockstep_timeout: float = quantity(
        5.0, 'longest wait for an answer in lockstep', 's', 0.1, 3600.0
    )


@dataclass(frozen=True)
class PlaybackRange:
    """Played interval [`start`, `end`) of a bag that covers the interval [`origin`, `last`).

    All four are receive times [ns since 1970].
    """

    start: int
    end: int
    origin: int
    last: int

    @property
    def duration(self) -> float:
        """Duration of the whole bag [s]."""
        return (self.last - self.origin) / SECOND

    def part(self, offset: int, duration: int, until: int) -> PlaybackRange:
        """Return an interval that begins at the time `offset` after the start of the bag [ns].

        The interval ends after its `duration` [ns] or at the receive time `until` [ns since 1970].
        If both are given, the later end applies, as in rosbag2. If neither is given, the interval
        lasts to the end of the bag. An argument that is not positive counts as not given. Raises
        ValueError if the interval is empty.
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


def playback_range(reader: BagReader, start_offset: float, playback_until: float) -> PlaybackRange:
    """Return the interval between two times since the start of the bag [s].

    If `playback_until` is 0, the interval lasts to the end of the bag. Raises ValueError if the
    interval is empty.
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


def find_topics(reader: BagReader, names: Sequence[str]) -> list[StoredTopic]:
    """Return the topics with these names, or all topics if `names` is empty.

    Raises ValueError if the bag lacks one of the topics.
    """
    if not names:
        return list(reader.topics)
    found = (each for name in names for each in types_of_topic(reader, name))
    return list({each.number: each for each in found}.values())


def full_name(reader: BagReader, name: str) -> str:
    """Return the full name of the topic whose name ends in '/<name>'; '' without such a topic.

    Raises ValueError if several topics have such names, for example in two namespaces.
    """
    ends = (each.name.rpartition('/')[2] for each in reader.topics)
    return types_of_topic(reader, name)[0].name if name in ends else ''


class PlaybackThread:
    """Thread that publishes each message of a bag when it is due.

    `awaited` lists the topics that must have a subscriber before the playback. The thread first
    waits for subscribers of the latched topics in `awaited`. It then publishes the last latched
    messages from before the played interval. Then it waits for subscribers of the other topics in
    `awaited` and, if the parameter `lockstep` is set, for a publisher of `soliton_state`. After
    these waits it plays the interval.

    `finished` is true after the playback has reached its end or failed, but not after a stop.
    `failure` is the error of a failed playback. `rounds` is the number of times that the interval
    was started, and `jumps` is the number of seeks.
    """

    def __init__(
        self,
        publishers: ReplayPublishers,
        clock: PlaybackClock,
        settings: BagPlayerParameters,
        limits: BagLimits,
        awaited: Sequence[str],
    ) -> None:
        self.failure: Exception | None = None
        self.finished = False
        self.playing = False
        self.rounds = 0
        self.jumps = 0
        self._publishers = publishers
        self._clock = clock
        self._settings = settings
        self._limits = limits
        self._awaited = awaited
        self._thread: threading.Thread | None = None

    def play(self, part: PlaybackRange) -> None:
        """Start to play an interval of the bag. Raises ValueError if the thread is playing."""
        if self.playing:
            raise ValueError('the bag is already playing; call ~/stop first, or ~/seek')
        self.stop()
        self._clock.reopen()
        self._publishers.reset()
        self._range = part
        self._progress = ProgressLine(f'playing {self._settings.bag}', part.duration)
        self.finished = False
        self.playing = True
        self.rounds, self.jumps = 1, 0
        self._thread = threading.Thread(target=self._run, name='playing')
        self._thread.start()

    def stop(self) -> None:
        """Stop playing and wait until the thread has ended."""
        self._clock.stop()
        if self._thread is not None:
            self._thread.join()

    def summary(self, of: str = '') -> str:
        """Return the numbers of messages, rounds and jumps as text.

        The text `of` is inserted after the word 'messages'.
        """
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
            with open_bag(Path(self._settings.bag), self._limits) as reader:
                self._gaps = gaps_in(reader.custom_data)
                self._play(reader)
            self._publishers.deliver()
        except Exception as error:
            self.failure = error
        self.finished = not self._clock.stopping.is_set()
        self.playing = False

    def _play(self, reader: BagReader) -> None:
        start, limit = self._range.start, self._settings.subscriber_timeout
        latched = {each.name for each in reader.topics if each.latched_depth}
        self._publishers.wait_for_subscribers(latched.intersection(self._awaited), limit)
        ahead = self._publish_latched(reader, start)
        others = [each for each in self._awaited if each not in latched]
        self._publishers.wait_for_subscribers(others, limit)
        if self._publishers.lockstep is not None:
            self._publishers.lockstep.wait_for_the_analyser(limit, self._clock.stopping)
        while (action := self._play_from(reader, start, ahead)) is not NextAction.STOP:
            if action is NextAction.SEEK:
                self.jumps += 1
                start = self._clock.take_sought()
            elif self._settings.loop:
                self.rounds += 1
                start = self._range.start
            else:
                break
            ahead = self._publish_latched(reader, start)
        self._progress.end(f'played {self.summary(f" of {self._settings.bag}")}')

    def _play_from(self, reader: BagReader, start: int, ahead: dict[str, int]) -> NextAction:
        """Play the messages from `start` [ns] on, except for the messages in `ahead`.

        `ahead` is the result of `_publish_latched`, which has published these messages already.
        """
        self._clock.start(start)
        before = start
        topics = self._publishers.of(reader.topics)
        for topic, stamp, serialized in reader.messages(topics, start, self._range.end):
            if ahead.get(topic.name) == stamp:
                del ahead[topic.name]
                continue
            if self._publishers.leaves_out(topic):
                continue
            self._skip_gap(before, stamp)
            before = stamp
            action = self._clock.wait_for(stamp, partial(self._show, stamp))
            if action is not NextAction.PLAY:
                return action
            self._publishers.publish_clock(stamp)
            self._publishers.publish(topic, serialized)
            self._show(stamp)
        return self._clock.wait_at_end()

    def _skip_gap(self, before: int, stamp: int) -> None:
        skipped = time_in_gaps(self._gaps, before, stamp)
        limit = round(self._settings.longest_gap * SECOND)
        if limit and stamp - before - skipped > limit:
            skipped = stamp - before
        if skipped:
            self._publishers.report_gap(stamp, skipped / SECOND)
            self._clock.start(before + skipped)

    def _publish_latched(self, reader: BagReader, start: int) -> dict[str, int]:
        """Publish the last messages from before `start` [ns] on each latched topic.

        If a topic has no earlier message, its first message from `start` on is published instead.
        Returns a mapping from the names of such topics to the receive time of this message [ns].
        """
        ahead = {}
        for topic in self._publishers.of(reader.topics):
            if not topic.latched_depth:
                continue
            kept = latched_before(reader, topic, start)
            if not kept:
                for _, stamp, data in islice(reader.messages([topic], start), 1):
                    ahead[topic.name] = stamp
                    kept = [data]
            for data in kept:
                self._publishers.publish(topic, data)
        return ahead

    def _show(self, stamp: int) -> None:
        at = (stamp - self._range.origin) / SECOND
        pace = f'x {self._clock.rate:.3g}' if self._clock.paced else 'in lockstep'
        state = 'paused' if self._clock.paused else pace
        self._progress.show(at, f'{at:.1f} of {self._range.duration:.1f} s, {state}')
