# SPDX-License-Identifier: Apache-2.0
"""What was last heard of a chain."""

from __future__ import annotations

import math
import time

import numpy as np
from builtin_interfaces.msg import Time

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.conversions import FRAME, NamedChain
from soliton_linkage_nodes.messages.frame_reader import FrameReader
from soliton_linkage_nodes.messages.marker_conversions import (
    Wall,
    kick_from_msg,
    walls_from_msg,
)
from soliton_linkage_nodes.messages.view_conversions import (
    NodeReport,
    Numbers,
    reports_from_msg,
    state_numbers,
)
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription

_FRESH = 1.0
"""Age beyond which walls are not those of the angles any more [s], in the time of the stamps."""
_SILENT = 3.0
"""Age beyond which a node is not heard any more [s]: it reports once a second."""
_MOST_REPORTS = 100
"""Diagnostics that are taken at a time: those of a second of many nodes."""


class HeardChain:
    """The newest angles, walls and kick of a chain."""

    def __init__(
        self,
        joints: AdaptiveSubscription,
        states: AdaptiveSubscription,
        kicks: AdaptiveSubscription,
        diagnostics: AdaptiveSubscription,
    ) -> None:
        """Know nothing yet."""
        self.named: NamedChain | None = None
        self.angles: Array = np.zeros(0)
        """Of the rotors [rad], shape (N,), NaN where they are not told; empty before they came."""
        self.stamp = Time()
        """Of the angles."""
        self.frame = FRAME
        """In which they are told."""
        self.frames = 0
        """How many came."""
        self.states = 0
        """How many states of the analyser came."""
        self.state_stamp = Time()
        """Of the walls."""
        self.numbers: Numbers = {}
        """What the latest state of the analyser says."""
        self._joints, self._states, self._kicks = joints, states, kicks
        self._diagnostics = diagnostics
        self._reports: dict[str, tuple[float, NodeReport]] = {}
        self._decoder = JointStateDecoder()
        self._reader: FrameReader | None = None
        self._walls: list[Wall] = []
        self._kick: msg.LastKick | None = None
        self._came = -math.inf

    @property
    def age(self) -> float:
        """Of the angles, by the clock that never goes back [s]."""
        return time.monotonic() - self._came

    @property
    def seconds(self) -> float:
        """Stamp of the angles [s]."""
        return time_from_msg(self.stamp) / SECOND

    @property
    def walls(self) -> list[Wall]:
        """Walls, none where they are much older than the angles, or younger."""
        apart = self.seconds - time_from_msg(self.state_stamp) / SECOND
        return self._walls if abs(apart) < _FRESH else []

    def learn(self, named: NamedChain) -> None:
        """Hear this chain from now on."""
        self.named = named
        self._reader = FrameReader(named.joint_names, named.encoder_offsets)
        self.angles = np.zeros(0)

    def take(self) -> None:
        """Take what has come; raises ValueError for joint states that are none of the chain."""
        state, kick = self._states.newest(), self._kicks.newest()
        if state is not None:
            self._walls, self.state_stamp = walls_from_msg(state), state.header.stamp
            self.numbers = state_numbers(state)
            self.states += 1
        self._take_reports()
        self._kick = kick or self._kick
        if self._reader is None:
            return
        serialized = self._joints.newest()
        if serialized is not None:
            joints = self._decoder.decode(serialized)
            self.angles = self._reader.read(joints).angles
            self.stamp, self.frame = time_to_msg(joints.stamp), joints.frame_id or FRAME
            self._came = time.monotonic()
            self.frames += 1

    def reports(self) -> list[NodeReport]:
        """What the nodes of the graph say of themselves, the worst first."""
        heard = time.monotonic() - _SILENT
        fresh = [report for came, report in self._reports.values() if came > heard]
        return sorted(fresh, key=lambda report: -report.level)

    def _take_reports(self) -> None:
        for _ in range(_MOST_REPORTS):
            message = self._diagnostics.newest()
            if message is None:
                return
            for report in reports_from_msg(message):
                self._reports[report.node] = (time.monotonic(), report)

    def kick(self, shown: float) -> Array | None:
        """Impulses of the last kick [N m s], shape (N,), unless it has been over for longer [s].

        A time of 0 is for ever.
        """
        if self._kick is None or self.named is None:
            return None
        begun = time_from_msg(self._kick.header.stamp) / SECOND
        over = self.seconds - begun - self._kick.duration
        if shown and not -self._kick.duration - _FRESH <= over <= shown:
            return None
        return kick_from_msg(self.named, self._kick)

    def adapt(self) -> None:
        """Hear publishers that came since, whatever they offer."""
        for topic in (self._joints, self._states, self._kicks):
            topic.adapt()
