# SPDX-License-Identifier: Apache-2.0
"""Actuators at the edges: what a drive needs of one, and those that exist, by name.

A new one is a frozen dataclass with the methods of `Actuator` and a line in `ACTUATORS`. Its
fields, each a `quantity`, become parameters of the edge actuator, which chooses it by its name.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, SupportsFloat

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.actuation.profile import Profile
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import check_quantities, quantity


@dataclass(frozen=True)
class PneumaticActuator:
    """Parameters of a soft actuator; raises ValueError where they are invalid."""

    filling_time: float = quantity(
        0.03, 'time constant with which the pressure rises', 's', 1e-4, 1e3
    )
    venting_time: float = quantity(
        0.05, 'time constant with which the pressure falls', 's', 1e-4, 1e3
    )
    lowest_pressure: float = quantity(
        -80e3, 'lowest gauge pressure that can be asked for', 'Pa', -101325.0, 0.0
    )
    highest_pressure: float = quantity(
        200e3, 'highest gauge pressure that can be asked for', 'Pa', 0.0, 1e9
    )
    torque_per_pressure: float = quantity(
        5e-8, 'torque along the unit zero mode that a pressure gives', 'N m/Pa', 0.0, 1.0
    )
    saturation_torque: float = quantity(
        0.02, 'torque beyond which more pressure gives no more', 'N m', 0.0, 1e6
    )

    def __post_init__(self) -> None:
        """Refuse parameters out of their range."""
        check_quantities(self)

    def check_command(self, pressure: float) -> None:
        """Raise ValueError for a pressure [Pa] that cannot be asked for."""
        if not math.isfinite(pressure):
            raise ValueError(f'pressure = {pressure} Pa must be a finite number')
        if not self.lowest_pressure <= pressure <= self.highest_pressure:
            raise ValueError(
                f'pressure = {pressure:g} Pa must lie in the range {self.lowest_pressure:g} to '
                f'{self.highest_pressure:g} Pa; ask for less, or change lowest_pressure or '
                'highest_pressure if the supply gives more'
            )

    def follow(
        self, pressure: float, target: float, slope: float, time: float
    ) -> tuple[float, float]:
        """Pressure after a time [Pa] and its integral over it [Pa s], under a linear command.

        The command is u = target + slope t. The lag e = u - p obeys de/dt = slope - e / tau,

            e(t) = e(0) E + slope tau (1 - E),    E = exp(-t / tau),

        until it changes its sign, at t = tau ln(1 - e(0) / (slope tau)), and tau with it, which
        happens at most once.
        """
        lag = target - pressure
        if lag * slope < 0:
            constant = self._time_constant(lag)
            crossing = constant * math.log1p(-lag / (slope * constant))
            if crossing < time:
                met = target + slope * crossing
                _, before = self._relax(target, lag, slope, constant, crossing)
                rest = time - crossing
                end, after = self._relax(met, 0.0, slope, self._time_constant(slope), rest)
                return end, before + after
        constant = self._time_constant(lag if lag else slope)
        return self._relax(target, lag, slope, constant, time)

    def response(
        self, pressure: float, command: Profile, start: float, end: float
    ) -> tuple[float, float]:
        """Pressure [Pa] at an instant and its integral up to it [Pa s], from an earlier one on.

        Exact for any profile of commanded pressures [Pa], however far apart the instants [s].
        """
        integral = 0.0
        for line in command.pieces(start, end):
            first, last = float(line.first), float(line.last)
            slope = (last - first) / line.duration if line.duration else 0.0
            pressure, share = self.follow(pressure, first, slope, line.duration)
            integral += share
        return pressure, integral

    def responses(self, pressure: float, times: Array, commands: Array) -> Array:
        """Pressures [Pa] at instants [s], each command [Pa] in force until the next; (instants,).

        The first is the given one.
        """
        pressures = [pressure]
        for step, target in zip(np.diff(times).tolist(), commands.tolist(), strict=False):
            pressures.append(self.follow(pressures[-1], target, 0.0, step)[0])
        return np.array(pressures)

    def torque(self, pressure: ArrayLike) -> Array:
        """Torque of a pressure [N m], k p up to the saturation torque, shape (...)."""
        unlimited = self.torque_per_pressure * np.asarray(pressure, dtype=np.float64)
        return np.clip(unlimited, -self.saturation_torque, self.saturation_torque)

    def is_saturated(self, pressure: float) -> bool:
        """Whether a pressure [Pa] gives less than k p."""
        return abs(self.torque_per_pressure * pressure) > self.saturation_torque

    def pulse_command(self, impulse: float, duration: float) -> float:
        """Pressure [Pa] that must be asked for to give an impulse [N m s], vented afterwards.

        A command u that lasts T makes k u [T + (tau_2 - tau_1) (1 - exp(-T / tau_1))], where the
        pressure tends to u with tau_1 and back to 0 with tau_2.
        """
        towards, back = self._time_constant(impulse), self._time_constant(-impulse)
        lasting = duration - (back - towards) * math.expm1(-duration / towards)
        return impulse / (self.torque_per_pressure * lasting)

    def _time_constant(self, direction: float) -> float:
        return self.filling_time if direction > 0 else self.venting_time

    @staticmethod
    def _relax(
        target: float, lag: float, slope: float, constant: float, time: float
    ) -> tuple[float, float]:
        gone = -math.expm1(-time / constant)
        remaining = lag - (lag - slope * constant) * gone
        of_lag = constant * (lag * gone + slope * (time - constant * gone))
        of_command = time * (target + slope * time / 2)
        return target + slope * time - remaining, of_command - of_lag


class Actuator(Protocol):
    """An actuator at an edge, which turns what it is commanded into a torque.

    A command moves the level of the actuator, both in one unit of its own, such as the pressure
    in a chamber [Pa]; at rest both are 0. The level makes a torque along the unit zero mode
    [N m].
    """

    def check_command(self, command: float) -> None:
        """Raise ValueError for a command that cannot be asked for."""

    def response(
        self, level: float, command: Profile, start: float, end: float
    ) -> tuple[float, float]:
        """Level at an instant and its integral up to it, from an earlier instant on [s]."""

    def torque(self, level: float) -> SupportsFloat:
        """Torque of a level [N m]."""

    def is_saturated(self, level: float) -> bool:
        """Whether a level gives less torque than in proportion to a small one."""

    def pulse_command(self, impulse: float, duration: float) -> float:
        """Command that gives an impulse [N m s] if it lasts for a duration [s], rest after it."""


ACTUATORS: dict[str, type[Actuator]] = {'pneumatic': PneumaticActuator}
"""The kinds of actuators by the name that the parameter `actuator` chooses them by."""


def actuator_type(name: str) -> type[Actuator]:
    """Dataclass of the actuators of a name; raises ValueError where there is none."""
    if name not in ACTUATORS:
        known = ', '.join(map(repr, ACTUATORS))
        raise ValueError(f'parameter actuator = {name!r} must be one of {known}')
    return ACTUATORS[name]
