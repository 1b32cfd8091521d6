# SPDX-License-Identifier: Apache-2.0
"""The emulated controller: a simulated chain behind a serial port."""

from __future__ import annotations

import os

import numpy as np
import pytest

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.microcontroller.frames import (
    FrameDecoder,
    FrameKind,
    Protocol,
    SerialFrame,
    encode,
)
from soliton_linkage.microcontroller.rotary_encoders import AngleReader, RotaryEncoders
from soliton_linkage.microcontroller.simulated_controller import SimulatedController
from soliton_linkage_nodes.messages.conversions import NamedChain, default_joint_names
from soliton_linkage_nodes.programs.simulated_controller import (
    PseudoTerminal,
    RealTimeChain,
)

ROTORS = 6
CHAIN = Chain(number_of_rotors=ROTORS)
RATE = 100.0


@pytest.fixture
def terminal(tmp_path):
    opened = PseudoTerminal(tmp_path / 'tty')
    yield opened
    opened.close()
    assert not (tmp_path / 'tty').is_symlink()


class Computer:
    """A client that opens the emulated port."""

    def __init__(self, terminal: PseudoTerminal) -> None:
        self._port = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
        self._decoder = FrameDecoder()
        self._reader = AngleReader(RotaryEncoders(), ROTORS)
        self.times: list[int] = []

    def tell(self, torque: float) -> None:
        torques = np.zeros(ROTORS)
        torques[0] = torque
        command = SerialFrame(FrameKind.TORQUES, 0, 50_000, torques)
        os.write(self._port, encode(command, Protocol.BINARY))

    def hear(self, expected: int) -> list[Array]:
        readings: list[SerialFrame] = []
        while len(readings) < expected:
            frames = self._decoder.feed(os.read(self._port, 65536))
            readings += [frame for frame in frames if frame.kind is FrameKind.COUNTS]
        self.times += [frame.time or 0 for frame in readings]
        return [self._reader.read(frame) for frame in readings]


def test_the_chain_moves_by_the_torques_of_its_valves(terminal):
    named = NamedChain(CHAIN, default_joint_names(ROTORS))
    played = RealTimeChain(named, SimulatedController(ROTORS), terminal, RATE)
    computer = Computer(terminal)
    for _ in range(5):
        played.play()
    angles = computer.hear(5)
    np.testing.assert_allclose(np.diff(angles, axis=0), 0.0)
    computer.tell(0.02)
    for _ in range(10):
        played.play()
    angles = computer.hear(10)
    assert angles[-1][0] > angles[0][0] + 0.1
    assert computer.times == [10_000 * frame for frame in range(15)]


def test_its_encoders_have_the_offsets_of_the_chain():
    offsets = tuple(0.1 * (1 + np.arange(ROTORS)))
    encoders = RotaryEncoders((2.0**16,), offsets=offsets)
    said = SimulatedController(ROTORS, encoders).measure(0.0, np.zeros(ROTORS))
    read = AngleReader(RotaryEncoders((2.0**16,)), ROTORS).read(*FrameDecoder().feed(said))
    np.testing.assert_allclose(read, offsets, atol=1e-4)
