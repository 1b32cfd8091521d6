# SPDX-License-Identifier: Apache-2.0
"""Newest messages that describe a chain."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages import view_conversions as views
from soliton_linkage_nodes.messages.conversions import FRAME, NamedChain
from soliton_linkage_nodes.messages.frames import FrameReader, NewestFrame
from soliton_linkage_nodes.messages.marker_conversions import kick_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription, subscribe_newest

_FRESH = 1.0
"""Largest difference between the stamps of solitons and of angles that are drawn together [s]."""
_SILENT = 3.0
"""Largest age of a report that is shown [s]. Nodes report once per second."""
_LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')


class ObservedChain:
    """Newest angles, solitons, last kick and node reports of a chain."""

    def __init__(self, inbox: Node, owner: Node) -> None:
        """Subscribe to the topics of the chain. The node `owner` resolves their names.

        The node `inbox` has the subscriptions. It must not be added to an executor.
        """
        self.named: NamedChain | None = None
        self.angles: Array = np.zeros(0)
        """Angles [rad], shape (N,), with NaN for missing angles; empty before the first frame."""
        self.stamp = Time()
        """Stamp of the angles."""
        self.frame = FRAME
        """Name of the coordinate frame in the message with the angles."""
        self.frames = 0
        self.states = 0
        self.state_stamp = Time()
        self.numbers: views.Numbers = {}
        """Values of the latest soliton state by name."""
        joints = owner.resolve_topic_name(interfaces.JOINT_STATES.name)
        self._joints = NewestFrame(inbox, joints)
        self._states, self._kicks = (
            subscribe_newest(inbox, topic, owner.resolve_topic_name(topic.name))
            for topic in (interfaces.SOLITON_STATE, interfaces.LAST_KICK)
        )
        self._diagnostics = AdaptiveSubscription(inbox, interfaces.DIAGNOSTICS)
        self._reports: dict[str, tuple[float, views.NodeReport]] = {}
        self._reader: FrameReader | None = None
        self._walls: Sequence[msg.Soliton] = ()
        self._kick: msg.LastKick | None = None
        self._taken_at = -math.inf

    @property
    def age(self) -> float:
        """Time since the arrival of the latest angles [s]."""
        return time.monotonic() - self._taken_at

    @property
    def seconds(self) -> float:
        """Stamp of the latest angles [s]."""
        return time_from_msg(self.stamp) / SECOND

    @property
    def walls(self) -> Sequence[msg.Soliton]:
        """Walls (solitons) of the latest state.

        The result is empty if the stamps of state and angles differ by 1 s or more.
        """
        apart = self.seconds - time_from_msg(self.state_stamp) / SECOND
        return self._walls if abs(apart) < _FRESH else ()

    def set_chain(self, named: NamedChain) -> None:
        """Set the chain to which the following messages belong."""
        self.named = named
        self._reader = FrameReader(named.joint_names, named.encoder_offsets)
        self._joints.set_joints(named.joint_names)
        self.angles = np.zeros(0)

    def take(self) -> None:
        """Read all new messages. Raises ValueError if the joint states are of another chain."""
        state = self._states.newest()
        if state is not None:
            self._walls, self.state_stamp = state.solitons, state.header.stamp
            self.numbers = views.state_numbers(state)
            self.states += 1
        for message, _ in self._diagnostics.waiting():
            for report in views.reports_from_msg(message):
                self._reports[report.node] = (time.monotonic(), report)
        self._kick = self._kicks.newest() or self._kick
        joints = self._joints.take() if self._reader else None
        if self._reader is not None and joints is not None:
            self.angles = self._reader.read(joints).angles
            self.stamp, self.frame = time_to_msg(joints.stamp), joints.frame_id or FRAME
            self._taken_at = time.monotonic()
            self.frames += 1

    def describe(self) -> str:
        """Return a text about the chain and its nodes, one line per subject.

        The first line contains the position of the chain on its periodic orbit: phase, leg and
        number of cycles, which the message Cycle defines. The second line contains the energies.
        Each of these lines is omitted if its values are unknown. The next
        lines are the node reports with a warning or an error or, if there is none, the number of
        nodes that report OK.
        """
        numbers, lines = self.numbers, []
        if math.isfinite(numbers.get('phase', math.nan)):
            lines.append(
                f'phase {numbers["phase"]:.2f} rad, leg {numbers["leg"]:.0f}, '
                f'{numbers["completed"]:.0f} cycles'
            )
        kinetic, elastic = (numbers.get(name, math.nan) for name in ('kinetic', 'elastic'))
        if math.isfinite(elastic):
            moving = f'kinetic {1e3 * kinetic:.3f} mJ, ' if math.isfinite(kinetic) else ''
            lines.append(f'{moving}elastic {1e3 * elastic:.3f} mJ')
        oldest = time.monotonic() - _SILENT
        fresh = [report for taken_at, report in self._reports.values() if taken_at > oldest]
        bad = sorted((report for report in fresh if report.level), key=lambda bad: -bad.level)
        lines += [
            f'{_LEVELS[min(report.level, 3)]} {report.node.lstrip("/")}: {report.message}'
            for report in bad
        ]
        if fresh and not bad:
            lines.append(f'{len(fresh)} nodes OK')
        return '\n'.join(lines)

    def kick(self, shown: float) -> Array | None:
        """Return the impulses of the last kick [N m s], shape (N,), or None if it is not shown.

        A kick is shown until `shown` [s] after its end. If `shown` is 0, it is shown until the
        next kick.
        """
        if self._kick is None or self.named is None:
            return None
        start = time_from_msg(self._kick.header.stamp) / SECOND
        over = self.seconds - start - self._kick.duration
        if shown and not -self._kick.duration - _FRESH <= over <= shown:
            return None
        return kick_from_msg(self.named, self._kick)

    def adapt(self) -> None:
        """Adapt the quality of service of the subscriptions to new publishers."""
        for topic in (self._joints, self._states, self._kicks):
            topic.adapt()
