# SPDX-License-Identifier: Apache-2.0
"""Bag player, which publishes the messages of a bag at the recorded intervals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.bags.bag_files import BagReader
from soliton_linkage_nodes.bags.guards import BagLimits
from soliton_linkage_nodes.bags.play.controls import PlayerControls
from soliton_linkage_nodes.bags.play.playback import (
    PlaybackThread,
    find_topics,
    full_name,
    playback_range,
)
from soliton_linkage_nodes.bags.play.playback_clock import RATES, PlaybackClock
from soliton_linkage_nodes.bags.play.replay_publishers import (
    Lockstep,
    RecordedStates,
    ReplayPublishers,
)
from soliton_linkage_nodes.bags.reading import find_topic, open_bag, types_of_topic
from soliton_linkage_nodes.bags.storages.storage import LAST_STAMP
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

_LAST = LAST_STAMP / SECOND
"""Latest time that a 64-bit stamp can hold [s]."""


@dataclass(frozen=True)
class BagPlayerParameters:
    """Parameters of the player."""

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


class BagPlayer(ManagedNode):
    """Node that publishes the messages of a bag at the intervals of their receive times.

    Before the first message, it publishes the last latched messages from before the start, and
    waits for subscribers of the topics in `wait_for`. In lockstep, a frame waits until the
    analyser has answered earlier frames. Recorded analyser states are not published in lockstep.
    Without lockstep, they are not published while an analyser runs, unless `topics` names them.
    Times in which the recorder was paused are skipped. At the end of the bag the node ends, unless
    the playback is paused or `stay` is set.

    Publishes the topics of the bag, `/diagnostics` and, with `publish_clock`, `/clock`. Serves
    `~/pause`, `~/resume`, `~/toggle_paused`, `~/is_paused`, `~/play_next`, `~/burst`, `~/seek`,
    `~/play`, `~/stop`, `~/set_rate` and `~/get_rate`, as in rosbag2.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        BagPlayerParameters: '',
        BagLimits: '',
        ManagedParameters: '',
    }

    def configure(self) -> None:
        """Open the bag and create the publishers."""
        self._settings = settings = current(self, BagPlayerParameters)
        limits = current(self, BagLimits)
        if not settings.bag:
            raise ValueError("parameter bag of bag_player = '' must be the path of a bag")
        self._playback = PlaybackClock(settings.rate, settings.start_paused, not settings.lockstep)
        self._lockstep: Lockstep | None = None
        with open_bag(Path(settings.bag), limits) as reader:
            topics = self._without_clock(find_topics(reader, settings.topics))
            try:
                counts = {each: reader.counts[each] for each in topics}
                self._replay = ReplayPublishers(self, counts, self._playback.stopping)
            except ValueError as error:
                raise ValueError(f'bag {settings.bag!r}: {error}') from error
            pace = 'in lockstep' if settings.lockstep else f'at rate {settings.rate:g}'
            self.get_logger().info(f'playing {settings.bag}: {self._replay.total} messages {pace}')
            self._range = playback_range(reader, settings.start_offset, settings.playback_until)
            self._awaited = self._topics_to_wait_for(reader)
            self._latched = {each.name for each in reader.topics if each.latched_depth}
            if settings.lockstep:
                frames = find_topic(reader, interfaces.JOINT_STATES.name).name
                window, timeout = settings.lockstep_window, settings.lockstep_timeout
                self._lockstep = Lockstep(self, frames, window, timeout)
                self._replay.set_lockstep(self._lockstep)
            else:
                self._suppress_recorded_states(reader)
        clock = interfaces.CLOCK
        self._clock_publisher = clock.publisher(self) if settings.publish_clock else None
        played = Path(settings.bag), self._replay, self._playback, settings.loop
        calls = self._prepare, self._publish_clock
        self._playing = PlaybackThread(*played, *calls, settings.longest_gap, limits)
        self.diagnostics = Diagnostics(self, 'playing', self.reporting(self._report))
        self._controls = PlayerControls(self, self._playback, self._playing, self._range)
        self._paused = False
        self._begun = False

    def activate(self) -> None:
        """Start playing the bag, or resume it."""
        if not self._begun:
            self._begun = True
            self._playing.play(self._range)
        elif not self._paused:
            self._playback.resume()

    def deactivate(self) -> None:
        """Pause the playback."""
        self._paused = self._playback.paused
        self._playback.pause()

    def cleanup(self) -> None:
        """Stop playing and restore the terminal."""
        self._playing.stop()
        self._controls.close()

    @property
    def finished(self) -> bool:
        """Whether the bag was played to its end and the parameter `stay` is not set."""
        return self.configured and self._playing.finished and not self._settings.stay

    @property
    def failure(self) -> Exception | None:
        """Error that ended the playback, or None."""
        return self._playing.failure if self.configured else None

    def _topics_to_wait_for(self, reader: BagReader) -> list[str]:
        if self._settings.wait_for:
            wanted = self._settings.wait_for
            return [types_of_topic(reader, name)[0].name for name in wanted]
        frames = full_name(reader, interfaces.JOINT_STATES.name)
        return [frames] if frames else []

    def _without_clock(self, topics: list[StoredTopic]) -> list[StoredTopic]:
        others = [each for each in topics if each.name != interfaces.CLOCK.name]
        if not self._settings.publish_clock or len(others) == len(topics):
            return topics
        self.get_logger().info('the recorded /clock is not played, because publish_clock is set')
        return others

    def _suppress_recorded_states(self, reader: BagReader) -> None:
        chosen = {topic.rpartition('/')[2] for topic in self._settings.topics}
        for topic in self._replay.of(reader.topics):
            name = topic.name.rpartition('/')[2]
            if name in (interfaces.SOLITON_STATE.name, interfaces.SOLITON_EVENTS.name):
                states = RecordedStates(self, topic.name, name in chosen)
                self._replay.suppress_beside_analyser(states)

    def _prepare(self, latched_topics: bool) -> None:
        awaited = [each for each in self._awaited if (each in self._latched) is latched_topics]
        limit = self._settings.subscriber_timeout
        self._replay.wait_for_subscribers(awaited, limit)
        if not latched_topics:
            self._replay.wait_for_the_analyser(limit)

    def _publish_clock(self, stamp: int) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))

    def _report(self) -> Report:
        given_up = self._lockstep.given_up if self._lockstep else 0
        state = f'played {self._playing.summary()}'
        if given_up:
            state = f'{state}, {given_up} frames without an answer of the analyser'
        figures = {
            'bag': self._settings.bag,
            'rate': self._playback.rate,
            'paused': self._playback.paused,
            'messages played': self._replay.published,
            'messages': self._replay.total,
            'rounds': self._playing.rounds,
            'recorded states left out': self._replay.left_out,
        }
        return Report(state, figures, warning=bool(given_up))


def main() -> None:
    """Run the player until the end of the bag or a signal."""
    run(BagPlayer)
