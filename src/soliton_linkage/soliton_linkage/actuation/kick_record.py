# SPDX-License-Identifier: Apache-2.0
"""What was asked of the actuator and what became of it, from its own sums or the simulator's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from soliton_linkage.actuation.edge_command import EdgeCommand
from soliton_linkage.dynamics.work import TorqueLedger
from soliton_linkage.linkage.chain import Array

_PATIENCE = 10**9 // 2
"""How long the simulator's account is waited for [ns], in the time of the frames: many frames of
the slowest simulator, and no longer than a person waits for an answer."""


@dataclass(frozen=True)
class DeliveryTotals:
    """What has been done to the chain by the instant of a frame, as the simulator measured it."""

    stamp: int
    """Of the frame [ns]."""
    impulses: int
    """How many messages of impulses have acted."""
    work_of_impulses: float
    """In joules."""
    torques_act: bool
    """Whether torques acted over the period before the frame."""
    work_of_torques: float
    """In joules."""
    impulse_of_torques: Array
    """On each rotor [N m s], shape (N,)."""


@dataclass(frozen=True)
class KickReport:
    """What one kick, or torques from the first to the last, were and did."""

    stamp: int
    """Of the frame that it began with [ns]."""
    source: str
    """Topics that it came by."""
    command: EdgeCommand | None
    """Of the edge actuator; None where joints were commanded."""
    duration: float
    """How long torques acted [s]."""
    impulse: Array
    """On each rotor [N m s], shape (N,)."""
    work: float
    """On the chain [J]."""
    peak_torque: float
    """Norm over the rotors [N m]."""
    saturated: bool
    cut_short: bool
    measured: bool
    """Whether impulse and work are the simulator's."""


@dataclass(eq=False)
class _TorqueEpisode:
    """A stretch of torques, while it lasts and until it is settled."""

    stamp: int
    ledger: TorqueLedger
    before: DeliveryTotals | None
    sources: list[str] = field(default_factory=list)
    command: EdgeCommand | None = None
    saturated: bool = False
    cut_short: bool = False
    ended: int | None = None
    superseded: bool = False


@dataclass(frozen=True)
class _Impulse:
    stamp: int
    source: str
    command: EdgeCommand
    impulses: Array
    work: float


class KickRecord:
    """Follows what is sent to the rotors, and tells of each kick once it is over.

    Torques that were sent with one frame act from the next one on, until those that are sent
    with that one take their place; so it is reckoned where no `DeliveryTotals` comes.
    """

    def __init__(self, number_of_rotors: int, tell: Callable[[KickReport], None]) -> None:
        """`tell` takes each kick that is over."""
        self.measured = False
        """Whether somebody measures what is delivered."""
        self._rotors = number_of_rotors
        self._tell = tell
        self.delivered: DeliveryTotals | None = None
        """What the simulator has measured so far."""
        self._impulses: list[_Impulse] = []
        self._stretch: _TorqueEpisode | None = None
        self._ended: list[_TorqueEpisode] = []
        nothing: tuple[_TorqueEpisode | None, Array] = (None, np.zeros(number_of_rotors))
        self._acting, self._sent = nothing, nothing
        self._frame: tuple[int, Array] | None = None

    @property
    def open(self) -> bool:
        """Whether there is something to be told of."""
        return bool(self._impulses or self._ended or self._stretch)

    @property
    def waiting(self) -> int:
        """How many impulses were sent that are not measured yet."""
        return len(self._impulses)

    def kicked(
        self, stamp: int, source: str, command: EdgeCommand, impulses: Array, work: float
    ) -> None:
        """Note impulses that were sent [N m s], and the work that they do if they act now [J]."""
        kick = _Impulse(stamp, source, command, impulses, work)
        if self.measured:
            self._impulses.append(kick)
        else:
            self._tell_impulses([kick], kick.work, measured=False)

    def begin(self, stamp: int, source: str, command: EdgeCommand | None) -> None:
        """Note that torques begin, or that one more source joins in."""
        if self._stretch is None:
            before = None if self._ended else self.delivered
            self._stretch = _TorqueEpisode(stamp, TorqueLedger(self._rotors), before)
        if source not in self._stretch.sources:
            self._stretch.sources.append(source)
        self._stretch.command = command or self._stretch.command

    def interrupt(self) -> None:
        """Note that frames failed to come for long while torques acted."""
        if self._stretch is not None:
            self._stretch.cut_short = True

    def end(self, stamp: int, cut_short: bool = False, superseded: bool = False) -> None:
        """Note that torques are over, or that others take their place from this frame on."""
        if self._stretch is not None:
            self._stretch.ended, self._stretch.superseded = stamp, superseded
            self._stretch.cut_short |= cut_short
            self._ended.append(self._stretch)
            self._stretch = None

    def sent(self, torques: Array, saturated: bool) -> None:
        """Note the torques that were sent with the current frame [N m], shape (N,)."""
        self._sent = (self._stretch, torques)
        if self._stretch is not None:
            self._stretch.saturated |= saturated

    def frame(self, stamp: int, angles: Array) -> None:
        """Note a frame of joint states: stamp [ns], angles [rad], shape (N,)."""
        if self._frame is not None:
            before, angles_before = self._frame
            stretch, torques = self._acting
            if stretch is not None:
                stretch.ledger.add(torques, angles - angles_before, (stamp - before) / 1e9)
        self._acting, self._sent = self._sent, (None, 0 * angles)
        self._frame = (stamp, angles)
        self._settle(stamp)
        if not self.open:
            self._frame = None

    def deliver(self, delivered: DeliveryTotals) -> None:
        """Note what the simulator has measured."""
        before = self.delivered
        self.delivered = delivered
        count = delivered.impulses - (before.impulses if before else 0)
        if self._impulses and count > 0:
            kicks, self._impulses = self._impulses[:count], self._impulses[count:]
            work = delivered.work_of_impulses - (before.work_of_impulses if before else 0.0)
            self._tell_impulses(kicks, work, measured=True)
        if self._ended:
            stretch = self._ended[0]
            over = stretch.superseded or not delivered.torques_act
            if over and delivered.stamp > (stretch.ended or 0):
                self._close(delivered)

    def abandon(self, stamp: int) -> None:
        """Tell of torques whose chain is gone as far as they went."""
        self.end(stamp, cut_short=True)
        while self._ended:
            self._close(None)

    def _settle(self, stamp: int) -> None:
        """Tell of what nobody will measure any more."""
        late = [kick for kick in self._impulses if stamp - kick.stamp > _PATIENCE]
        if late:
            del self._impulses[: len(late)]
            self._tell_impulses(late, 0.0, measured=True, refused=True)
        while self._ended:
            stretch = self._ended[0]
            at_work = self._acting[0] is stretch or self._sent[0] is stretch
            patient = self.measured and stamp - (stretch.ended or 0) <= _PATIENCE
            if at_work or patient:
                return
            self._close(self.delivered if self.measured else None)

    def _close(self, after: DeliveryTotals | None) -> None:
        stretch = self._ended.pop(0)
        account = stretch.ledger.totals
        impulse, work = account.impulse, account.work
        if after is not None:
            before = stretch.before
            impulse = after.impulse_of_torques - (before.impulse_of_torques if before else 0.0)
            work = after.work_of_torques - (before.work_of_torques if before else 0.0)
            following = self._ended[0] if self._ended else self._stretch
            if following is not None:
                following.before = after
        self._tell(
            KickReport(
                stretch.stamp,
                ', '.join(stretch.sources),
                stretch.command,
                account.duration,
                impulse,
                work,
                account.peak_torque,
                stretch.saturated,
                stretch.cut_short,
                after is not None,
            )
        )

    def _tell_impulses(
        self, kicks: list[_Impulse], work: float, measured: bool, refused: bool = False
    ) -> None:
        impulse = np.sum([kick.impulses for kick in kicks], axis=0) * (not refused)
        last = kicks[-1]
        sources = ', '.join(dict.fromkeys(kick.source for kick in kicks))
        self._tell(
            KickReport(
                last.stamp,
                sources,
                last.command,
                0.0,
                impulse,
                work,
                0.0,
                False,
                refused,
                measured,
            )
        )
