# SPDX-License-Identifier: Apache-2.0
"""Reading of angles and rates from joint states, and checks of the stamps and the angle unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from soliton_linkage.identification.mounting import in_degrees
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import LARGEST_ANGLE
from soliton_linkage_nodes.messages import conversions
from soliton_linkage_nodes.messages.conversions import Frame, JointStates
from soliton_linkage_nodes.runtime.stamps import SECOND


class FrameReader:
    """Reader of the angles and rates of all rotors from joint states."""

    def __init__(self, joint_names: Sequence[str], encoder_offsets: Sequence[float] = ()) -> None:
        if not joint_names:
            raise ValueError('joint_states.name is empty; name the joints')
        self._offsets = np.array(encoder_offsets, dtype=np.float64)
        self.joint_names = tuple(joint_names)
        self._rotors = {name: rotor for rotor, name in enumerate(joint_names)}
        self._names: tuple[str, ...] | None = None
        self._joints = self._positions = np.zeros(0, dtype=np.intp)
        self._in_order = False

    def read(self, joints: JointStates) -> Frame:
        """Return angles [rad] and rates [rad/s] of all rotors; ValueError for an invalid message.

        Missing values, and values with an absolute value above 1e9, are NaN.
        """
        _, _, _, name, position, velocity = joints
        conversions.check_length('joint_states.position', name, position)
        if name is not self._names and name != self._names:
            self._set_names(name)
        angles = conversions.without_offsets(self._ordered(position), self._offsets)
        if not len(velocity):
            return Frame(angles, None)
        conversions.check_length('joint_states.velocity', name, velocity)
        return Frame(angles, self._ordered(velocity))

    def _set_names(self, names: tuple[str, ...]) -> None:
        conversions.check_names('joint_states.name', names)
        known = [(joint, self._rotors[n]) for joint, n in enumerate(names) if n in self._rotors]
        if not known:
            first = next(iter(self._rotors))
            raise ValueError(
                f'joint_states.name has none of the {len(self._rotors)} rotors, such as '
                f'{first!r}; set the parameter joint_names'
            )
        self._joints, self._positions = np.array(known, dtype=np.intp).T
        self._in_order = names == self.joint_names
        self._names = names

    def _ordered(self, values: Array) -> Array:
        values = values.copy()
        if not np.maximum.reduce(np.abs(values), initial=0.0) <= LARGEST_ANGLE:
            values[~(np.abs(values) <= LARGEST_ANGLE)] = np.nan
        if self._in_order:
            return values
        ordered = np.full(len(self._rotors), np.nan)
        ordered[self._positions] = values[self._joints]
        return ordered


_LONGEST_LATENESS = SECOND
"""A frame is late if its stamp is earlier than the previous one by at most this [ns]. A larger
difference means that the clock was reset."""
_UNIT_CHECK_INTERVAL = 100
"""The angle unit is checked in one of this number of frames [1], because a check takes 80 us."""


class EncoderMonitor:
    """Monitor that warns once if joint states have wrong stamps or an unusual angle unit."""

    def __init__(self, warn: Callable[[str], object]) -> None:
        self._warn = warn
        self._warned: set[str] = set()
        self._last: int | None = None
        self._frames = 0

    def check(self, stamp: int, angles: Array | None = None) -> None:
        """Check the stamp of a frame [ns] and the unit of its angles, which may contain NaN."""
        if stamp == 0:
            self._warn_once(
                'joint_states have no stamps; stamp each frame with the time of its measurement, '
                'or set parameter stamps of soliton_analyser to arrival'
            )
        elif self._last is not None and 0 <= self._last - stamp <= _LONGEST_LATENESS:
            before = self._last - stamp
            how = f'{before / SECOND:g} s before' if before else 'equal to'
            self._warn_once(
                f'joint_states are not in order: a stamp is {how} the previous one; '
                'publish each frame once, in the order of their stamps',
                'late',
            )
        self._last = stamp
        if angles is not None and self._frames % _UNIT_CHECK_INTERVAL == 0 and in_degrees(angles):
            self._warn_once('the angles in joint_states look like degrees; publish radians')
        self._frames += 1

    def _warn_once(self, fault: str, kind: str = '') -> None:
        if (kind or fault) not in self._warned:
            self._warned.add(kind or fault)
            self._warn(fault)
