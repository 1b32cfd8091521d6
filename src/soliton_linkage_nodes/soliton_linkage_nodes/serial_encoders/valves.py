# SPDX-License-Identifier: Apache-2.0
"""What the valves of a controller are told, and for how long."""

from __future__ import annotations

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.microcontroller.frames import SEQUENCES, FrameKind, SerialFrame
from soliton_linkage_nodes.serial_encoders.parameters import ValveParameters


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
