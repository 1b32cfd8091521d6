# SPDX-License-Identifier: Apache-2.0
"""The latest joint states, kept as they came and decoded when they are needed."""

from __future__ import annotations

from collections.abc import Callable

from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.conversions import Frame, NamedChain, frame_from_msg
from soliton_linkage_nodes.runtime.stamps import SECOND, Freshness


class LatestFrames:
    """The last two frames of joint states, of which only fresh ones are acted on."""

    def __init__(self, longest: float, look: Callable[[int, Array], None]) -> None:
        """Joint states that are older than `longest` [s] are not acted on.

        `look` is called once with the stamp [ns] and angles [rad] of each frame that is read.
        """
        self.freshness = Freshness(longest)
        self.taken = 0
        """How many frames have come."""
        self._longest = longest
        self._look = look
        self._looked_at = 0
        self._decoder = JointStateDecoder()
        self._previous: bytes | None = None
        self._latest: bytes | None = None

    def take(self, serialized: bytes) -> None:
        """Keep joint states, given as CDR bytes."""
        self._previous, self._latest = self._latest, serialized
        self.taken += 1
        self.freshness.renew()

    def check_fresh(self) -> bytes:
        """Return the latest joint states; ValueError where they are too old."""
        if self._latest is None or self.freshness.stale:
            raise ValueError(
                f'no fresh joint_states: {self.freshness}, the limit is {self._longest:g} s; '
                'start or resume the simulator, or raise state_timeout'
            )
        return self._latest

    def read(self, named: NamedChain) -> tuple[Frame, int]:
        """Return a fresh frame and its stamp [ns], or ValueError."""
        joints = self._decoder.decode(self.check_fresh())
        frame = frame_from_msg(named, joints)
        if self._looked_at != self.taken:
            self._looked_at = self.taken
            self._look(joints.stamp, frame.angles)
        return frame, joints.stamp

    @property
    def stamp_before(self) -> int | None:
        """Stamp of the frame before the latest [ns]; None where there was none."""
        return None if self._previous is None else self._decoder.stamp(self._previous)

    def period(self, stamp: int) -> float | None:
        """Time from the frame before to a stamp [ns], in seconds; None where it is not known."""
        before = self.stamp_before
        return None if before is None or stamp <= before else (stamp - before) / SECOND
