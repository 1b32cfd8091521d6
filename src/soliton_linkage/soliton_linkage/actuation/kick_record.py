# SPDX-License-Identifier: Apache-2.0
"""Record of commanded kicks and of the impulse and work that they deliver to the chain."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from soliton_linkage.actuation.edge_command import EdgeCommand
from soliton_linkage.dynamics.work import TorqueLedger
from soliton_linkage.linkage.chain import Array

DELIVERY_TIMEOUT = 2.0
"""Usual limit of the time between a kick and the totals from the simulator [s]. It is longer than
the lag at which a subscription skips frames."""


@dataclass(frozen=True)
class DeliveryTotals:
    """Impulse and work that the chain has received up to a frame, measured by the simulator."""

    stamp: int
    """Stamp of the frame [ns]."""
    impulses: int
    """Number of impulse messages that the simulator has applied."""
    work_of_impulses: float
    """Work of all impulses [J]."""
    torques_act: bool
    """Whether torques acted during the period before the frame."""
    work_of_torques: float
    """Work of all torques [J]."""
    impulse_of_torques: Array
    """Angular impulse of all torques on each rotor [N m s], shape (N,)."""


@dataclass(frozen=True)
class KickReport:
    """Report of one kick or of one episode.

    An episode is an interval in which torques act without a pause and without a new edge command.
    """

    stamp: int
    """Stamp of the frame after which the kick or the first torques were sent [ns]."""
    source: str
    """Topics of the commands, separated by commas."""
    command: EdgeCommand | None
    """Command to the edge actuator, or None if only joint commands act."""
    duration: float
    """Time during which torques acted [s]."""
    impulse: Array
    """Angular impulse on each rotor [N m s], shape (N,)."""
    work: float
    """Work on the chain [J]."""
    peak_torque: float
    """Largest norm of the vector of the torques on all rotors [N m]."""
    saturated: bool
    """Whether the torque of an actuator was reduced to its limit at some time."""
    cut_short: bool
    """Whether the command ended early or was rejected."""
    measured: bool
    """Whether `impulse` and `work` were measured by the simulator; otherwise they are computed."""


@dataclass(eq=False)
class _TorqueEpisode:
    stamp: int
    ledger: TorqueLedger
    before: DeliveryTotals | None
    sources: list[str] = field(default_factory=list)
    command: EdgeCommand | None = None
    saturated: bool = False
    cut_short: bool = False
    ended: int = 0
    superseded: bool = False
    ended_at: float = 0.0
    quiet: int | None = None
    """Stamp of the frame after the last torques other than zero were sent [ns]."""

    def included(self, totals: DeliveryTotals) -> bool:
        """Return whether the totals include the whole effect of this ended episode."""
        over = self.superseded or not totals.torques_act
        return self.quiet is None or (over and totals.stamp > min(self.ended, self.quiet))


@dataclass(frozen=True)
class _Impulse:
    sent_at: float
    stamp: int
    source: str
    command: EdgeCommand
    impulses: Array
    work: float


class KickRecord:
    """Record of the impulses and torques that were sent to the rotors.

    The function `report` is called with the report of each finished kick or episode. If the
    simulator does not publish `DeliveryTotals`, impulse and work are computed, with the assumption
    that torques sent after frame k act from frame k + 1 to frame k + 2. The current frame is the
    last one for which `frame` was called.

    A report waits for the totals, at most until both the stamps of the frames and `clock` [s] have
    advanced by more than `timeout` [s]. Stamps alone are not sufficient, because many frames may
    arrive at once after a delay.
    """

    def __init__(
        self,
        number_of_rotors: int,
        report: Callable[[KickReport], None],
        timeout: float = DELIVERY_TIMEOUT,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.measured = False
        """Whether a simulator publishes delivery totals."""
        self._rotors = number_of_rotors
        self._report = report
        self._timeout, self._clock = timeout, clock
        self.delivered: DeliveryTotals | None = None
        """Latest totals from the simulator."""
        self._impulses: list[_Impulse] = []
        self._episode: _TorqueEpisode | None = None
        self._ended: list[_TorqueEpisode] = []
        nothing: tuple[_TorqueEpisode | None, Array] = (None, np.zeros(number_of_rotors))
        self._acting, self._sent = nothing, nothing
        self._frame: tuple[int, Array] | None = None

    @property
    def open(self) -> bool:
        """Whether a report is pending."""
        return bool(self._impulses or self._ended or self._episode)

    @property
    def waiting(self) -> int:
        """Number of sent impulses that the simulator has not measured yet."""
        return len(self._impulses)

    def kicked(
        self, stamp: int, source: str, command: EdgeCommand, impulses: Array, work: float
    ) -> None:
        """Record sent impulses [N m s], shape (N,), and their work at the current rates [J].

        `stamp` is the stamp of the current frame [ns], and `source` is the topic of the command.
        """
        kick = _Impulse(self._clock(), stamp, source, command, impulses, work)
        if self.measured:
            self._impulses.append(kick)
        else:
            self._report_impulses([kick], kick.work, measured=False)

    def begin(self, stamp: int, source: str, command: EdgeCommand | None) -> None:
        """Start an episode at a stamp [ns], or add a source to the current episode.

        For a joint command, `command` is None.
        """
        if self._episode is None:
            before = None if self._ended else self.delivered
            self._episode = _TorqueEpisode(stamp, TorqueLedger(self._rotors), before)
        if source not in self._episode.sources:
            self._episode.sources.append(source)
        self._episode.command = command or self._episode.command

    def interrupt(self) -> None:
        """Mark the current torques as cut short by a gap between frames."""
        if self._episode is not None:
            self._episode.cut_short = True

    def end(self, stamp: int, cut_short: bool = False, superseded: bool = False) -> None:
        """End the current episode at a stamp [ns].

        `superseded` states whether a new edge command ended the episode. Other torques may then
        follow without a pause.
        """
        if self._episode is not None:
            self._episode.ended, self._episode.superseded = stamp, superseded
            self._episode.ended_at = self._clock()
            self._episode.cut_short |= cut_short
            self._ended.append(self._episode)
            self._episode = None

    def sent(self, torques: Array, saturated: bool) -> None:
        """Record the torques that are sent after the current frame [N m], shape (N,)."""
        self._sent = (self._episode, torques)
        if self._episode is not None:
            self._episode.saturated |= saturated

    def frame(self, stamp: int, angles: Array) -> None:
        """Process a frame with a stamp [ns] and the angles [rad], shape (N,)."""
        if self._frame is not None:
            before, angles_before = self._frame
            episode, torques = self._acting
            if episode is not None:
                episode.ledger.add(torques, angles - angles_before, (stamp - before) / 1e9)
        self._acting, self._sent = self._sent, (None, 0 * angles)
        episode, torques = self._acting
        if episode is not None and torques.any():
            episode.quiet = stamp
        self._frame = (stamp, angles)
        self._settle(stamp)
        if not self.open:
            self._frame = None

    def deliver(self, delivered: DeliveryTotals) -> None:
        """Process new totals from the simulator, and report the kicks that the totals include."""
        before = self.delivered
        self.delivered = delivered
        count = delivered.impulses - (before.impulses if before else 0)
        if self._impulses and count > 0:
            kicks, self._impulses = self._impulses[:count], self._impulses[count:]
            work = delivered.work_of_impulses - (before.work_of_impulses if before else 0.0)
            self._report_impulses(kicks, work, measured=True)
        if self._ended and self._ended[0].included(delivered):
            self._close(delivered)

    def abandon(self, stamp: int) -> None:
        """End the current torques at a stamp [ns] and report them as cut short."""
        self.end(stamp, cut_short=True)
        while self._ended:
            self._close(None)

    def _settle(self, stamp: int) -> None:
        late = [k for k in self._impulses if self._overdue(stamp - k.stamp, k.sent_at)]
        if late:
            del self._impulses[: len(late)]
            self._report_impulses(late, 0.0, measured=True, rejected=True)
        while self._ended:
            episode = self._ended[0]
            acting = self._acting[0] is episode or self._sent[0] is episode
            overdue = self._overdue(stamp - episode.ended, episode.ended_at)
            included = self.delivered is not None and episode.included(self.delivered)
            if acting or (self.measured and not (overdue or included)):
                return
            self._close(self.delivered if self.measured else None)

    def _overdue(self, age: int, since: float) -> bool:
        return min(age / 1e9, self._clock() - since) > self._timeout

    def _close(self, after: DeliveryTotals | None) -> None:
        episode = self._ended.pop(0)
        totals = episode.ledger.totals
        impulse, work = totals.impulse, totals.work
        if after is not None:
            before = episode.before
            impulse = after.impulse_of_torques - (before.impulse_of_torques if before else 0.0)
            work = after.work_of_torques - (before.work_of_torques if before else 0.0)
            following = self._ended[0] if self._ended else self._episode
            if following is not None:
                following.before = after
        origin = episode.stamp, ', '.join(episode.sources), episode.command
        flags = episode.saturated, episode.cut_short, after is not None
        peak = totals.peak_torque
        self._report(KickReport(*origin, totals.duration, impulse, work, peak, *flags))

    def _report_impulses(
        self, kicks: list[_Impulse], work: float, measured: bool, rejected: bool = False
    ) -> None:
        impulse = np.sum([kick.impulses for kick in kicks], axis=0) * (not rejected)
        last = kicks[-1]
        origin = last.stamp, ', '.join(dict.fromkeys(kick.source for kick in kicks)), last.command
        self._report(KickReport(*origin, 0.0, impulse, work, 0.0, False, rejected, measured))
