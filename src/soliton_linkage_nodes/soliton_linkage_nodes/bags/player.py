# SPDX-License-Identifier: Apache-2.0
"""Bag player. It publishes the messages of a bag at the recorded intervals."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from soliton_linkage_nodes.bags.bag_files import BagReader
from soliton_linkage_nodes.bags.guards import BagLimits
from soliton_linkage_nodes.bags.play.playback import (
    BagPlayerParameters,
    PlaybackThread,
    find_topics,
    full_name,
    playback_range,
)
from soliton_linkage_nodes.bags.play.playback_clock import RATES, PlaybackClock
from soliton_linkage_nodes.bags.play.replay_publishers import Lockstep, ReplayPublishers
from soliton_linkage_nodes.bags.reading import find_topic, open_bag, types_of_topic
from soliton_linkage_nodes.bags.services import Reply, serve, serve_value
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

_POLL_INTERVAL = 0.1
"""Interval at which the keyboard thread checks whether it must stop [s]."""
_MOST_READ = 64
"""Largest number of bytes that one read of the terminal returns [B]. A user types fewer keys in a
poll interval."""
SPACE = ' '
UP, DOWN, RIGHT = '\x1b[A', '\x1b[B', '\x1b[C'
_KEY = re.compile(r'\x1b\[.?|.', re.DOTALL)


class Keyboard:
    """Thread that calls `press` with each key that is pressed in the terminal.

    Without a terminal, no thread is started.
    """

    def __init__(self, press: Callable[[str], object]) -> None:
        self._press = press
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        if not (sys.stdin and sys.stdin.isatty()):
            return
        self._terminal = sys.stdin.fileno()
        # The system stops a background process that changes the settings of the terminal.
        if os.tcgetpgrp(self._terminal) != os.getpgrp():
            return
        self._before = termios.tcgetattr(self._terminal)
        tty.setcbreak(self._terminal)
        self._thread = threading.Thread(target=self._run, name='keyboard', daemon=True)
        self._thread.start()

    @property
    def taken(self) -> bool:
        """Whether the thread reads keys."""
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
            for key in _KEY.findall(pressed):
                self._press(key)


_FASTER = 1.1
"""Factor by which one press of a key increases or decreases the playback rate [1]."""
_HELP = 'space: pause; right: next message; up, down: faster, slower'


class BagPlayer(ManagedNode):
    """Node that publishes the messages of a bag at the intervals of their receive times.

    First, the node waits for subscribers of the latched topics in `wait_for`, and publishes the
    last latched messages from before the played interval. It then waits for subscribers of the
    other topics in `wait_for` and, if `lockstep` is set, for a publisher of `soliton_state`. After
    these waits it plays the interval. The player skips the times in which the recorder was paused,
    and gaps longer than `longest_gap`. At the end of the interval the node ends, unless the
    playback is paused, or `loop` or `stay` is set.

    A frame consists of all joint states with one stamp. If `lockstep` is set, a frame waits until
    fewer than `lockstep_window` earlier frames lack a `soliton_state` of the analyser. Recorded
    soliton states and events are then not published. If `lockstep` is not set, they are not
    published while an analyser publishes them, unless `topics` names them.

    The node publishes the topics of the bag, `/diagnostics` and, with `publish_clock`, `/clock`.
    It serves `~/pause`, `~/resume`, `~/toggle_paused`, `~/is_paused`, `~/play_next`, `~/burst`,
    `~/seek`, `~/play`, `~/stop`, `~/set_rate` and `~/get_rate`, as in rosbag2.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        BagPlayerParameters: '',
        BagLimits: '',
        ManagedParameters: '',
    }

    def configure(self) -> None:
        """Open the bag, and create the publishers and services."""
        self._settings = settings = current(self, BagPlayerParameters)
        limits = current(self, BagLimits)
        if not settings.bag:
            raise ValueError("parameter bag of bag_player = '' must be the path of a bag")
        self._playback = PlaybackClock(settings.rate, settings.start_paused, not settings.lockstep)
        with open_bag(Path(settings.bag), limits) as reader:
            topics = self._without_clock(find_topics(reader, settings.topics))
            counts = {each: reader.counts[each] for each in topics}
            try:
                self._replay = ReplayPublishers(
                    self, counts, self._playback.stopping, settings.publish_clock
                )
            except ValueError as error:
                raise ValueError(f'bag {settings.bag!r}: {error}') from error
            pace = 'in lockstep' if settings.lockstep else f'at rate {settings.rate:g}'
            self.get_logger().info(f'playing {settings.bag}: {self._replay.total} messages {pace}')
            self._range = playback_range(reader, settings.start_offset, settings.playback_until)
            awaited = self._topics_to_wait_for(reader)
            if settings.lockstep:
                frames = find_topic(reader, interfaces.JOINT_STATES.name).name
                window, timeout = settings.lockstep_window, settings.lockstep_timeout
                self._replay.set_lockstep(Lockstep(self, frames, window, timeout))
            else:
                chosen = {topic.rpartition('/')[2] for topic in settings.topics}
                self._replay.suppress_beside_analyser(chosen)
        self._playing = PlaybackThread(self._replay, self._playback, settings, limits, awaited)
        self.diagnostics = Diagnostics(self, 'playing', self.reporting(self._report))
        self._offer_services()
        self._keyboard = self._read_keys()
        self._paused = False
        self._begun = False

    def activate(self) -> None:
        """Start or resume the playback."""
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
        """Stop the playback, and restore the settings of the terminal."""
        self._playing.stop()
        self._keyboard.close()

    @property
    def finished(self) -> bool:
        """Whether the playback has reached its end or failed, and `stay` is not set."""
        return self.configured and self._playing.finished and not self._settings.stay

    @property
    def failure(self) -> Exception | None:
        """Error that ended the playback, or None if no error has occurred."""
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

    def _report(self) -> Report:
        lockstep = self._replay.lockstep
        given_up = lockstep.given_up if lockstep else 0
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

    def _read_keys(self) -> Keyboard:
        clock = self._playback
        keys = {
            SPACE: clock.toggle,
            RIGHT: clock.play_next,
            UP: lambda: self._change_rate(_FASTER),
            DOWN: lambda: self._change_rate(1 / _FASTER),
        }
        reading = Keyboard(lambda key: self.active and key in keys and keys[key]())
        if reading.taken:
            self.get_logger().info(_HELP)
        return reading

    def _change_rate(self, factor: float) -> None:
        low, high = RATES
        self._playback.set_rate(min(max(self._playback.rate * factor, low), high))

    def _offer_services(self) -> None:
        clock = self._playback
        serve(self, 'pause', 'Pause', lambda _: self._pause_by(clock.pause))
        serve(self, 'resume', 'Resume', lambda _: self._pause_by(clock.resume))
        serve(self, 'toggle_paused', 'TogglePaused', lambda _: self._pause_by(clock.toggle))
        serve(self, 'play_next', 'PlayNext', lambda _: self._play_next())
        serve(self, 'burst', 'Burst', self._burst)
        serve(self, 'seek', 'Seek', lambda request: self._seek(time_from_msg(request.time)))
        serve(self, 'play', 'Play', self._play)
        serve(self, 'stop', 'Stop', lambda _: self._stop())
        serve(self, 'set_rate', 'SetRate', lambda request: self._set_rate(request.rate))
        serve_value(self, 'is_paused', 'IsPaused', 'paused', lambda: clock.paused)
        serve_value(self, 'get_rate', 'GetRate', 'rate', lambda: clock.rate)

    def _pause_by(self, act: Callable[[], None]) -> Reply:
        act()
        return Reply('paused' if self._playback.paused else 'playing')

    def _play_next(self) -> Reply:
        if not self._playback.play_next():
            raise ValueError(self._no_step())
        return Reply('played one message')

    def _burst(self, request: Any) -> Reply:
        wanted = getattr(request, 'num_messages', 0)
        passed = self._playback.burst(wanted)
        if not passed:
            raise ValueError(self._no_step())
        more = ', the rest follows' if self._playback.stepping else ''
        return Reply(f'played {passed} messages{more}', {'actually_burst': passed})

    def _no_step(self) -> str:
        if self._playback.paused:
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
        self._playback.seek(stamp)
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
        paused = ', after ~/resume' if self._playback.paused else ''
        return Reply(f'plays from {begin:.3f} to {end:.3f} s{paused}')

    def _stop(self) -> Reply:
        was_playing = self._playing.playing
        self._playing.stop()
        return Reply('stopped; ~/play starts again' if was_playing else 'nothing was playing')

    def _set_rate(self, rate: float) -> Reply:
        low, high = RATES
        if not low <= rate <= high:
            raise ValueError(f'rate = {rate:g} must lie in the range {low:g} to {high:g}')
        self._playback.set_rate(rate)
        return Reply(f'{rate:g} times as fast as recorded')
