# SPDX-License-Identifier: Apache-2.0
"""Drives one chain: commands begin with the frame after them, and each frame has its torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from soliton_linkage.actuation.actuators import Actuator
from soliton_linkage.actuation.edge_command import EdgeCommand
from soliton_linkage.actuation.kick_record import KickRecord, KickReport
from soliton_linkage.actuation.torque_drive import Rotors, TorqueDrive
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array, Chain

_NANOSECONDS = 10**9
"""In a second."""


@dataclass(frozen=True)
class _Waiting:
    source: str
    begin: Callable[[float], None]
    command: EdgeCommand | None = None


class ChainDriver:
    """Torques of a chain from the commands to its actuators, and the record of what they did.

    Commands begin at the stamp of the next frame. The torques for a frame are the means of what
    is asked for over the period that follows it, taken to be as long as the one before.
    """

    def __init__(
        self,
        chain: Chain,
        actuator: Actuator,
        timeout: float,
        longest_gap: float,
        tell: Callable[[KickReport], None],
    ) -> None:
        """Start at rest; joint commands and gaps between frames last no longer than given [s]."""
        self.chain = chain
        self.record = KickRecord(chain.number_of_rotors, tell)
        self._drive = TorqueDrive(chain, actuator, timeout)
        self._longest_gap = longest_gap
        self._waiting: list[_Waiting] = []
        self._driving = False
        self._origin: int | None = None
        self._last = 0

    @property
    def busy(self) -> bool:
        """Whether the next frame matters."""
        return bool(self._waiting) or self._driving or self.record.open

    @property
    def driving(self) -> bool:
        """Whether torques act."""
        return self._driving

    def command(self, source: str, command: EdgeCommand, side: Edge) -> None:
        """Carry out a lasting command at an edge, in place of the last one."""
        begin = partial(self._drive.edges.command, command, side)
        self._waiting.append(_Waiting(source, begin, command))

    def hold(self, source: str, rotors: Rotors, torques: Array) -> None:
        """Hold torques [N m] on rotors, both of shape (named,)."""
        self._waiting.append(_Waiting(source, partial(self._drive.joints.hold, rotors, torques)))

    def follow(
        self, source: str, rotors: Rotors, times: Array, torques: Array, delay: float
    ) -> None:
        """Lead torques [N m] of rotors through points at times [s] after a delay [s]."""
        begin = partial(self._drive.joints.follow, rotors, times + delay, torques)
        self._waiting.append(_Waiting(source, begin))

    def frame(self, before: int, stamp: int, angles: Array) -> Array | None:
        """Torques to send with a frame [N m], shape (N,), or None where there is nothing to send.

        `before` is the stamp of the frame before it [ns]. Raises ValueError where the stamps do
        not increase; where they go back, all that was asked for ends.
        """
        time = self._time(stamp)
        if stamp <= before:
            ended = stamp < before
            if ended:
                self._drop(stamp)
            raise ValueError(
                f'joint_states.header.stamp = {stamp} ns must be later than the one before, '
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
        """Tell of what was going on: there will be no other frame."""
        self.record.abandon(self._last)

    def _begin(self, time: float, stamp: int) -> None:
        waiting, self._waiting = self._waiting, []
        for each in waiting:
            if each.command is not None and self._driving:
                unfinished = self._drive.edges.unfinished(time)
                self.record.end(stamp, superseded=True, cut_short=unfinished)
            each.begin(time)
            if self._drive.active:
                self.record.begin(stamp, each.source, each.command)
                self._driving = True

    def _drop(self, stamp: int) -> None:
        self._waiting.clear()
        self.record.end(stamp, cut_short=True)
        self._drive = TorqueDrive(
            self.chain, self._drive.edges.actuator, self._drive.joints.timeout
        )
        self._driving = False
        self._origin = None

    def _time(self, stamp: int) -> float:
        if self._origin is None:
            self._origin = stamp
        return (stamp - self._origin) / _NANOSECONDS
