# SPDX-License-Identifier: Apache-2.0
"""Driver that converts the commands for a chain into torques for each frame."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from soliton_linkage.actuation.actuators import Actuator
from soliton_linkage.actuation.edge_command import EdgeCommand
from soliton_linkage.actuation.kick_record import DELIVERY_TIMEOUT, KickRecord, KickReport
from soliton_linkage.actuation.torque_drive import Rotors, TorqueDrive
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array, Chain

_NANOSECONDS = 10**9
"""Nanoseconds per second."""


class _PendingCommand(NamedTuple):
    source: str
    begin: Callable[[float], None]
    command: EdgeCommand | None = None


class ChainDriver:
    """Driver of all actuators of a chain.

    A command starts at the next frame. At frame k, the driver returns the mean of the commanded
    torques from frame k to frame k + 1. It assumes that this interval is as long as the previous
    one. These torques are sent after frame k. In the simulator, they act from frame k + 1 to frame
    k + 2, so that every command acts with a delay of one frame period. The driver assumes the same
    delay for a real chain.

    After the end of a joint command, its last torques are held for `timeout` [s]. The function
    `report` is called with each finished `KickReport`. The report names the `source` of each
    command, which is the topic of the command. If the interval between two frames exceeds
    `longest_gap` [s], the current torques are reported as cut short. A report waits for the totals
    from the simulator for at most `longest_gap` or `DELIVERY_TIMEOUT`, whichever is longer.
    """

    def __init__(
        self,
        chain: Chain,
        actuator: Actuator,
        timeout: float,
        longest_gap: float,
        report: Callable[[KickReport], None],
    ) -> None:
        self.chain = chain
        patience = max(longest_gap, DELIVERY_TIMEOUT)
        self.record = KickRecord(chain.number_of_rotors, report, patience)
        self._drive = TorqueDrive(chain, actuator, timeout)
        self._longest_gap = longest_gap
        self._pending: list[_PendingCommand] = []
        self._driving = False
        self._origin: int | None = None
        self._last = 0

    @property
    def busy(self) -> bool:
        """Whether the driver needs the next frame, because torques act or a report is pending."""
        return bool(self._pending) or self._driving or self.record.open

    @property
    def driving(self) -> bool:
        """Whether torques act."""
        return self._driving

    def command(self, source: str, command: EdgeCommand, side: Edge) -> None:
        """Start an edge command at the next frame; it replaces the previous edge command.

        The command must be neither `instantaneous` nor a waveform.
        """
        begin = partial(self._drive.command, command, side)
        self._pending.append(_PendingCommand(source, begin, command))

    def play(self, source: str, command: EdgeCommand, rotor: int, limit: float) -> None:
        """Start a waveform on a rotor (see `RotorDrive`); it replaces the previous edge command.

        Raises ValueError if the command has no waveform, and the errors of `EdgeCommand.profile`.
        """
        if command.waveform is None:
            raise ValueError(f'a {command.kind.value} is no waveform; call command')
        quantity = command.waveform.quantity
        begin = partial(self._drive.play, command.profile, quantity, rotor, limit)
        self._pending.append(_PendingCommand(source, begin, command))

    def hold(self, source: str, rotors: Rotors, torques: Array) -> None:
        """Apply constant torques [N m] to rotors until their next command, or for `timeout`."""
        begin = partial(self._drive.joints.hold, rotors, torques)
        self._pending.append(_PendingCommand(source, begin))

    def follow(
        self, source: str, rotors: Rotors, times: Array, torques: Array, delay: float
    ) -> None:
        """Apply a trajectory of torques [N m] after a delay [s]; see `JointDrive.follow`."""
        begin = partial(self._drive.joints.follow, rotors, times + delay, torques)
        self._pending.append(_PendingCommand(source, begin))

    def frame(self, before: int, stamp: int, angles: Array) -> Array | None:
        """Return the torques to send after this frame [N m], (N,), or None if no torque acts.

        `before` and `stamp` are the stamps of the previous frame and of this frame [ns]. Raises
        ValueError if the stamps do not increase; if they decrease, all commands are dropped.
        """
        if self._origin is None:
            self._origin = stamp
        time = (stamp - self._origin) / _NANOSECONDS
        if stamp <= before:
            ended = stamp < before
            if ended:
                self._pending.clear()
                self.record.end(stamp, cut_short=True)
                given = self._drive.edges.actuator, self._drive.joints.timeout
                self._drive = TorqueDrive(self.chain, *given)
                self._driving, self._origin = False, None
            raise ValueError(
                f'joint_states.header.stamp = {stamp} ns must be later than the previous one, '
                f'{before} ns; {"all torques are dropped" if ended else "stamp each frame"}'
            )
        self.record.frame(stamp, angles)
        gap = (stamp - self._last) / _NANOSECONDS
        if self._driving and gap > self._longest_gap:
            self.record.interrupt()
        self._last = stamp
        self._begin(time, stamp)
        if not (self._drive.active or self._driving):
            return None
        end = time + (stamp - before) / _NANOSECONDS
        drive = self._drive.torques(angles, time, end)
        if self._drive.active:
            self.record.sent(drive.torques, drive.saturated)
        else:
            self.record.end(stamp)
        self._driving = self._drive.active
        return drive.torques

    def abandon(self) -> None:
        """Report the current torques as cut short, because no further frame is expected."""
        self.record.abandon(self._last)

    def _begin(self, time: float, stamp: int) -> None:
        pending, self._pending = self._pending, []
        for each in pending:
            if each.command is not None and self._driving:
                unfinished = self._drive.edge_command_unfinished(time)
                self.record.end(stamp, superseded=True, cut_short=unfinished)
            each.begin(time)
            if self._drive.active:
                self.record.begin(stamp, each.source, each.command)
                self._driving = True
