# SPDX-License-Identifier: Apache-2.0
"""Joint states in the order of the rotors, as far as they show them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

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
from soliton_linkage_nodes.runtime.stamps import SECOND


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


_LONGEST_LATENESS = SECOND
"""By which a frame may be late [ns]; the clock of one that is later was set anew, as of a bag."""
_FRAMES_BETWEEN_LOOKS = 100
"""Frames of which the unit of one is looked at: it costs 80 us and does not change."""
_BEYOND_RADIANS = 4.0
"""Angle that any frame in degrees exceeds [rad]: of two neighbours one is at 90 or more."""
_LARGEST_MISFIT = 0.2
"""Misfit of most neighbours in the right unit [1], even where a wall takes half the chain; degrees
taken for radians have 0.4 or more."""


class EncoderMonitor:
    """Looks at the frames of joint states for stamps and units that cannot be meant."""

    def __init__(self, warn: Callable[[str], object]) -> None:
        """`warn` is called with a line that says what is wrong and what to do, once for each."""
        self._warn = warn
        self._said: set[str] = set()
        self._last: int | None = None
        self._frames = 0

    def check(self, stamp: int, angles: Array) -> None:
        """Look at a frame: its stamp [ns] and the angle of each rotor [rad], NaN where unseen."""
        if stamp == 0:
            self._say('joint_states have no stamps; stamp each frame with when it was measured')
        elif self._last is not None and 0 <= self._last - stamp <= _LONGEST_LATENESS:
            before = self._last - stamp
            how = f'{before / SECOND:g} s before' if before else 'the same as'
            self._say(
                f'joint_states come late: the stamp of one is {how} that of the one before; '
                'publish each frame once, in the order of their stamps',
                'late',
            )
        self._last = stamp
        if self._frames % _FRAMES_BETWEEN_LOOKS == 0 and in_degrees(angles):
            self._say('the angles in joint_states look like degrees; publish radians')
        self._frames += 1

    def _say(self, what: str, kind: str = '') -> None:
        if (kind or what) not in self._said:
            self._said.add(kind or what)
            self._warn(what)


def in_degrees(angles: Array) -> bool:
    """Whether angles that should be in rad show a chain only if they are taken for degrees.

    Most neighbours of a chain lean alike, phi_n + phi_{n+1} = pi, whatever its parameters.
    """
    largest = np.nanmax(np.abs(angles), initial=0.0)
    return bool(
        np.isfinite(largest)
        and largest > _BEYOND_RADIANS
        and _misfit(angles) > _LARGEST_MISFIT
        and _misfit(np.deg2rad(angles)) < _LARGEST_MISFIT
    )


def _misfit(angles: Array) -> float:
    """Median of 1 + cos(phi_n + phi_{n+1}) over neighbours that are seen."""
    misfits = 1 + np.cos(angles[:-1] + angles[1:])
    seen = misfits[np.isfinite(misfits)]
    return float(np.median(seen)) if len(seen) else np.nan
