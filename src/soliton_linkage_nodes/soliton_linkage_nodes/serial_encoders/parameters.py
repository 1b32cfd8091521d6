# SPDX-License-Identifier: Apache-2.0
"""Parameters of the serial line, and of the valves at its other end."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soliton_linkage.linkage.quantities import quantity


@dataclass(frozen=True)
class SerialEncodersParameters:
    """Where the controller is."""

    port: str = quantity(
        '', 'serial port of the controller, as /dev/ttyACM0 or a path in /dev/serial/by-id'
    )
    baud_rate: int = quantity(
        115_200, 'symbols a second of a UART; USB itself has none', 'baud', 300, 12_000_000
    )
    least_delay: float = quantity(
        0.0,
        'least time from a measurement to its arrival, which nothing at this end can tell: stamps '
        'are late by what it is more; on a UART ten bits a byte',
        's',
        0.0,
        1.0,
    )


@dataclass(frozen=True)
class ValveParameters:
    """How the valves are told what rotor_torques ask for."""

    torque_per_pressure: tuple[float, ...] = quantity(
        (),
        'torque that a pressure gives, one for all rotors or one each, to tell the controller '
        'pressures; empty to tell it torques [N m/Pa]',
    )
    torque_limit: float = quantity(0.1, 'largest torque accepted', 'N m', 0.0, 1e6)
    command_timeout: float = quantity(
        0.5, 'time after which torques are dropped without a new message', 's', 1e-3, 86_400.0
    )
    stamp_tolerance: float = quantity(
        10.0,
        'by how much the stamp of torques may differ from the clock, 0 for any; half of it '
        'refuses what waited for less long, twice takes more',
        's',
        0.0,
        86_400.0,
    )
    command_rate: float = quantity(
        100.0,
        'most commands a second; half of it leaves more of the line to readings, twice follows '
        'torques more closely',
        'Hz',
        1.0,
        1000.0,
    )
    hold: float = quantity(
        0.1,
        'for how long a command holds in the controller, which shuts the valves when no other has '
        'come by then; as long as ten commands, so that one that is corrupted costs nothing',
        's',
        1e-3,
        60.0,
    )

    def check_fit(self, rotors: int) -> None:
        """Raise ValueError unless there is a usable torque for each pressure, or for none."""
        given = self.torque_per_pressure
        if len(given) not in (0, 1, rotors):
            raise ValueError(
                f'torque_per_pressure has {len(given)} values for a chain of {rotors} rotors; '
                f'give none, 1 or {rotors}'
            )
        for value in given:
            if not (math.isfinite(value) and value):
                raise ValueError(
                    f'torque_per_pressure = {value:g} N m/Pa must be a finite number and not 0'
                )
        if self.hold * self.command_rate < 1:
            raise ValueError(
                f'hold = {self.hold:g} s is shorter than the {1 / self.command_rate:g} s between '
                'two commands; raise hold or command_rate'
            )
