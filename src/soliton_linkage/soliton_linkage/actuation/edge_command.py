# SPDX-License-Identifier: Apache-2.0
"""What can be asked of the actuator at an edge: a kick, a command to the actuator, a pulse."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.actuation.actuators import Actuator
from soliton_linkage.actuation.profile import Profile, trapezoid
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array, Chain


class CommandKind(enum.Enum):
    """What is asked of an actuator, and the unit of its value."""

    KICK = 'kick'
    """A speed of the zero mode, at once [rad/s]."""
    PRESSURE = 'pressure'
    """A pressure in the chamber [Pa]; of another actuator than a pneumatic one, its command."""
    PULSE = 'pulse'
    """A torque along the unit zero mode, past the actuator [N m]."""


@dataclass(frozen=True)
class EdgeLimits:
    """The most that may be asked for past the actuators."""

    speed: float
    """Of a kick [rad/s]."""
    torque: float
    """Of a pulse [N m]."""


@dataclass(frozen=True)
class EdgeCommand:
    """A command to the actuator at an edge; raises ValueError where it makes no sense.

    The value rises over `ramp_up` from 0, lasts for `duration` and falls to 0 over `ramp_down`
    [s]. A pressure without duration is held until the next command.
    """

    edge: Edge
    kind: CommandKind
    value: float
    duration: float = 0.0
    ramp_up: float = 0.0
    ramp_down: float = 0.0

    def __post_init__(self) -> None:
        """Refuse times that do not belong to the kind."""
        for name in ('duration', 'ramp_up', 'ramp_down'):
            time = getattr(self, name)
            if self.kind is CommandKind.KICK and time != 0:
                raise ValueError(
                    f'{name} of a kick = {time:g} s must be 0; a kick acts at once, use PULSE or '
                    'PRESSURE for what lasts'
                )
            if not (math.isfinite(time) and time >= 0):
                raise ValueError(f'{name} = {time:g} s must be a finite number of 0 or more')
        if self.kind is CommandKind.PRESSURE and not self.duration and self.ramp_down:
            raise ValueError(
                f'ramp_down = {self.ramp_down:g} s must be 0 for a pressure without duration, '
                'which lasts until the next command; give a duration'
            )

    @property
    def instantaneous(self) -> bool:
        """Whether it is one impulse."""
        lasting = self.duration + self.ramp_up + self.ramp_down
        return self.kind is CommandKind.KICK or (self.kind is CommandKind.PULSE and not lasting)

    @property
    def held(self) -> bool:
        """Whether it lasts until the next command."""
        return self.kind is CommandKind.PRESSURE and not self.duration

    @property
    def vents(self) -> bool:
        """Whether it asks for rest, which any edge can be asked for in any configuration."""
        return self.kind is CommandKind.PRESSURE and self.value == 0

    @property
    def profile(self) -> Profile:
        """Value over the time since the command [s]."""
        duration = math.inf if self.held else self.duration
        return trapezoid(self.value, self.ramp_up, duration, self.ramp_down)

    def check(self, limits: EdgeLimits, actuator: Actuator) -> None:
        """Raise ValueError where the value is out of limits."""
        if self.kind is CommandKind.PRESSURE:
            actuator.check_command(self.value)
        elif self.kind is CommandKind.KICK:
            _check_size('speed', self.value, limits.speed, 'rad/s')
        else:
            _check_size('torque', self.value, limits.torque, 'N m')

    def impulses(self, chain: Chain, mode: Array, period: float | None) -> Array:
        """Impulses on the rotors [N m s] of an instantaneous command along a mode, shape (N,).

        A kick of speed v along the unit mode m makes J_n = I_n v m_n; a pulse of the torque tau
        acts for a period T of the frames [s], J = tau T m. Raises ValueError for a pulse where
        that is not known.
        """
        if self.kind is CommandKind.KICK:
            return np.asarray(chain.moments_of_inertia * self.value * mode)
        if period is None:
            raise ValueError(
                'a pulse without duration lasts for a period of joint_states, which is not '
                'known yet; give a duration'
            )
        return np.asarray(period * self.value * mode)

    def as_pressure(self, chain: Chain, actuator: Actuator, duration: float) -> EdgeCommand:
        """Command of a duration [s] to the actuator with the impulse of this kick."""
        impulse = chain.moment_of_inertia * self.value
        pressure = actuator.pulse_command(impulse, duration)
        return EdgeCommand(self.edge, CommandKind.PRESSURE, pressure, duration)


def _check_size(name: str, value: float, limit: float, unit: str) -> None:
    if not math.isfinite(value):
        raise ValueError(f'{name} = {value} {unit} must be a finite number')
    if abs(value) > limit:
        raise ValueError(
            f'{name} = {value:g} {unit} must lie in the range {-limit:g} to {limit:g} {unit}; '
            f'ask for less or raise {name}_limit'
        )
