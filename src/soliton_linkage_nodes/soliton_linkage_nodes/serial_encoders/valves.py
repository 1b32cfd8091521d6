# SPDX-License-Identifier: Apache-2.0
"""Commands to the valves or motors of a microcontroller, and the resulting impulses."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.microcontroller.frames import SEQUENCES, FrameKind, SerialFrame

_MOST_COMMANDS = 1000
"""Largest number of stored commands whose impulses have not been read [1], 10 s at 100 Hz."""


@dataclass(frozen=True)
class ValveParameters:
    """Parameters of the conversion of rotor_torques to commands for the valves."""

    torque_per_pressure: tuple[float, ...] = quantity(
        (),
        'torque per pressure, one value for all rotors or one for each; the controller then '
        'receives pressures; empty to send torques [N m/Pa]',
    )
    torque_limit: float = quantity(0.1, 'largest accepted torque', 'N m', 0.0, 1e6)
    command_timeout: float = quantity(
        0.5, 'time without a new message after which torques end', 's', 1e-3, 86_400.0
    )
    stamp_tolerance: float = quantity(
        10.0,
        'largest difference between the stamp of torques and the clock; 0 for no limit',
        's',
        0.0,
        86_400.0,
    )
    command_rate: float = quantity(
        100.0,
        'rate of commands while torques act; a lower rate leaves more of the line to readings',
        'Hz',
        1.0,
        1000.0,
    )
    hold: float = quantity(
        0.1,
        'time after which the controller closes the valves without another command; several '
        'periods of command_rate, so that one corrupted command has no effect',
        's',
        1e-3,
        60.0,
    )

    def check_fit(self, rotors: int) -> None:
        """Raise ValueError if the parameters contradict each other or the number of rotors."""
        given = self.torque_per_pressure
        if len(given) not in (0, 1, rotors):
            raise ValueError(
                f'torque_per_pressure has {len(given)} values for a chain of {rotors} rotors; '
                f'set none, 1 or {rotors}'
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
    """Torques that the valves must apply at present.

    The caller must repeat the commands to the controller until `closed` is true.
    """

    def __init__(self, parameters: ValveParameters, rotors: int) -> None:
        parameters.check_fit(rotors)
        self.commands = 0
        self.closed = True
        """Whether all torques of the last command were 0."""
        self._parameters = parameters
        self._torques = self._feedback = self._sent = np.zeros(rotors)
        self._until = self._feedback_until = 0.0
        self._acting: deque[tuple[float, float, Array]] = deque(maxlen=_MOST_COMMANDS)
        """Sent commands: time of sending [s], time at which the controller closes the valves if no
        other command follows [s], and torques without the feedback [N m]."""

    def hold(self, torques: Array, now: float) -> None:
        """Set the torques [N m], shape (N,), that begin at the time `now` [s].

        They end after `command_timeout`, unless this method is called again.
        """
        self._torques, self._until = torques, now + self._parameters.command_timeout

    def feed_back(self, torques: Array, now: float) -> None:
        """Set the feedback torques [N m], shape (N,), that begin at the time `now` [s].

        They are added to the torques that `Valves.hold` sets. They end after the time
        `ValveParameters.hold`, unless this method is called again.
        """
        self._feedback, self._feedback_until = torques, now + self._parameters.hold

    def release(self) -> None:
        """Set all torques to 0."""
        self._torques = self._feedback = np.zeros_like(self._torques)

    def command(self, now: float) -> SerialFrame:
        """Return the command with the torques at the time `now` [s]."""
        self._sent = self._torques if now < self._until else np.zeros_like(self._torques)
        values = self._sent + self._feedback * (now < self._feedback_until)
        self.closed = not values.any()
        kind = FrameKind.TORQUES
        if self._parameters.torque_per_pressure:
            kind = FrameKind.PRESSURES
            values = values / np.asarray(self._parameters.torque_per_pressure)
        hold = round(self._parameters.hold * 1e6)
        frame = SerialFrame(kind, self.commands % SEQUENCES, hold, values)
        self.commands += 1
        return frame

    def record_sent(self, now: float) -> None:
        """Record that the last command was sent at the time `now` [s]."""
        self._acting.append((now, now + self._parameters.hold, self._sent))

    def delivered(self, until: float) -> Array:
        """Return the impulses [N m s], shape (N,), from the last call to the time `until` [s].

        The impulses of the feedback are not included.
        """
        impulses = np.zeros_like(self._torques)
        while self._acting and self._acting[0][0] < until:
            begin, end, torques = self._acting.popleft()
            end = min(end, self._acting[0][0] if self._acting else math.inf)
            impulses += torques * (min(end, until) - begin)
            if end > until:
                self._acting.appendleft((until, end, torques))
        return impulses
