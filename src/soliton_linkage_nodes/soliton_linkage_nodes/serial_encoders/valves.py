# SPDX-License-Identifier: Apache-2.0
"""Commands to the valves of a controller, and the impulses that these deliver."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.microcontroller.frames import SEQUENCES, FrameKind, SerialFrame

_MOST_ACTING = 1000
"""Commands kept until their impulses are read [1]: those of ten seconds without a frame."""


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


class Valves:
    """Torques as commands to a controller, until they are too old."""

    def __init__(self, parameters: ValveParameters, rotors: int) -> None:
        """Raise ValueError if the parameters do not fit so many rotors."""
        parameters.check_fit(rotors)
        self.told = 0
        """Number of commands."""
        self.shut = True
        """Whether the last command had no torque."""
        self._parameters = parameters
        self._torques = np.zeros(rotors)
        self._until = 0.0
        self._acting: deque[tuple[float, float, Array]] = deque(maxlen=_MOST_ACTING)
        """Begin [s], end without another command [s] and torques [N m] of each command."""

    def hold(self, torques: Array, now: float) -> None:
        """Hold torques [N m], shape (N,), from a time [s] until `command_timeout` is over."""
        self._torques, self._until = torques, now + self._parameters.command_timeout

    def release(self) -> None:
        """Hold no torque."""
        self._torques = np.zeros_like(self._torques)

    def command(self, now: float) -> SerialFrame:
        """Return the command at a time [s]."""
        if now >= self._until:
            self.release()
        self.shut = not self._torques.any()
        kind, values = FrameKind.TORQUES, self._torques
        if self._parameters.torque_per_pressure:
            kind = FrameKind.PRESSURES
            values = values / np.asarray(self._parameters.torque_per_pressure)
        hold = round(self._parameters.hold * 1e6)
        frame = SerialFrame(kind, self.told % SEQUENCES, hold, values)
        self.told += 1
        return frame

    def note_told(self, now: float) -> None:
        """Record that the last command was sent at a time [s]."""
        torques = np.zeros_like(self._torques) if self.shut else self._torques
        self._acting.append((now, now + self._parameters.hold, torques))

    def delivered(self, until: float) -> Array:
        """Return the angular impulses [N m s], shape (N,), from the last such time to another [s].

        A command acts from its sending to the next command, or as long as it holds.
        """
        impulses = np.zeros_like(self._torques)
        while self._acting and self._acting[0][0] < until:
            begin, end, torques = self._acting.popleft()
            end = min(end, self._acting[0][0] if self._acting else math.inf)
            impulses += torques * (min(end, until) - begin)
            if end > until:
                self._acting.appendleft((until, end, torques))
        return impulses
