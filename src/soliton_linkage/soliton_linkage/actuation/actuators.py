# SPDX-License-Identifier: Apache-2.0
"""Models of the actuators at the edges: interface, implementations and a registry by name.

To add a model, write a frozen dataclass with the methods of `Actuator` and fields that are defined
by `linkage.quantities.quantity`, and add it to `ACTUATORS`. The key is the value of the parameter
`actuator` that selects the model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, SupportsFloat

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.actuation.profile import Profile
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import CheckedQuantities, quantity


@dataclass(frozen=True)
class PneumaticActuator(CheckedQuantities):
    """Soft actuator with first-order pressure dynamics; raises ValueError for invalid parameters.

    The pressure p [Pa] approaches a higher command with the time constant `filling_time`, and a
    lower command with `venting_time`. The torque is proportional to p, up to `saturation_torque`.
    """

    filling_time: float = quantity(0.03, 'time constant of a rising pressure', 's', 1e-4, 1e3)
    venting_time: float = quantity(0.05, 'time constant of a falling pressure', 's', 1e-4, 1e3)
    lowest_pressure: float = quantity(
        -80e3, 'lowest gauge pressure that a command may request', 'Pa', -101325.0, 0.0
    )
    highest_pressure: float = quantity(
        200e3, 'highest gauge pressure that a command may request', 'Pa', 0.0, 1e9
    )
    torque_per_pressure: float = quantity(
        5e-8, 'torque along the unit zero mode per pressure', 'N m/Pa', 0.0, 1.0
    )
    saturation_torque: float = quantity(0.02, 'largest torque of the actuator', 'N m', 0.0, 1e6)

    def check_command(self, pressure: float) -> None:
        """Raise ValueError for a commanded pressure [Pa] out of range."""
        if not math.isfinite(pressure):
            raise ValueError(f'pressure = {pressure} Pa must be a finite number')
        if not self.lowest_pressure <= pressure <= self.highest_pressure:
            raise ValueError(
                f'pressure = {pressure:g} Pa must lie in the range {self.lowest_pressure:g} to '
                f'{self.highest_pressure:g} Pa; command a pressure in this range, or change '
                'lowest_pressure or highest_pressure if the supply allows it'
            )

    def follow(
        self, pressure: float, target: float, slope: float, time: float
    ) -> tuple[float, float]:
        """Return the pressure [Pa] after `time` [s], and the integral of the pressure [Pa s].

        The command at the time t is u = target + slope t [Pa], and `pressure` is the pressure at
        t = 0. With the time constant tau, the lag e = u - p obeys de/dt = slope - e / tau, so that

            e(t) = e(0) E + slope tau (1 - E),    E = exp(-t / tau),

        until e changes its sign at t = tau ln(1 - e(0) / (slope tau)). After this time, the other
        time constant applies.
        """
        lag = target - pressure
        constant = self._time_constant(lag if lag else slope)
        final_lag = slope * constant
        if lag * final_lag < 0:
            crossing = constant * math.log1p(-lag / final_lag)
            if crossing < time:
                met = target + slope * crossing
                _, before = self._relax(target, lag, slope, constant, crossing)
                rest = time - crossing
                end, after = self._relax(met, 0.0, slope, self._time_constant(slope), rest)
                return end, before + after
        return self._relax(target, lag, slope, constant, time)

    def response(
        self, pressure: float, command: Profile, start: float, end: float
    ) -> tuple[float, float]:
        """Return the pressure [Pa] at `end`, and its integral from `start` to `end` [Pa s].

        `pressure` is the pressure at `start`. Both times [s] are times of the profile `command`.
        """
        integral = 0.0
        for line in command.segments(start, end):
            slope = float(line.last - line.first) / line.duration if line.duration else 0.0
            pressure, share = self.follow(pressure, float(line.first), slope, line.duration)
            integral += share
        return pressure, integral

    def responses(self, pressure: float, times: Array, commands: Array) -> Array:
        """Return the pressures [Pa] at `times` [s]; each command [Pa] acts until the next one."""
        pressures = [pressure]
        for step, target in zip(np.diff(times).tolist(), commands.tolist(), strict=False):
            pressures.append(self.follow(pressures[-1], target, 0.0, step)[0])
        return np.array(pressures)

    def torque(self, pressure: ArrayLike) -> Array:
        """Return the torque [N m] at a pressure [Pa], with the shape of `pressure`."""
        unlimited = self.torque_per_pressure * np.asarray(pressure, dtype=np.float64)
        return np.clip(unlimited, -self.saturation_torque, self.saturation_torque)

    def is_saturated(self, pressure: float) -> bool:
        """Return whether `saturation_torque` limits the torque at a pressure [Pa]."""
        return abs(self.torque_per_pressure * pressure) > self.saturation_torque

    def pulse_command(self, impulse: float, duration: float) -> float:
        """Return the commanded pressure [Pa] of a pulse with a duration [s] and impulse [N m s].

        The impulse of a pressure u with the duration T is
        k u [T + (tau_2 - tau_1) (1 - exp(-T / tau_1))]. Here k is `torque_per_pressure`, tau_1 is
        the time constant of the change from 0 to u, and tau_2 the time constant of the change back
        to 0.
        """
        towards, back = self._time_constant(impulse), self._time_constant(-impulse)
        effective_duration = duration - (back - towards) * math.expm1(-duration / towards)
        return impulse / (self.torque_per_pressure * effective_duration)

    def _time_constant(self, direction: float) -> float:
        return self.filling_time if direction > 0 else self.venting_time

    @staticmethod
    def _relax(
        target: float, lag: float, slope: float, constant: float, time: float
    ) -> tuple[float, float]:
        decayed = -math.expm1(-time / constant)
        remaining = lag - (lag - slope * constant) * decayed
        lag_integral = constant * (lag * decayed + slope * (time - constant * decayed))
        command_integral = time * (target + slope * time / 2)
        return target + slope * time - remaining, command_integral - lag_integral


class Actuator(Protocol):
    """Interface of an actuator at an edge.

    An actuator has a level, for example a pressure [Pa]. The level approaches the command and
    determines the torque [N m] along the unit zero mode. At rest, level and torque are 0.
    """

    def check_command(self, command: float) -> None:
        """Raise ValueError for a command out of range."""

    def response(
        self, level: float, command: Profile, start: float, end: float
    ) -> tuple[float, float]:
        """Return the level at `end`, and the integral of the level from `start` to `end`.

        `level` is the level at `start`. Both times [s] are times of the profile `command`.
        """

    def torque(self, level: float) -> SupportsFloat:
        """Return the torque at a level [N m]."""

    def is_saturated(self, level: float) -> bool:
        """Return whether the torque limit reduces the torque at a level."""

    def pulse_command(self, impulse: float, duration: float) -> float:
        """Return the command of a pulse with a given duration [s] and impulse [N m s]."""


ACTUATORS: dict[str, type[Actuator]] = {'pneumatic': PneumaticActuator}
"""Actuator model for each value of the parameter `actuator`."""


def actuator_type(name: str) -> type[Actuator]:
    """Return the actuator model with this name; raise ValueError for an unknown name."""
    if name not in ACTUATORS:
        known = ', '.join(map(repr, ACTUATORS))
        raise ValueError(f'parameter actuator = {name!r} must be one of {known}')
    return ACTUATORS[name]
