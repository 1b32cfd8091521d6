# SPDX-License-Identifier: Apache-2.0
"""Torques asked for joint by joint, each joint led by the command that named it last."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.actuation.profile import RESOLUTION, Profile
from soliton_linkage.linkage.chain import Array

Rotors = NDArray[np.intp]


@dataclass
class _Command:
    rotors: Rotors
    profile: Profile
    started: float

    @property
    def ends(self) -> float:
        return math.inf if self.profile.lasting else self.started + self.profile.end


class JointDrive:
    """Torques of actuators on single rotors in the course of time.

    A command speaks for the rotors that it names and leaves the others alone. Its last torques
    are held for `timeout` [s], 0 for ever. Times are in seconds from any origin.
    """

    def __init__(self, number_of_rotors: int, timeout: float) -> None:
        """Start without a torque on any rotor."""
        self._number = number_of_rotors
        self.timeout = timeout
        self._commands: list[_Command] = []

    @property
    def active(self) -> bool:
        """Whether there is a torque now or later."""
        return bool(self._commands)

    @property
    def in_force(self) -> int:
        """How many commands speak for a rotor."""
        return len(self._commands)

    def unfinished(self, time: float) -> bool:
        """Whether a sequence of torques has not come to its end."""
        ends = [command.started + command.profile.end - self.timeout for command in self._commands]
        return any(time < end for end in ends)

    def hold(self, rotors: Rotors, torques: Array, time: float) -> None:
        """Hold torques [N m] on rotors, both of shape (named,), from an instant on."""
        self._command(rotors, np.zeros(1), torques[None, :], time)

    def follow(self, rotors: Rotors, times: Array, torques: Array, time: float) -> None:
        """Lead the torques of rotors through points, linear in time from what they are now.

        The points come at increasing times after the instant [s], shape (points,), with a
        torque [N m] for each rotor, shape (points, named). What is before the instant is gone.
        """
        now = self._now(time)[rotors]
        if times[0] > 0:
            times, torques = np.append(0.0, times), np.vstack([now, torques])
        self._command(rotors, times, torques, time)

    def drop(self) -> None:
        """End all torques."""
        self._commands.clear()

    def mean_torques(self, start: float, end: float) -> Array:
        """Mean torque on each rotor over a stretch of time that begins now [N m], shape (N,)."""
        torques = np.zeros(self._number)
        self._commands = [
            command for command in self._commands if start < command.ends - RESOLUTION
        ]
        for command in self._commands:
            since = start - command.started
            torques[command.rotors] = command.profile.mean(since, since + end - start)
        return torques

    def _now(self, time: float) -> Array:
        torques = np.zeros(self._number)
        for command in self._commands:
            torques[command.rotors] = command.profile.after(time - command.started)
        return torques

    def _command(self, rotors: Rotors, times: Array, torques: Array, time: float) -> None:
        for command in self._commands:
            others = ~np.isin(command.rotors, rotors)
            command.profile = Profile(command.profile.times, command.profile.values[:, others])
            command.rotors = command.rotors[others]
        self._commands = [command for command in self._commands if len(command.rotors)]
        if not np.any(torques):
            return
        if self.timeout:
            last = times[-1] + self.timeout
            times = np.append(times, [last, last])
            torques = np.vstack([torques, torques[-1], np.zeros_like(torques[-1])])
        self._commands.append(_Command(rotors, Profile(times, torques), time))
