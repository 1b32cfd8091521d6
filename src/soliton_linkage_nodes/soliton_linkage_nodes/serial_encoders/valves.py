# SPDX-License-Identifier: Apache-2.0
"""What the valves of a controller are told, for how long, and what it delivers."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.microcontroller.frames import SEQUENCES, FrameKind, SerialFrame
from soliton_linkage_nodes.serial_encoders.parameters import ValveParameters

_MOST_ACTING = 1000
"""Commands whose impulses nobody has asked for [1]: of ten seconds without a frame."""


class _Acting(NamedTuple):
    """What a command does."""

    begin: float
    """[s]."""
    end: float
    """Without another command [s]."""
    torques: Array
    """[N m], shape (N,)."""


class Valves:
    """Turns torques into the commands that a controller is due, until they are too old."""

    def __init__(self, parameters: ValveParameters, rotors: int) -> None:
        """Drive so many rotors; ValueError where the parameters do not fit them."""
        parameters.check_fit(rotors)
        self.told = 0
        """Commands so far."""
        self._parameters = parameters
        self._torques = np.zeros(rotors)
        self._until = 0.0
        self._shut = True
        self._acting: deque[_Acting] = deque(maxlen=_MOST_ACTING)

    @property
    def shut(self) -> bool:
        """Whether the last command was of no torque."""
        return self._shut

    def hold(self, torques: Array, now: float) -> None:
        """Give torques [N m], shape (N,), from an instant [s] on."""
        self._torques, self._until = torques, now + self._parameters.command_timeout

    def release(self) -> None:
        """Give no torque."""
        self._torques = np.zeros_like(self._torques)

    def command(self, now: float) -> SerialFrame:
        """Command of an instant [s]."""
        if now >= self._until:
            self.release()
        self._shut = not self._torques.any()
        kind, values = FrameKind.TORQUES, self._torques
        if self._parameters.torque_per_pressure:
            kind = FrameKind.PRESSURES
            values = values / np.asarray(self._parameters.torque_per_pressure)
        frame = SerialFrame(
            kind, self.told % SEQUENCES, round(self._parameters.hold * 1e6), values
        )
        self.told += 1
        return frame

    def note_told(self, now: float) -> None:
        """Enter that the last command went to the controller at an instant [s]."""
        torques = np.zeros_like(self._torques) if self._shut else self._torques
        self._acting.append(_Acting(now, now + self._parameters.hold, torques))

    def delivered(self, until: float) -> Array:
        """Angular impulses since the last such instant, until one [s] [N m s], shape (N,).

        Torques act from when they were told until the next command, or as long as they hold.
        """
        impulses = np.zeros_like(self._torques)
        while self._acting and self._acting[0].begin < until:
            acting = self._acting.popleft()
            end = min(acting.end, self._acting[0].begin if self._acting else math.inf)
            impulses += acting.torques * (min(end, until) - acting.begin)
            if end > until:
                self._acting.appendleft(acting._replace(begin=until))
        return impulses
