# SPDX-License-Identifier: Apache-2.0
"""What the actuators at the edges of the chain are asked for, and the torque that they give."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import RESOLUTION, Profile, trapezoid
from soliton_linkage.linear.rigidity import Edge

# Of the largest pressure since the command: less is none.
_EMPTY = 1e-6
_SENSES = {Edge.FIRST: 1.0, Edge.LAST: -1.0}


class Kind(enum.Enum):
    """What is asked of an actuator, and the unit of its value."""

    KICK = 'kick'
    """A speed of the zero mode, at once [rad/s]."""
    PRESSURE = 'pressure'
    """A pressure in the chamber [Pa]."""
    PULSE = 'pulse'
    """A torque along the unit zero mode, past the chamber [N m]."""


@dataclass(frozen=True)
class EdgeLimits:
    """The most that may be asked for past the chambers."""

    speed: float
    """Of a kick [rad/s]."""
    torque: float
    """Of a pulse [N m]."""


@dataclass(frozen=True)
class EdgeOrder:
    """A command to the actuator at an edge; raises ValueError where it makes no sense.

    The value rises over `ramp_up` from 0, lasts for `duration` and falls to 0 over `ramp_down`
    [s]. A pressure without duration is held until the next order.
    """

    edge: Edge
    kind: Kind
    value: float
    duration: float = 0.0
    ramp_up: float = 0.0
    ramp_down: float = 0.0

    def __post_init__(self) -> None:
        """Refuse times that do not belong to the kind."""
        for name in ('duration', 'ramp_up', 'ramp_down'):
            time = getattr(self, name)
            if self.kind is Kind.KICK and time != 0:
                raise ValueError(
                    f'{name} of a kick = {time:g} s must be 0; a kick acts at once, use PULSE or '
                    'PRESSURE for what lasts'
                )
            if not (math.isfinite(time) and time >= 0):
                raise ValueError(f'{name} = {time:g} s must be a finite number of 0 or more')
        if self.kind is Kind.PRESSURE and not self.duration and self.ramp_down:
            raise ValueError(
                f'ramp_down = {self.ramp_down:g} s must be 0 for a pressure without duration, '
                'which lasts until the next command; give a duration'
            )

    @property
    def instantaneous(self) -> bool:
        """Whether it is one impulse."""
        lasting = self.duration + self.ramp_up + self.ramp_down
        return self.kind is Kind.KICK or (self.kind is Kind.PULSE and not lasting)

    @property
    def profile(self) -> Profile:
        """Value over the time since the order [s]."""
        held = self.kind is Kind.PRESSURE and not self.duration
        duration = math.inf if held else self.duration
        return trapezoid(self.value, self.ramp_up, duration, self.ramp_down)

    def check(self, limits: EdgeLimits, pneumatics: PneumaticActuator) -> None:
        """Raise ValueError where the value is out of limits."""
        if self.kind is Kind.PRESSURE:
            pneumatics.check_pressure(self.value)
        elif self.kind is Kind.KICK:
            _check_size('speed', self.value, limits.speed, 'rad/s')
        else:
            _check_size('torque', self.value, limits.torque, 'N m')


@dataclass(frozen=True)
class MeanTorque:
    """Torque over a stretch of time."""

    torque: float
    """Mean, along the unit zero mode that moves the wall towards the last rotor [N m]."""
    saturated: bool
    """Whether a chamber gives less than its pressure asks for."""


class EdgeDrive:
    """The chambers at both edges and the pulse past them, in the course of time.

    An order takes the place of the one before it; a pressure that was asked for is vented
    while the next order is carried out. Times are in seconds from any origin, and never go
    back.
    """

    def __init__(self, pneumatics: PneumaticActuator) -> None:
        """Start with empty chambers."""
        self._chambers = {edge: _Chamber(pneumatics) for edge in _SENSES}
        self.pneumatics = pneumatics
        self._pulse: Profile | None = None
        self._sense = 0.0
        self._started = -math.inf
        self._ends = -math.inf

    @property
    def active(self) -> bool:
        """Whether there is a torque now or later."""
        pressed = any(chamber.active for chamber in self._chambers.values())
        return pressed or self._pulse is not None

    @property
    def pressures(self) -> tuple[float, float]:
        """Pressure in the chambers of the first and of the last edge [Pa]."""
        return self._chambers[Edge.FIRST].pressure, self._chambers[Edge.LAST].pressure

    def unfinished(self, time: float) -> bool:
        """Whether an order with an end has not come to it."""
        return time < self._ends < math.inf

    def obey(self, order: EdgeOrder, side: Edge, time: float) -> None:
        """Carry out a lasting order at the first or last edge, from an instant on."""
        for chamber in self._chambers.values():
            chamber.command(None, time)
        self._pulse = None
        profile = order.profile
        if order.kind is Kind.PRESSURE:
            self._chambers[side].command(profile if order.value else None, time)
        else:
            self._pulse, self._sense = profile, _SENSES[side]
        held = order.kind is Kind.PRESSURE and not order.duration
        self._started, self._ends = time, math.inf if held else time + profile.end

    def drop(self, time: float) -> None:
        """Vent the chambers and end the pulse."""
        for chamber in self._chambers.values():
            chamber.command(None, time)
        self._pulse, self._ends = None, -math.inf

    def mean_torque(self, start: float, end: float) -> MeanTorque:
        """Torque over a stretch of time that begins now."""
        torque, saturated = 0.0, False
        for edge, chamber in self._chambers.items():
            pressure = chamber.mean_pressure(start, end)
            given = float(self.pneumatics.torque(pressure))
            asked = self.pneumatics.torque_per_pressure * pressure
            torque += _SENSES[edge] * given
            saturated |= abs(asked) > abs(given)
        since = start - self._started
        if self._pulse is not None and since >= self._pulse.end - RESOLUTION:
            self._pulse = None
        if self._pulse is not None:
            torque += self._sense * float(self._pulse.mean(since, since + end - start))
        return MeanTorque(torque, saturated)


class _Chamber:
    """Pressure in a chamber, and the profile that it follows."""

    def __init__(self, pneumatics: PneumaticActuator) -> None:
        self.pressure = 0.0
        self._pneumatics = pneumatics
        self._time = 0.0
        self._largest = 0.0
        self._started = 0.0
        self._command: Profile | None = None

    @property
    def active(self) -> bool:
        return self._command is not None or self.pressure != 0

    def command(self, profile: Profile | None, time: float) -> None:
        self._advance(time)
        self._command, self._started = profile, time
        self._largest = abs(self.pressure)

    def mean_pressure(self, start: float, end: float) -> float:
        self._advance(start)
        if not self.active:
            return 0.0
        return self._driven(start, end)[1] / (end - start)

    def _advance(self, time: float) -> None:
        if self.active and time > self._time:
            self.pressure, _ = self._driven(self._time, time)
            self._largest = max(self._largest, abs(self.pressure))
            command = self._command
            if command and time - self._started >= command.end and not command.lasting:
                self._command = None
            if self._command is None and abs(self.pressure) <= _EMPTY * self._largest:
                self.pressure = 0.0
        self._time = time

    def _driven(self, start: float, end: float) -> tuple[float, float]:
        if self._command is None:
            return self._pneumatics.follow(self.pressure, 0.0, 0.0, end - start)
        since = start - self._started
        return self._pneumatics.driven(self.pressure, self._command, since, since + end - start)


def _check_size(name: str, value: float, limit: float, unit: str) -> None:
    if not math.isfinite(value):
        raise ValueError(f'{name} = {value} {unit} must be a finite number')
    if np.abs(value) > limit:
        raise ValueError(
            f'{name} = {value:g} {unit} must lie in the range {-limit:g} to {limit:g} {unit}; '
            f'ask for less or raise {name}_limit'
        )
