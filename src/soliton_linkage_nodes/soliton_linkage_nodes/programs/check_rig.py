# SPDX-License-Identifier: Apache-2.0
"""Check the joint states of a rig, and write a report page.

The program receives joint_states for ten seconds while nobody touches the rig. Then it asks you to
turn rotor 0 and the last rotor by hand. The program reads the description of the chain from the
topic chain. To use a parameter file instead, add --ros-args -p chain_from:=parameters
--params-file FILE.
"""

from __future__ import annotations

import argparse
import math
import sys
import threading
import time
from bisect import bisect_right
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState

from soliton_linkage.command_line import PlainParser
from soliton_linkage.identification.readings import interpolated
from soliton_linkage.identification.rig_bonds import WRONG, RigFinding
from soliton_linkage.identification.rig_check import (
    RigFindings,
    Turn,
    WatchedFrames,
    check_rig,
    first_turn,
    is_at_edge,
    is_resting,
)
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage.progress import ProgressLine
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.chain_source import (
    ChainSourceParameters,
    declare_chain,
    describe_chain,
    with_joints,
)
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_from_msg,
    joint_states_from_msg,
)
from soliton_linkage_nodes.messages.frames import FrameAssembler, FrameReader
from soliton_linkage_nodes.programs.command_line import (
    add_output,
    add_quantity,
    parse_own_arguments,
    ros_client,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.parameters import declare
from soliton_linkage_nodes.runtime.process import WaitingNode
from soliton_linkage_nodes.runtime.stamps import SECOND, nanoseconds_of
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription
from soliton_linkage_studies.pictures import rig_page

_CHAIN_WAIT = 3.0
"""Longest wait for a message on the topic chain after the first message on joint_states [s]."""
_POLL = 0.1
"""Interval between two evaluations of the condition that the program waits for [s]. It is long,
because an evaluation may decode many messages and therefore needs much processor time."""
_LATEST = 20
"""Number of latest messages that give the current angles [1]. A single message may lack some
rotors."""
_AT_REST = 1.0
"""The chain counts as resting if it has not moved for this time [s]."""
_AFTER_TURN = 2.0
"""After a rotor has turned, the program records frames for this time [s]."""


class CheckRig(WaitingNode):
    """Node that records joint states while a person turns rotors of the rig."""

    def __init__(self, stopping: threading.Event, **kwargs: Any) -> None:
        super().__init__('check_rig', stopping, **kwargs)
        self.named: NamedChain | None = None
        self._joints = self._source.joint_names
        self._chains: list[msg.Chain] = []
        self._received: list[tuple[int, JointState]] = []
        self._joint_states = AdaptiveSubscription(self, interfaces.JOINT_STATES, self.receive)
        if self._source.chain_from == 'parameters':
            self.named = with_joints(self._given, self._joints)
        else:
            AdaptiveSubscription(self, interfaces.CHAIN, self._chains.append)

    def declare_own(self) -> None:
        """Declare the parameters of the source of the chain."""
        self._source, self._given = declare(self, ChainSourceParameters), declare_chain(self)

    def check(self, seconds: float, limit: float, turn: bool) -> RigFindings | None:
        """Watch the rig at rest for `seconds` [s], and return the findings, or None after Ctrl-C.

        If `turn` is set, the method also asks a person to turn rotors. Each wait for the person or
        for frames takes at most `limit` [s]. If no rotor turns in this time, a finding reports it.
        Raises ValueError if no frames arrive.
        """
        if not self._wait(lambda: self._received, limit) and not self.stopping.is_set():
            raise ValueError(
                f'no joint_states within {limit:g} s; start serial_encoders, camera_encoders or '
                'your own driver'
            )
        if self._wait(lambda: self.named or self._chains, _CHAIN_WAIT) and self._chains:
            self.named = with_joints(chain_from_msg(self._chains[-1]), self._joints)
        self._received.clear()
        self._watch(seconds, 'watching; do not touch the rig')
        if self.stopping.is_set():
            return None
        if not self._received:
            raise ValueError('joint_states stopped before the check; keep its publisher running')
        names, watched = self.joint_names, self._frames(0)
        edges = [(0, True), (len(names) - 1, False)]
        if not is_at_edge(self._resting_angles(), first=True):
            edges.reverse()
        mixed = self._mixed_publishers()
        asked = [self._turn(*edge, limit) for edge in edges] if turn and not mixed else []
        if self.stopping.is_set():
            return None
        turns = [each for each in asked if each is not None]
        found = check_rig(watched, turns, names, self.named.chain if self.named else None)
        return replace(found, findings=(*mixed, *found.findings))

    def _mixed_publishers(self) -> list[RigFinding]:
        """Return a finding if several nodes publish the same joints."""
        self._joint_states.adapt()
        publishers = self._joint_states.publishers
        groups = {frozenset(message.name) for _, message in self._received}
        joints = frozenset[str]().union(*groups)
        shared = len(groups) >= len(publishers) and sum(map(len, groups)) == len(joints)
        if len(publishers) < 2 or shared:
            return []
        nodes = sorted(map(interfaces.node_of, publishers))
        text = (
            f'{len(nodes)} nodes publish the same joints: {" and ".join(nodes)}; their frames '
            'mix, so that the other findings are not valid; stop all but one'
        )
        return [RigFinding(WRONG, 'nodes', text)]

    def _turn(self, rotor: int, first: bool, limit: float) -> Turn | None:
        """Ask a person to turn a rotor, and return the recorded frames.

        `first` is true for rotor 0 and false for the last rotor. Returns None if the chain does
        not come to rest.
        """
        moved = len(self._received)
        name = self.joint_names[rotor]
        if not is_at_edge(self._resting_angles(), first):
            print(
                f'Move the soliton to {name}: turn the rotors at the soliton one after the other '
                f'(within {limit:g} s) ...',
                flush=True,
            )
        self._wait(lambda: is_at_edge(self._resting_angles(), first) and self._rests(), limit)
        if not self._rests():
            print('The chain does not come to rest; add friction or stop it by hand.')
            return None
        begin, rest = len(self._received), self._resting_angles()
        print(
            f'Turn {name} by hand in the positive direction: clockwise, if you see rotor 0 on the '
            f'left and the last rotor on the right (within {limit:g} s) ...',
            flush=True,
        )

        def turned() -> bool:
            newest = self._frames(max(begin, len(self._received) - _LATEST))
            return first_turn(rest, newest.angles) is not None

        if self._wait(turned, limit):
            print('A rotor has turned. Release it.', flush=True)
            self._watch(_AFTER_TURN, 'recording the motion')
        return Turn(rotor, rest, self._frames(begin), self._frames(moved, begin))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints of the rig, in the order of the rotors.

        If the chain is unknown, the names come from the parameter `joint_names`. If this parameter
        is empty, they come from the first message.
        """
        if self.named is not None:
            return self.named.joint_names
        return self._joints or tuple(self._received[0][1].name)

    def receive(self, message: JointState) -> None:
        """Store a message with its time of arrival."""
        self._received.append((nanoseconds_of(self.get_clock()), message))

    def _wait(self, condition: Any, seconds: float) -> bool:
        polled = 0.0

        def poll() -> bool:
            nonlocal polled
            if time.monotonic() < polled + _POLL:
                return False
            polled = time.monotonic()
            return bool(condition())

        return self.wait(poll, seconds)

    def _watch(self, seconds: float, title: str) -> None:
        progress, begin = ProgressLine(title, round(10 * seconds)), time.monotonic()

        def over() -> bool:
            elapsed = time.monotonic() - begin
            progress.show(round(10 * elapsed), f'{len(self._received)} messages')
            return elapsed > seconds

        self._wait(over, 2 * seconds)
        progress.clear()

    def _rests(self) -> bool:
        before = nanoseconds_of(self.get_clock()) - round(_AT_REST * SECOND)
        then = bisect_right(self._received, before, key=itemgetter(0))
        frames = self._frames(max(then - _LATEST, 0), then), self._latest()
        return then > 0 and is_resting(np.concatenate([each.angles for each in frames]))

    def _resting_angles(self) -> Array:
        return np.asarray(interpolated(self._latest().angles)[-1])

    def _latest(self) -> WatchedFrames:
        return self._frames(max(len(self._received) - _LATEST, 0))

    def _frames(self, begin: int, end: int | None = None) -> WatchedFrames:
        names = self.joint_names
        assembler = FrameAssembler(names)
        reader = FrameReader(names, self.named.encoder_offsets if self.named else ())
        received, origin = self._received[begin:end], self._received[0][0]
        frames = [
            (arrived, frame)
            for arrived, message in received
            for frame in assembler.add(joint_states_from_msg(message))
        ]
        frames += [(received[-1][0], frame) for frame in assembler.flush()]
        times = [(frame.stamp or math.nan, arrived) for arrived, frame in frames]
        # Subtract nanoseconds, because seconds since 1970 would be rounded.
        seconds = [(each - origin) / SECOND for pair in times for each in pair]
        stamps, arrivals = np.array(seconds).reshape(-1, 2).T
        angles = np.array([reader.read(frame).angles for _, frame in frames])
        return WatchedFrames(stamps, arrivals, angles.reshape(-1, len(names)))


def main() -> None:
    """Check the rig; exit with 1 if something is wrong, with 130 after Ctrl-C."""
    parser = PlainParser(
        prog='check_rig', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    text = 'only watch; nobody turns rotors by hand'
    parser.add_argument('--no-turn', action='store_true', help=text)
    add_quantity(parser, '--seconds', Quantity('time of watching', 's', 0.1, 3600.0), 10.0)
    limit = Quantity('longest wait for frames and for each turn', 's', 0.1, 3600.0)
    add_quantity(parser, '--limit', limit, 60.0)
    add_output(parser, 'out/rig.html', 'report page')
    options = parse_own_arguments(parser)
    with ros_client('check_rig', CheckRig) as client:
        found = client.check(options.seconds, options.limit, not options.no_turn)
        described = describe_chain(client.named.chain) if client.named else 'no chain is known'
        names = client.joint_names if found else ()
        if found is not None:
            for each in found.findings:
                print(f'{each.verdict:9}{each.subject:9}{each.text}')
            path: Path = options.output
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(rig_page(found, names, described), encoding='utf-8')
            print(f'the report page is {path}')
            if not found.sound:
                sys.exit(1)
