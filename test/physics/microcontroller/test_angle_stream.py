# SPDX-License-Identifier: Apache-2.0
"""What is lost of a stream of frames is known by their numbers."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.microcontroller.angle_stream import AngleStream
from soliton_linkage.microcontroller.frames import SEQUENCES, FrameKind, SerialFrame
from soliton_linkage.microcontroller.rotary_encoders import AngleReader, RotaryEncoders

MILLISECOND = 10**6


def stream() -> AngleStream:
    return AngleStream(AngleReader(RotaryEncoders(), 1))


def reading(number: int | None, time: int | None = None) -> SerialFrame:
    return SerialFrame(FrameKind.COUNTS, number, time, np.zeros(1))


def take(taking: AngleStream, numbers: list[int | None], start: int = 0) -> None:
    for count, number in enumerate(numbers, start):
        assert taking.take(reading(number, 1000 * (count + 1)), count * MILLISECOND) is not None


def test_numbers_that_never_came_are_lost_past_the_last_number_too() -> None:
    taking = stream()
    take(taking, [SEQUENCES - 3, SEQUENCES - 1, 0, 1, 5])
    assert taking.lost == 1 + 3


def test_frames_without_numbers_are_not_counted() -> None:
    taking = stream()
    take(taking, [7, None, 90, None, 200])
    assert taking.lost == 0


@pytest.mark.parametrize('greeted', [True, False])
def test_what_a_new_beginning_skips_is_not_lost(greeted: bool) -> None:
    taking = stream()
    take(taking, [40, 41, 42])
    if greeted:
        assert taking.take(SerialFrame(FrameKind.HELLO), 3 * MILLISECOND) is None
    assert taking.take(reading(60, 1), 1000 * MILLISECOND) is not None
    assert (taking.lost, taking.clock.restarts) == (0, 1)


def test_a_controller_without_a_clock_may_begin_anew() -> None:
    taking = stream()
    for number in (41, 42, 0, 1):
        taking.take(reading(number), number)
    assert taking.lost == 0


def test_commands_are_no_readings() -> None:
    with pytest.raises(ValueError, match='torques are commands to a controller'):
        stream().take(SerialFrame(FrameKind.TORQUES, 0, 0, np.zeros(1)), 0)
