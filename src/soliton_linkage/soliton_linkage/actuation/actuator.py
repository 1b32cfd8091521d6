# SPDX-License-Identifier: Apache-2.0
"""What the drive of an edge asks of an actuator, and the actuators that there are, by name.

A new one is a frozen dataclass with the methods of `Actuator` and a line in `ACTUATORS`. Its
fields, each a `quantity`, become parameters of the edge actuator, which chooses it by its name.
"""

from __future__ import annotations

from typing import Protocol, SupportsFloat

from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import Profile


class Actuator(Protocol):
    """An actuator at an edge, which turns what it is commanded into a torque.

    A command moves the level of the actuator, both in one unit of its own, such as the pressure
    in a chamber [Pa]; at rest both are 0. The level makes a torque along the unit zero mode
    [N m].
    """

    def check_command(self, command: float) -> None:
        """Raise ValueError for a command that cannot be asked for."""

    def driven(
        self, level: float, command: Profile, start: float, end: float
    ) -> tuple[float, float]:
        """Level at an instant and its integral up to it, from an earlier instant on [s]."""

    def torque(self, level: float) -> SupportsFloat:
        """Torque of a level [N m]."""

    def saturates(self, level: float) -> bool:
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
