# SPDX-License-Identifier: Apache-2.0
"""The bag player: what a bag holds, on the same topics and at the same pace."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from rosbags.rosbag2 import Reader

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.bags.guards import BagLimits
from soliton_linkage_nodes.bags.play.controls import PlayerControls
from soliton_linkage_nodes.bags.play.lockstep import Lockstep
from soliton_linkage_nodes.bags.play.outlets import RecordedStates, ReplayOutlets
from soliton_linkage_nodes.bags.play.playing_thread import (
    PlayingThread,
    chosen,
    excerpt,
    full_name,
)
from soliton_linkage_nodes.bags.play.transport import RATES, Transport
from soliton_linkage_nodes.bags.read.reading import find_topic, open_bag
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.stamps import time_to_msg


@dataclass(frozen=True)
class BagPlayerParameters:
    """Parameters of the player."""

    bag: str = quantity('', 'path of the bag to play')
    rate: float = quantity(1.0, 'how much faster than recorded', '', *RATES)
    topics: tuple[str, ...] = quantity((), 'topics to play; empty for all in the bag')
    start_offset: float = quantity(0.0, 'time in the bag at which to begin', 's', 0.0)
    playback_until: float = quantity(
        0.0, 'time in the bag at which to end, 0 for that of the bag', 's', 0.0
    )
    loop: bool = quantity(False, 'whether to begin again at the end')
    stay: bool = quantity(False, 'whether to stay at the end of the bag, for ~/play')
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


class BagPlayer(ManagedNode):
    """Publishes the messages of a bag as they are, paced by the times they were received at.

    Latched topics come first, with what they last said before the start or the instant sought,
    and nothing else is published before the topics in `wait_for` have subscribers, or
    `subscriber_timeout` is over. In lockstep, soliton states are not played but awaited; else
    they are left out while an analyser publishes its own, unless `topics` names them.

    It ends with the bag, unless it is paused there or is to `stay`. After `~/stop` it waits for
    `~/play`, of all or a part; `~/burst` lets messages pass in a pause, as fast as they can.

    Publishes the topics of the bag, `/diagnostics` and, if asked to, `/clock`. Serves, with the
    types of rosbag2_interfaces, of the suite or std_srvs/Trigger, `~/pause`, `~/resume`,
    `~/toggle_paused`, `~/is_paused`, `~/play_next`, `~/seek`, `~/set_rate` and `~/get_rate`.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        BagPlayerParameters: '',
        BagLimits: '',
        ManagedParameters: '',
    }

    def __init__(self, **kwargs: Any) -> None:
        """Be configured and activated, unless a manager is to do that."""
        super().__init__('bag_player', **kwargs)

    def configure(self) -> None:
        """Look into the bag and open the topics."""
        self._settings = settings = current(self, BagPlayerParameters)
        limits = current(self, BagLimits)
        if not settings.bag:
            raise ValueError("parameter bag of bag_player = '' must be the path of a bag")
        self._transport = Transport(settings.rate, settings.start_paused, not settings.lockstep)
        self._lockstep: Lockstep | None = None
        with open_bag(Path(settings.bag), limits) as reader:
            self._outlets = ReplayOutlets(
                self, chosen(reader, settings.topics), self._transport.stopping
            )
            pace = 'in lockstep' if settings.lockstep else f'at rate {settings.rate:g}'
            self.get_logger().info(
                f'playing {settings.bag}: {self._outlets.total} messages {pace}'
            )
            self._excerpt = excerpt(reader, settings.start_offset, settings.playback_until)
            self._awaited = self._topics_to_wait_for(reader)
            if settings.lockstep:
                self._lockstep = self._keep_step(reader)
            else:
                self._give_way(reader)
        topic = interfaces.CLOCK
        self._clock_publisher = (
            self.create_publisher(topic.type, topic.name, topic.qos)
            if settings.publish_clock
            else None
        )
        self._playing = PlayingThread(
            Path(settings.bag),
            self._outlets,
            self._transport,
            settings.loop,
            self._prepare,
            self._tell_time,
            'in lockstep' if settings.lockstep else '',
            limits,
        )
        self.diagnostics = Diagnostics(self, 'playing', self.reporting(self._report))
        self._controls = PlayerControls(self, self._transport, self._playing, self._excerpt)
        self._paused = False
        self._begun = False

    def activate(self) -> None:
        """Begin to play, or go on."""
        if not self._begun:
            self._begun = True
            self._playing.play(self._excerpt)
        elif not self._paused:
            self._transport.resume()

    def deactivate(self) -> None:
        """Stand still."""
        self._paused = self._transport.paused
        self._transport.pause()

    def cleanup(self) -> None:
        """Stop playing and give the terminal back."""
        self._playing.stop()
        self._controls.close()

    @property
    def finished(self) -> bool:
        """Whether everything was played, and nothing else is to be."""
        return self.configured and self._playing.finished and not self._settings.stay

    @property
    def failure(self) -> Exception | None:
        """Why it could not go on."""
        return self._playing.failure if self.configured else None

    def _topics_to_wait_for(self, reader: Reader) -> list[str]:
        if self._settings.wait_for:
            return [find_topic(reader, name).topic for name in self._settings.wait_for]
        frames = full_name(reader, interfaces.JOINT_STATES.name)
        return [frames] if frames else []

    def _keep_step(self, reader: Reader) -> Lockstep:
        frames = find_topic(reader, interfaces.JOINT_STATES.name).topic
        settings = self._settings
        lockstep = Lockstep(self, frames, settings.lockstep_window, settings.lockstep_timeout)
        self._outlets.keep_step(lockstep)
        return lockstep

    def _give_way(self, reader: Reader) -> None:
        told = {topic.rpartition('/')[2] for topic in self._settings.topics}
        for connection in self._outlets.of(reader.connections):
            name = connection.topic.rpartition('/')[2]
            if name in (interfaces.SOLITON_STATE.name, interfaces.SOLITON_EVENTS.name):
                states = RecordedStates(self, connection.topic, name in told)
                self._outlets.give_way(states)

    def _prepare(self) -> None:
        self._outlets.wait_for_subscribers(self._awaited, self._settings.subscriber_timeout)

    def _tell_time(self, stamp: int) -> None:
        if self._clock_publisher is not None:
            self._clock_publisher.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))

    def _report(self) -> Report:
        given_up = self._lockstep.given_up if self._lockstep else 0
        state = f'played {self._playing.account()}'
        if given_up:
            state = f'{state}, {given_up} frames never answered by the analyser'
        return Report(
            state,
            {
                'bag': self._settings.bag,
                'rate': self._transport.rate,
                'paused': self._transport.paused,
                'messages played': self._outlets.published,
                'messages': self._outlets.total,
                'rounds': self._playing.rounds,
                'recorded states left out': self._outlets.left_out,
            },
            warning=bool(given_up),
        )


def _finished(player: BagPlayer) -> bool:
    if player.failure is not None:
        raise player.failure
    return player.finished


def main() -> None:
    """Run the player until the bag is played or it is told to stop."""
    run(BagPlayer, _finished)
