# SPDX-License-Identifier: Apache-2.0
"""Commands to the actuator at an edge: kick, actuator command, torque pulse or waveform."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.actuation.actuators import Actuator
from soliton_linkage.actuation.profile import Profile, trapezoid
from soliton_linkage.actuation.waveform import DrivenQuantity, Waveform
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Array, Chain

_LARGEST_ANGLE = math.pi
"""Largest allowed amplitude of an imposed angle [rad]: half a turn reaches every orientation."""


class CommandKind(enum.Enum):
    """Kind of a command, which determines the meaning and the unit of the value."""

    KICK = 'kick'
    """Instantaneous change of the speed along the unit zero mode [rad/s]."""
    PRESSURE = 'pressure'
    """Pressure in the chamber [Pa], or level of an actuator of another model."""
    PULSE = 'pulse'
    """Torque along the unit zero mode [N m], which does not depend on the actuator model."""
    WAVEFORM = 'waveform'
    """Torque [N m] or angle [rad] of one rotor, which does not depend on the actuator model."""


@dataclass(frozen=True)
class EdgeLimits:
    """Limits of the kicks and pulses, which do not depend on the actuator model."""

    speed: float
    """Largest speed of a kick [rad/s]."""
    torque: float
    """Largest torque of a pulse [N m]."""


@dataclass(frozen=True)
class EdgeCommand:
    """Command to the actuator at an edge.

    The commanded quantity rises from 0 to `value` in `ramp_up` [s], is constant for `duration`
    [s], and falls to 0 in `ramp_down` [s]. If there is a `waveform`, the quantity is `value` times
    the waveform. A pressure with duration 0 acts until the next command. Raises ValueError for a
    duration or ramps that the kind does not allow.
    """

    edge: Edge
    kind: CommandKind
    value: float
    duration: float = 0.0
    ramp_up: float = 0.0
    ramp_down: float = 0.0
    waveform: Waveform | None = None
    """Waveform if the kind is WAVEFORM, else None."""

    def __post_init__(self) -> None:
        for name in ('duration', 'ramp_up', 'ramp_down'):
            time = getattr(self, name)
            if self.kind is CommandKind.KICK and time != 0:
                raise ValueError(
                    f'{name} of a kick = {time:g} s must be 0, because a kick is instantaneous; '
                    'use PULSE or PRESSURE for a command with a duration'
                )
            if not (math.isfinite(time) and time >= 0):
                raise ValueError(f'{name} = {time:g} s must be a finite number of 0 or more')
        if self.kind is CommandKind.PRESSURE and not self.duration and self.ramp_down:
            raise ValueError(
                f'ramp_down = {self.ramp_down:g} s must be 0 for a pressure without duration, '
                'which is held until the next command; specify a duration'
            )
        if (self.waveform is None) == (self.kind is CommandKind.WAVEFORM):
            raise ValueError(f'a {self.kind.value} must have a waveform only if it is a WAVEFORM')
        if self.waveform is not None and self.waveform.cycles and self.duration:
            raise ValueError(
                f'duration = {self.duration:g} s must be 0 for a waveform with cycles, which '
                'determine its duration'
            )

    @property
    def length(self) -> float:
        """Total duration of the command, including the ramps [s]."""
        total = self.duration + self.ramp_up + self.ramp_down
        return total if self.waveform is None else self.waveform.length(total)

    @property
    def instantaneous(self) -> bool:
        """Whether the command is a single impulse: a kick, or a pulse with a duration of 0."""
        short = self.kind is CommandKind.PULSE and not self.length
        return self.kind is CommandKind.KICK or short

    @property
    def held(self) -> bool:
        """Whether the command is a pressure with duration 0, which acts until the next command."""
        return self.kind is CommandKind.PRESSURE and not self.duration

    @property
    def vents(self) -> bool:
        """Whether the command is a pressure of 0.

        Such a command is allowed at either edge. Kicks, pulses and other pressures are allowed
        only at the edge that is nearer to the centre of the zero mode.
        """
        return self.kind is CommandKind.PRESSURE and self.value == 0

    @property
    def profile(self) -> Profile:
        """Commanded quantity as a function of the time since the start of the command [s].

        Raises ValueError for a waveform with too many points or too long ramps.
        """
        if self.waveform is not None:
            ramps = self.ramp_up, self.ramp_down
            return self.waveform.profile(self.value, self.length, ramps)
        duration = math.inf if self.held else self.duration
        return trapezoid(self.value, self.ramp_up, duration, self.ramp_down)

    def check(self, limits: EdgeLimits, actuator: Actuator) -> None:
        """Raise ValueError for a value beyond its limit; torques of waveforms are not checked."""
        if self.kind is CommandKind.PRESSURE:
            actuator.check_command(self.value)
        elif self.kind is CommandKind.KICK:
            _check_size('speed', self.value, limits.speed, 'rad/s')
        elif self.waveform is not None:
            if self.waveform.quantity is DrivenQuantity.ANGLE:
                _check_size('angle', self.value, _LARGEST_ANGLE, 'rad')
        else:
            _check_size('torque', self.value, limits.torque, 'N m')

    def impulses(self, chain: Chain, mode: Array, period: float | None) -> Array:
        """Return the angular impulses of an instantaneous command [N m s], shape (N,).

        With the unit zero mode m and the moments of inertia I_n, a kick of speed v has the
        impulses I_n v m_n. A pulse of torque tau has the impulses tau T m_n, where T is the frame
        `period` [s]. Raises ValueError for a pulse if `period` is None.
        """
        if self.kind is CommandKind.KICK:
            return np.asarray(chain.moments_of_inertia * self.value * mode)
        if period is None:
            raise ValueError(
                'a pulse without duration acts for one period of joint_states, which is not '
                'known yet; specify a duration'
            )
        return np.asarray(period * self.value * mode)

    def as_pressure(self, chain: Chain, actuator: Actuator, duration: float) -> EdgeCommand:
        """Return a pressure command with a `duration` [s] and the same impulse as this kick."""
        impulse = chain.moment_of_inertia * self.value
        pressure = actuator.pulse_command(impulse, duration)
        return EdgeCommand(self.edge, CommandKind.PRESSURE, pressure, duration)


def _check_size(name: str, value: float, limit: float, unit: str) -> None:
    if not math.isfinite(value):
        raise ValueError(f'{name} = {value} {unit} must be a finite number')
    if abs(value) > limit:
        remedy = '' if name == 'angle' else f' or raise {name}_limit'
        raise ValueError(
            f'{name} = {value:g} {unit} must lie in the range {-limit:g} to {limit:g} {unit}; '
            f'lower the {name}{remedy}'
        )
