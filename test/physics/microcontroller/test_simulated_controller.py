# SPDX-License-Identifier: Apache-2.0
"""Readings of the simulated controller are decoded, and its commands hold for their time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from soliton_linkage.microcontroller.frames import (
    FrameDecoder,
    FrameKind,
    Protocol,
    SerialFrame,
    encode,
)
from soliton_linkage.microcontroller.rotary_encoders import (
    AngleReader,
    AngleStream,
    RotaryEncoders,
)
from soliton_linkage.microcontroller.simulated_controller import (
    ControllerSettings,
    SimulatedController,
)

ENCODERS = RotaryEncoders((4096.0,), (1.0, -1.0, 1.0), (0.1, 0.2, -0.3))


@pytest.mark.parametrize('protocol', Protocol)
def test_decoded_angles_are_accurate_to_half_a_count(protocol: Protocol) -> None:
    controller = SimulatedController(3, ENCODERS, ControllerSettings(protocol.value))
    decoder, stream = FrameDecoder(), AngleStream(AngleReader(ENCODERS, 3))
    decoder.feed(controller.start(0.0))
    for number in range(200):
        now = 0.01 * number
        angles = np.array([3 * math.sin(now), 20 * now, np.nan if number % 2 else 1.0])
        (frame,) = decoder.feed(controller.measure(now, angles))
        read = stream.take(frame, round(now * 1e9))
        assert read is not None
        assert read.stamp == round(now * 1e9)
        np.testing.assert_allclose(read.angles, angles, atol=math.pi / 4096 + 1e-12)
    assert stream.lost == 0


def test_a_command_holds_for_its_time() -> None:
    controller = SimulatedController(2)
    command = SerialFrame(FrameKind.TORQUES, 0, 100_000, np.array([0.5, np.nan]))
    controller.receive(1.0, encode(command, Protocol.BINARY))
    assert controller.torques(1.099).tolist() == [0.5, 0.0]
    assert controller.torques(1.1).tolist() == [0.0, 0.0]


def test_pressures_become_torques_and_other_frames_are_ignored() -> None:
    controller = SimulatedController(1, settings=ControllerSettings(torque_per_pressure=1e-6))
    controller.receive(0.0, b'pressures 0 1000000 5e4\ntorques 1 1000000 1 2\ncounts 0 0 1\n')
    assert controller.torques(0.5) == pytest.approx([0.05])
    assert controller.commands == 1
