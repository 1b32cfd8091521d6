# SPDX-License-Identifier: Apache-2.0
"""The bag player: what a bag holds, on the same topics and at the same pace."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.studies.progress import ProgressLine
from soliton_linkage_nodes.bags.play.keyboard import DOWN, RIGHT, SPACE, UP, Keyboard
from soliton_linkage_nodes.bags.play.lockstep import Lockstep
from soliton_linkage_nodes.bags.play.transport import Transport, Turn
from soliton_linkage_nodes.bags.read.older_messages import is_older
from soliton_linkage_nodes.bags.read.reading import (
    decoder,
    find_topic,
    last_before,
    latched,
    message_class,
    open_bag,
    read_messages,
)
from soliton_linkage_nodes.bags.services import serve, tell
from soliton_linkage_nodes.messages.conversions import time_from_msg, time_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.matching import wait_for_subscriber
from soliton_linkage_nodes.runtime.parameters import declare, refuse_unknown
from soliton_linkage_nodes.runtime.process import run

_POLL_INTERVAL = 0.02
_LONGEST_DELIVERY = 10.0
_RATES = (1e-3, 1e3)
_FASTER = 1.1
_SECOND = 10**9
_KEYS = 'space: pause; right: next message; up, down: faster, slower'


@dataclass(frozen=True)
class BagPlayerParameters:
    """Parameters of the player."""

    bag: str = quantity('', 'path of the bag to play')
    rate: float = quantity(1.0, 'how much faster than recorded', '', *_RATES)
    topics: tuple[str, ...] = quantity((), 'topics to play; empty for all in the bag')
    start_offset: float = quantity(0.0, 'time in the bag at which to begin', 's', 0.0)
    playback_until: float = quantity(
        0.0, 'time in the bag at which to end, 0 for that of the bag', 's', 0.0
    )
    loop: bool = quantity(False, 'whether to begin again at the end')
    start_paused: bool = quantity(False, 'play nothing until ~/resume is called')
    wait_for: tuple[str, ...] = quantity(
        (), 'topics that must have a subscriber before the start; empty for joint_states'
    )
    subscriber_timeout: float = quantity(
        5.0, 'how long to wait for each of these subscribers', 's', 0.0, 3600.0
    )
    publish_clock: bool = quantity(False, 'whether to publish the recorded time on /clock')
    lockstep: bool = quantity(
        False, 'play as fast as the analyser answers each frame with a soliton_state, not by time'
    )
    lockstep_window: int = quantity(
        100, 'frames that may be on their way to the analyser, in lockstep', '', 1, 1000
    )
    lockstep_timeout: float = quantity(
        5.0, 'how long to wait for an answer before frames are given up', 's', 0.1, 3600.0
    )


class BagPlayer(Node):
    """Publishes the messages of a bag as they are, paced by the times they were received at.

    Latched topics come first, with what they last said before the start or the instant sought,
    and nothing else is published before the topics in `wait_for` have subscribers, or
    `subscriber_timeout` is over. In lockstep, soliton states are not played but awaited.

    Publishes the topics of the bag, `/diagnostics` and, if asked to, `/clock`. Serves, with the
    types of rosbag2_interfaces, of the suite or std_srvs/Trigger, `~/pause`, `~/resume`,
    `~/toggle_paused`, `~/is_paused`, `~/play_next`, `~/seek`, `~/set_rate` and `~/get_rate`.
    Parameters: those of `BagPlayerParameters`.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Look into the bag and begin to play."""
        super().__init__('bag_player', **kwargs)
        self.settings = declare(self, BagPlayerParameters)
        refuse_unknown(self)
        if not self.settings.bag:
            raise ValueError("parameter bag of bag_player = '' must be the path of a bag")
        self._path = Path(self.settings.bag)
        self.finished = False
        self.failure: Exception | None = None
        self._played = 0
        self._decoders: dict[str, Callable[[bytes], Any]] = {}
        self._transport = Transport(
            self.settings.rate, self.settings.start_paused, not self.settings.lockstep
        )
        with open_bag(self._path) as reader:
            self._look_into(reader)
        self._clock_publisher = None
        if self.settings.publish_clock:
            topic = interfaces.CLOCK
            self._clock_publisher = self.create_publisher(topic.type, topic.name, topic.qos)
        self._diagnostics = Diagnostics(self, 'playing', self._report)
        self._offer_services()
        self._progress = ProgressLine(f'playing {self._path}', self._duration)
        self._stopping = threading.Event()
        self._keyboard = self._take_keys()
        self._thread = threading.Thread(target=self._run, name='playing')
        self._thread.start()

    def destroy_node(self) -> None:
        """Stop playing."""
        self._stopping.set()
        self._transport.stop()
        self._thread.join()
        self._keyboard.close()
        super().destroy_node()

    def _look_into(self, reader: Reader) -> None:
        """Find out what is to be played; raises ValueError where it is not in the bag."""
        connections = _chosen(reader, self.settings.topics)
        self._outlets = self._create_publishers(connections)
        self._origin, end = _span(reader)
        self._duration = (end - self._origin) / _SECOND
        self._start = self._origin + round(self.settings.start_offset * _SECOND)
        until = self.settings.playback_until
        self._end = min(end, self._origin + round(until * _SECOND)) if until else end
        if reader.message_count and not self._start < self._end:
            raise ValueError(
                f'parameter start_offset of bag_player = {self.settings.start_offset:g} must lie '
                f'before {(self._end - self._origin) / _SECOND:g} s, where playing ends'
            )
        self._awaited = [find_topic(reader, name).topic for name in self.settings.wait_for]
        if not self._awaited and _has(reader, interfaces.JOINT_STATES.name):
            self._awaited = [find_topic(reader, interfaces.JOINT_STATES.name).topic]
        self._lockstep: Lockstep | None = None
        if self.settings.lockstep:
            frames = find_topic(reader, interfaces.JOINT_STATES.name).topic
            states = f'{frames.rpartition("/")[0]}/{interfaces.SOLITON_STATE.name}'
            self._outlets.pop(states, None)
            self._frames = frames
            self._lockstep = Lockstep(
                self, states, self.settings.lockstep_window, self.settings.lockstep_timeout
            )
        self._total = sum(c.msgcount for c in connections if c.topic in self._outlets)

    def _create_publishers(self, connections: Sequence[Connection]) -> dict[str, Publisher]:
        outlets = {}
        for connection in connections:
            try:
                message_type = message_class(connection.msgtype)
                if is_older(connection):
                    self._decoders[connection.topic] = decoder(connection)
            except ValueError as error:
                self.get_logger().warning(f'{connection.topic} is not played: {error}')
                continue
            qos = interfaces.latched_qos() if latched(connection) else interfaces.stream_qos()
            outlets[connection.topic] = self.create_publisher(message_type, connection.topic, qos)
        return outlets

    def _offer_services(self) -> None:
        transport = self._transport
        serve(self, 'pause', 'Pause', lambda _: transport.pause())
        serve(self, 'resume', 'Resume', lambda _: transport.resume())
        serve(self, 'toggle_paused', 'TogglePaused', lambda _: transport.toggle())
        serve(self, 'play_next', 'PlayNext', lambda _: self._play_next())
        serve(self, 'seek', 'Seek', lambda request: self._seek(time_from_msg(request.time)))
        serve(self, 'set_rate', 'SetRate', lambda request: self._set_rate(request.rate))
        tell(self, 'is_paused', 'IsPaused', 'paused', lambda: transport.paused)
        tell(self, 'get_rate', 'GetRate', 'rate', lambda: transport.rate)

    def _take_keys(self) -> Keyboard:
        transport = self._transport
        keyboard = Keyboard(
            {
                SPACE: transport.toggle,
                RIGHT: transport.play_next,
                UP: lambda: self._set_rate(transport.rate * _FASTER),
                DOWN: lambda: self._set_rate(transport.rate / _FASTER),
            }
        )
        if keyboard.taken:
            self.get_logger().info(_KEYS)
        return keyboard

    def _play_next(self) -> str | None:
        return None if self._transport.play_next() else 'not paused, or at the end'

    def _seek(self, stamp: int) -> str | None:
        if self.finished or not self._origin <= stamp <= self._end:
            return f'{stamp} ns is not between {self._origin} and {self._end} ns, or it is over'
        self._transport.seek(stamp)
        return None

    def _set_rate(self, rate: float) -> str | None:
        low, high = _RATES
        if not low <= rate <= high:
            return f'rate = {rate:g} must lie in the range {low:g} to {high:g}'
        self._transport.set_rate(rate)
        return None

    def _run(self) -> None:
        try:
            with open_bag(self._path) as reader:
                self._play(reader)
            self._wait_for_delivery()
        except Exception as error:
            self.failure = error
        self.finished = True

    def _play(self, reader: Reader) -> None:
        connections = [
            c for c in _chosen(reader, self.settings.topics) if c.topic in self._outlets
        ]
        turn, start, waited = Turn.PLAY, self._start, False
        while turn is not Turn.STOP:
            ahead = self._send_latched(reader, connections, start)
            if not waited:
                waited = True
                self._wait_for_subscribers()
                self._wait_for_the_analyser()
            turn = self._play_from(reader, connections, start, ahead)
            if turn is Turn.SEEK:
                start = self._transport.take_sought()
            elif not self.settings.loop:
                break
            else:
                start = self._start
        self._progress.end(f'played {self._played} of {self._total} messages of {self._path}')

    def _play_from(
        self,
        reader: Reader,
        connections: Sequence[Connection],
        start: int,
        ahead: dict[str, int],
    ) -> Turn:
        """Play from an instant on, without what latched topics have said ahead of it."""
        self._transport.start(start)
        for connection, stamp, serialized in read_messages(reader, connections, start, self._end):
            if ahead.get(connection.topic) == stamp:
                del ahead[connection.topic]
                continue
            turn = self._transport.wait_for(stamp, partial(self._show, stamp))
            if turn is not Turn.PLAY:
                return turn
            if self._clock_publisher is not None:
                self._clock_publisher.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))
            self._publish(connection, serialized)
            self._show(stamp)
        return Turn.STOP if self._stopping.is_set() else Turn.PLAY

    def _send_latched(
        self, reader: Reader, connections: Sequence[Connection], start: int
    ) -> dict[str, int]:
        """Publish the last latched messages before an instant, or, with none, the first after.

        Return when those were received that come after.
        """
        ahead = {}
        for connection in filter(latched, connections):
            found = last_before(reader, connection, start)
            if found is None:
                found = next(
                    ((t, data) for _, t, data in read_messages(reader, [connection], start)), None
                )
                if found is not None:
                    ahead[connection.topic] = found[0]
            if found is not None:
                self._publish(connection, found[1])
        return ahead

    def _publish(self, connection: Connection, serialized: bytes) -> None:
        if connection.topic in self._decoders:
            serialized = serialize_message(self._decoders[connection.topic](serialized))
        if self._lockstep is None:
            self._outlets[connection.topic].publish(serialized)
        else:
            self._publish_in_step(self._lockstep, connection.topic, serialized)
        self._played += 1

    def _publish_in_step(self, lockstep: Lockstep, topic: str, serialized: bytes) -> None:
        """Send a frame when there is room, and anything else when all frames are answered."""
        stopped = self._stopping.is_set
        if topic == self._frames:
            lockstep.wait_for_room(stopped)
            lockstep.sent(serialized)
            self._outlets[topic].publish(serialized)
            return
        lockstep.settle(stopped)
        self._outlets[topic].publish(serialized)
        self._wait_until_acknowledged([self._outlets[topic]])

    def _wait_for_subscribers(self) -> None:
        limit = self.settings.subscriber_timeout
        for topic in self._awaited:
            if topic not in self._outlets or self._stopping.is_set():
                continue
            heard = wait_for_subscriber(self._outlets[topic], limit, self._stopping)
            if not heard and not self._stopping.is_set():
                self.get_logger().warning(
                    f'nothing subscribes to {topic} after {limit:g} s; playing to nobody'
                )

    def _wait_for_the_analyser(self) -> None:
        if self._lockstep is None:
            return
        limit = self.settings.subscriber_timeout
        deadline = time.monotonic() + limit
        while not self._lockstep.analysers and not self._stopping.wait(_POLL_INTERVAL):
            if time.monotonic() > deadline:
                raise ValueError(
                    f'nothing publishes {interfaces.SOLITON_STATE.name} after {limit:g} s; '
                    'start soliton_analyser, or set lockstep to false'
                )

    def _wait_for_delivery(self) -> None:
        """Stay until every subscriber has what was published, and the analyser its last frame."""
        self._wait_until_acknowledged(self._outlets.values())
        if self._lockstep is not None:
            self._lockstep.settle(self._stopping.is_set)

    def _wait_until_acknowledged(self, publishers: Iterable[Publisher]) -> None:
        deadline = time.monotonic() + _LONGEST_DELIVERY
        for publisher in publishers:
            while time.monotonic() < deadline and not self._stopping.is_set():
                if publisher.wait_for_all_acked(Duration(seconds=_POLL_INTERVAL)):
                    break

    def _show(self, stamp: int) -> None:
        at = (stamp - self._origin) / _SECOND
        pace = 'in lockstep' if self._lockstep else f'x {self._transport.rate:.3g}'
        state = 'paused' if self._transport.paused else pace
        self._progress.show(at, f'{at:.1f} of {self._duration:.1f} s, {state}')

    def _report(self) -> Report:
        given_up = self._lockstep.given_up if self._lockstep else 0
        state = f'{self._played} of {self._total} messages played'
        if given_up:
            state = f'{state}, {given_up} frames never answered by the analyser'
        return Report(
            state,
            {
                'bag': self._path,
                'rate': self._transport.rate,
                'paused': self._transport.paused,
                'messages played': self._played,
                'messages': self._total,
            },
            warning=bool(given_up),
        )


def _has(reader: Reader, name: str) -> bool:
    return any(c.topic.rpartition('/')[2] == name for c in reader.connections)


def _span(reader: Reader) -> tuple[int, int]:
    """When the first message was received, and an instant after the last [ns]."""
    return (reader.start_time, reader.end_time) if reader.message_count else (0, 0)


def _chosen(reader: Reader, names: tuple[str, ...]) -> list[Connection]:
    """Return the topics to play; raises ValueError where the bag lacks one."""
    if not names:
        return list(reader.connections)
    return list({c.topic: c for c in (find_topic(reader, name) for name in names)}.values())


def _finished(player: BagPlayer) -> bool:
    if player.failure is not None:
        raise player.failure
    return player.finished


def main() -> None:
    """Run the player until the bag is played or it is told to stop."""
    run(BagPlayer, _finished)
