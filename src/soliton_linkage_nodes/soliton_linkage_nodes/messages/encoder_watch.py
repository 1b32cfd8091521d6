# SPDX-License-Identifier: Apache-2.0
"""Mistakes that are easily made with encoders of one's own, each said once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.runtime.stamps import SECOND

_LONGEST_LATENESS = SECOND
"""By which a frame may be late [ns]; the clock of one that is later was set anew, as of a bag."""
_FRAMES_BETWEEN_LOOKS = 100
"""Frames of which the unit of one is looked at: it costs 80 us and does not change."""
_BEYOND_RADIANS = 4.0
"""Angle that any frame in degrees exceeds [rad]: of two neighbours one is at 90 or more."""
_LARGEST_MISFIT = 0.2
"""Misfit of most neighbours in the right unit [1], even where a wall takes half the chain; degrees
taken for radians have 0.4 or more."""


class EncoderWatch:
    """Looks at the frames of joint states for stamps and units that cannot be meant."""

    def __init__(self, warn: Callable[[str], object]) -> None:
        """`warn` is called with a line that says what is wrong and what to do, once for each."""
        self._warn = warn
        self._said: set[str] = set()
        self._last: int | None = None
        self._frames = 0

    def look(self, stamp: int, angles: Array) -> None:
        """Look at a frame: its stamp [ns] and the angle of each rotor [rad], NaN where unseen."""
        if stamp == 0:
            self._say('joint_states have no stamps; stamp each frame with when it was measured')
        elif self._last is not None and 0 <= self._last - stamp <= _LONGEST_LATENESS:
            self._say_late(self._last - stamp)
        self._last = stamp
        if self._frames % _FRAMES_BETWEEN_LOOKS == 0 and in_degrees(angles):
            self._say('the angles in joint_states look like degrees; publish radians')
        self._frames += 1

    def _say_late(self, lateness: int) -> None:
        how = f'{lateness / SECOND:g} s before' if lateness else 'the same as'
        if 'late' not in self._said:
            self._said.add('late')
            self._warn(
                f'joint_states come late: the stamp of one is {how} that of the one before; '
                'publish each frame once, in the order of their stamps'
            )

    def _say(self, what: str) -> None:
        if what not in self._said:
            self._said.add(what)
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
