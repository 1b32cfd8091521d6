# SPDX-License-Identifier: Apache-2.0
"""Joint states in the order of the rotors, as far as they show them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import LARGEST_ANGLE
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    JointStates,
    check_length,
    check_names,
    without_offsets,
)


class FrameReader:
    """Reads joint states in the order of the rotors, as far as they show them."""

    def __init__(self, joint_names: Sequence[str], encoder_offsets: Sequence[float] = ()) -> None:
        """Read these joints, rotor 0 first, whose encoders have known offsets [rad], or none.

        Raises ValueError where there are no joints.
        """
        if not joint_names:
            raise ValueError('joint_states.name is empty; name the joints')
        self._offsets = np.array(encoder_offsets, dtype=np.float64)
        self.joint_names = tuple(joint_names)
        self._rotors = {name: rotor for rotor, name in enumerate(joint_names)}
        self._names: tuple[str, ...] | None = None
        self._joints = self._places = np.zeros(0, dtype=np.intp)
        self._as_they_are = False

    def read(self, joints: JointStates) -> Frame:
        """Angles and rates of all rotors, NaN where the joint states do not tell them.

        They do not where a value is infinite or beyond 1e9, which no encoder shows. Joints that
        are no rotors are passed over. Raises ValueError where no rotor is named, or a joint is
        twice, and for arrays that are not as long as that of the names.
        """
        _, _, _, name, position, velocity = joints
        check_length('joint_states.position', name, position)
        if name is not self._names and name != self._names:
            self._learn(name)
        angles = without_offsets(self._ordered(position), self._offsets)
        if not len(velocity):
            return Frame(angles, None)
        check_length('joint_states.velocity', name, velocity)
        return Frame(angles, self._ordered(velocity))

    def _learn(self, names: tuple[str, ...]) -> None:
        check_names('joint_states.name', names)
        known = [(joint, self._rotors[n]) for joint, n in enumerate(names) if n in self._rotors]
        if not known:
            first = next(iter(self._rotors))
            raise ValueError(
                f'joint_states.name has none of the {len(self._rotors)} rotors, whose first is '
                f'{first!r}; tell the names of the joints by the parameter joint_names'
            )
        self._joints, self._places = np.array(known, dtype=np.intp).T
        self._as_they_are = names == self.joint_names
        self._names = names

    def _ordered(self, values: Array) -> Array:
        values = values.copy()
        if not np.maximum.reduce(np.abs(values), initial=0.0) <= LARGEST_ANGLE:
            values[~(np.abs(values) <= LARGEST_ANGLE)] = np.nan
        if self._as_they_are:
            return values
        ordered = np.full(len(self._rotors), np.nan)
        ordered[self._places] = values[self._joints]
        return ordered
