# SPDX-License-Identifier: Apache-2.0
"""Simulated microcontroller that sends encoder readings and executes valve commands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import CheckedQuantities, quantity
from soliton_linkage.microcontroller.device_clock import LARGEST_DRIFT
from soliton_linkage.microcontroller.frames import (
    CLOCK_RANGE,
    COMMANDS,
    SEQUENCES,
    FrameDecoder,
    FrameKind,
    Protocol,
    SerialFrame,
    encode,
)
from soliton_linkage.microcontroller.rotary_encoders import RotaryEncoders


@dataclass(frozen=True)
class ControllerSettings(CheckedQuantities):
    """Properties of a simulated controller. Raises ValueError for values out of range."""

    protocol: str = quantity(
        'binary', 'encoding of its frames', choices=tuple(each.value for each in Protocol)
    )
    drift: float = quantity(
        0.0,
        'relative error of its clock, positive if it is fast',
        '',
        -LARGEST_DRIFT,
        LARGEST_DRIFT,
    )
    torque_per_pressure: float = quantity(
        5e-8, 'torque on a rotor per pressure of its valve', 'N m/Pa', 0.0, 1.0
    )


class SimulatedController:
    """Simulated controller of a chain; it executes each command for the duration in the frame."""

    def __init__(
        self,
        rotors: int,
        encoders: RotaryEncoders | None = None,
        settings: ControllerSettings | None = None,
    ) -> None:
        self._encoders = encoders or RotaryEncoders()
        self._encoders.check_fit(rotors)
        self._settings = settings or ControllerSettings()
        self._protocol = Protocol(self._settings.protocol)
        self._decoder = FrameDecoder()
        self._rotors = rotors
        self.commands = 0
        self.start(0.0)

    def start(self, now: float) -> bytes:
        """Start or restart at the time `now` [s]; return the bytes that the controller sends."""
        self._begun, self._sequence = now, 0
        self._torques, self._hold_until = np.zeros(self._rotors), now
        return encode(SerialFrame(FrameKind.HELLO), self._protocol)

    def measure(self, now: float, angles: Array) -> bytes:
        """Return the bytes that the controller sends for angles [rad], (N,), at `now` [s]."""
        readings = (angles + (self._encoders.offsets or 0.0)) * self._encoders.per_radian()
        if self._encoders.wrapped:
            readings %= self._encoders.counts_per_turn
        clock = round((now - self._begun) * (1 + self._settings.drift) * 1e6) % CLOCK_RANGE
        frame = SerialFrame(FrameKind.COUNTS, self._sequence, clock, np.round(readings))
        self._sequence = (self._sequence + 1) % SEQUENCES
        return encode(frame, self._protocol)

    def receive(self, now: float, chunk: bytes) -> None:
        """Receive bytes at the time `now` [s]; ignore frames that are not valid commands."""
        for frame in self._decoder.feed(chunk):
            if frame.kind in COMMANDS and len(frame.values) == self._rotors:
                pressures = frame.kind is FrameKind.PRESSURES
                scale = self._settings.torque_per_pressure if pressures else 1.0
                self._torques = scale * np.nan_to_num(frame.values)
                self._hold_until = now + (frame.time or 0) / 1e6
                self.commands += 1

    def torques(self, now: float) -> Array:
        """Return the torque on each rotor [N m], (N,), at the time `now` [s]."""
        return self._torques if now < self._hold_until else np.zeros(self._rotors)
