# SPDX-License-Identifier: Apache-2.0
"""Joint states as they come, kept as the frames that a chain is identified by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.messages.frame_reader import FrameReader


class JointRecord:
    """Frames of joint states, evenly thinned out to a number that fits into memory and time."""

    def __init__(self, joint_names: Sequence[str], most: int) -> None:
        """Begin without any; the names are those of the joints, rotor 0 first."""
        self.joint_names = tuple(joint_names)
        self.frames = 0
        """How many came."""
        self._reader = FrameReader(joint_names)
        self._most, self._every = most, 1
        self._stamps: list[int] = []
        self._angles: list[Array] = []
        self._latest: int | None = None

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, joints: JointStates) -> None:
        """Keep a frame, unless it is not later than the one before.

        Raises ValueError for joint states that are refused.
        """
        angles = self._reader.read(joints).angles
        if self._latest is not None and joints.stamp <= self._latest:
            return
        self._latest = joints.stamp
        if self.frames % self._every == 0:
            self._stamps.append(joints.stamp)
            self._angles.append(angles)
            if len(self._stamps) > self._most:
                self._stamps, self._angles = self._stamps[::2], self._angles[::2]
                self._every *= 2
        self.frames += 1

    @property
    def thinned(self) -> int:
        """One frame of so many is kept."""
        return self._every

    def since_begin(self, stamp: int) -> float:
        """Time from the first frame to an instant [s], given its stamp [ns]."""
        return (stamp - self._stamps[0]) * 1e-9

    def readings(self) -> tuple[Array, Array]:
        """Times from the first frame on [s], shape (T,), and angles [rad], shape (T, N)."""
        stamps = np.array(self._stamps, dtype=np.int64)
        times = np.asarray((stamps - stamps[:1]) * 1e-9, dtype=np.float64)
        return times, np.array(self._angles)
