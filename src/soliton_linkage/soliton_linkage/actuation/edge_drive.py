# SPDX-License-Identifier: Apache-2.0
"""The torque that the actuators at the edges of the chain give in the course of time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soliton_linkage.actuation.actuator import Actuator
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.profile import AT_REST, RESOLUTION, Profile
from soliton_linkage.linear.rigidity import Edge

_EMPTY = 1e-6
"""Level of an actuator over the largest since its last command: less is rest, as the exponential
decay of a lag never comes to 0. It ends a drive 14 time constants after its command."""
_SENSES = {Edge.FIRST: 1.0, Edge.LAST: -1.0}
"""Sign of a torque that moves the wall towards the last rotor, for a push at each edge [1]."""


@dataclass(frozen=True)
class MeanTorque:
    """Torque over a stretch of time."""

    torque: float
    """Mean, along the unit zero mode that moves the wall towards the last rotor [N m]."""
    saturated: bool
    """Whether an actuator gives less than its level asks for."""


class EdgeDrive:
    """The actuators at both edges and the pulse past them, in the course of time.

    A command takes the place of the one before it; an actuator that was commanded goes back to
    rest while the next command is carried out. Times are in seconds from any origin, and never
    go back.
    """

    def __init__(self, actuator: Actuator) -> None:
        """Start with both actuators at rest."""
        self._ends = {edge: _End(actuator) for edge in _SENSES}
        self.actuator = actuator
        self._pulse: Profile | None = None
        self._sense = 0.0
        self._started = -math.inf
        self._over = -math.inf

    @property
    def active(self) -> bool:
        """Whether there is a torque now or later."""
        return any(end.active for end in self._ends.values()) or self._pulse is not None

    @property
    def levels(self) -> tuple[float, float]:
        """Level of the actuators of the first and of the last edge, such as a pressure [Pa]."""
        return self._ends[Edge.FIRST].level, self._ends[Edge.LAST].level

    def unfinished(self, time: float) -> bool:
        """Whether a command with an end has not come to it."""
        return time < self._over < math.inf

    def command(self, command: EdgeCommand, side: Edge, time: float) -> None:
        """Carry out a lasting command at the first or last edge, from an instant on."""
        self.drop(time)
        profile = command.profile
        if command.kind is CommandKind.PULSE:
            self._pulse, self._sense = profile, _SENSES[side]
        elif not command.vents:
            self._ends[side].command(profile, time)
        self._started, self._over = time, math.inf if command.held else time + profile.end

    def drop(self, time: float) -> None:
        """Let the actuators go back to rest and end the pulse."""
        for end in self._ends.values():
            end.command(AT_REST, time)
        self._pulse, self._over = None, -math.inf

    def mean_torque(self, start: float, end: float) -> MeanTorque:
        """Torque over a stretch of time that begins now."""
        torque, saturated = 0.0, False
        for edge, actuated in self._ends.items():
            level = actuated.mean_level(start, end)
            torque += _SENSES[edge] * float(self.actuator.torque(level))
            saturated |= self.actuator.saturates(level)
        since = start - self._started
        if self._pulse is not None and since >= self._pulse.end - RESOLUTION:
            self._pulse = None
        if self._pulse is not None:
            torque += self._sense * float(self._pulse.mean(since, since + end - start))
        return MeanTorque(torque, saturated)


class _End:
    """Level of the actuator at one edge, and the profile that it follows."""

    def __init__(self, actuator: Actuator) -> None:
        self.level = 0.0
        self._actuator = actuator
        self._time = 0.0
        self._largest = 0.0
        self._started = 0.0
        self._command = AT_REST

    @property
    def active(self) -> bool:
        return self._command is not AT_REST or self.level != 0

    def command(self, profile: Profile, time: float) -> None:
        self._advance(time)
        self._command, self._started = profile, time
        self._largest = abs(self.level)

    def mean_level(self, start: float, end: float) -> float:
        self._advance(start)
        return self._driven(start, end)[1] / (end - start) if self.active else 0.0

    def _advance(self, time: float) -> None:
        if self.active and time > self._time:
            self.level, _ = self._driven(self._time, time)
            self._largest = max(self._largest, abs(self.level))
            if time - self._started >= self._command.end and not self._command.lasting:
                self._command = AT_REST
            if self._command is AT_REST and abs(self.level) <= _EMPTY * self._largest:
                self.level = 0.0
        self._time = time

    def _driven(self, start: float, end: float) -> tuple[float, float]:
        if self._command is AT_REST:
            return self._actuator.driven(self.level, AT_REST, 0.0, end - start)
        since = start - self._started
        return self._actuator.driven(self.level, self._command, since, since + end - start)
