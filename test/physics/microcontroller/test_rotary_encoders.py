# SPDX-License-Identifier: Apache-2.0
"""Readings become continuous angles, for any counts, signs and offsets of encoders."""

import contextlib
import math

import numpy as np
import pytest

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.microcontroller.frames import SEQUENCES, FrameKind, SerialFrame
from soliton_linkage.microcontroller.rotary_encoders import (
    AngleReader,
    AngleStream,
    RotaryEncoders,
)

MILLISECOND = 10**6


def counts(*values: float) -> SerialFrame:
    return SerialFrame(FrameKind.COUNTS, values=np.array(values))


def test_turns_are_counted_across_missing_readings():
    reader = AngleReader(RotaryEncoders(), 3)
    rates = np.array([2.5, -2.0, 0.1])
    for frame in range(50):
        angles = rates * frame
        seen = np.where((frame % 5 == 3) & (np.arange(3) == 2), np.nan, angles)
        readings = np.round(seen * 4096 / math.tau) % 4096
        found = reader.read(counts(*readings))
        assert np.array_equal(np.isnan(found), np.isnan(seen))
        np.testing.assert_allclose(found, seen, atol=math.tau / 4096)


def test_each_encoder_has_its_sign_offset_and_counts():
    encoders = RotaryEncoders((4000.0, 1000.0), (1.0, -1.0), (0.25, -0.5))
    (first, second) = AngleReader(encoders, 2).read(counts(1000, 250))
    assert first == pytest.approx(math.pi / 2 - 0.25)
    assert second == pytest.approx(-math.pi / 2 + 0.5)
    frame = SerialFrame(FrameKind.RADIANS, values=np.array([1.0, 1.0]))
    assert AngleReader(encoders, 2).read(frame) == pytest.approx([0.75, -0.5])


def test_readings_that_do_not_wrap_are_not_unwrapped():
    reader = AngleReader(RotaryEncoders(wrapped=False), 1)
    assert reader.read(counts(10 * 4096)) == pytest.approx([10 * math.tau])
    assert reader.read(counts(0)) == pytest.approx([0.0])


def test_values_out_of_range_are_rejected():
    for given, complaint in [
        ({'counts_per_turn': (0.0,)}, 'counts_per_turn = 0 must be 1 or more'),
        ({'signs': (2.0,)}, 'sign of an encoder = 2 must be 1 or -1'),
        ({'offsets': (math.inf,)}, 'offset of rotor 0 = inf rad'),
    ]:
        with pytest.raises(ValueError, match=complaint):
            RotaryEncoders(**given)


def test_wrong_numbers_of_values_are_rejected():
    with pytest.raises(ValueError, match='signs has 2 values for a chain of 3 rotors; give none'):
        AngleReader(RotaryEncoders(signs=(1.0, 1.0)), 3)
    with pytest.raises(ValueError, match='it has 2 readings for a chain of 3 rotors'):
        AngleReader(RotaryEncoders(), 3).read(counts(1, 2))


def stream() -> AngleStream:
    return AngleStream(AngleReader(RotaryEncoders(), 1))


def reading(number: int | None, time: int | None = None) -> SerialFrame:
    return SerialFrame(FrameKind.COUNTS, number, time, np.zeros(1))


def test_missing_frame_numbers_are_lost_frames():
    for numbers, lost in [
        ([SEQUENCES - 3, SEQUENCES - 1, 0, 1, 5], 1 + 3),
        ([7, None, 90, None, 200], 0),
        ([41, 42, 0, 1], 0),  # a controller without a clock that has restarted
    ]:
        angles = stream()
        for count, number in enumerate(numbers):
            assert angles.take(reading(number), count * MILLISECOND) is not None
        assert angles.lost == lost


def test_frame_numbers_skipped_by_a_restart_are_not_lost():
    for greeted in [True, False]:
        angles = stream()
        for number in (40, 41, 42):
            angles.take(reading(number, 1000 * number), number * MILLISECOND)
        if greeted:
            assert angles.take(SerialFrame(FrameKind.HELLO), 43 * MILLISECOND) is None
        for number in range(60, 63):
            with contextlib.suppress(ValueError):
                angles.take(
                    reading(number, 1000 * (number - 60) + 1), (940 + number) * MILLISECOND
                )
        assert (angles.lost, angles.clock.restarts) == (0, 1)


@pytest.mark.parametrize('fraction', [0.05, 0.25])
def test_wrong_frame_numbers_are_not_lost_frames(fraction):
    numbers = np.arange(1000) % SEQUENCES
    lost = np.array([200, 201, 202, 640])
    wrong = np.random.default_rng(4).random(1000) < fraction
    wrong[[0, 199, 203, 639, 641, 996, 997, 998, 999]] = False
    sent = numbers + wrong * 10 ** np.random.default_rng(5).integers(1, 5, 1000)
    angles = stream()
    for count in np.setdiff1d(np.arange(1000), lost):
        angles.take(reading(int(sent[count]) % SEQUENCES), int(count) * MILLISECOND)
    assert angles.lost == 4


def test_a_frame_with_an_implausible_time_is_rejected_and_is_not_lost():
    angles = stream()
    for number in range(500):
        time = 10 * number + (8_000_000 if number == 400 else 0)
        if number == 400:
            with pytest.raises(ValueError, match='time = 8004000 us differs from its arrival'):
                angles.take(reading(number, time), 10_000 * number)
        else:
            angles.take(reading(number, time), 10_000 * number)
    assert (angles.lost, angles.clock.restarts, angles.clock.jumps) == (0, 0, 0)


def test_only_a_controller_that_continued_has_lost_frames_at_a_reconnection():
    for restarted in [False, True]:
        angles = stream()
        for number in range(1000):
            angles.take(reading(number, 10_000 * number), 10 * MILLISECOND * number)
        angles.reconnect()
        for number in range(1003, 1100):
            sent = number - 1003 if restarted else number
            with contextlib.suppress(ValueError):
                angles.take(reading(sent, 10_000 * sent), 10 * MILLISECOND * number)
        assert (angles.lost, angles.clock.restarts) == ((0, 1) if restarted else (3, 0))


def test_commands_are_rejected_as_readings():
    with pytest.raises(ValueError, match='torques are commands to a controller'):
        stream().take(SerialFrame(FrameKind.TORQUES, 0, 0, np.zeros(1)), 0)


def test_angles_in_degrees_are_rejected() -> None:
    angles = Chain(number_of_rotors=6).uniform_state(-1)
    reader = AngleReader(RotaryEncoders(), 6)
    read = reader.read(SerialFrame(FrameKind.RADIANS, 0, 0, angles))
    np.testing.assert_allclose(np.sin(read), np.sin(angles))
    degrees = SerialFrame(FrameKind.RADIANS, 1, 10_000, np.rad2deg(angles))
    with pytest.raises(ValueError, match='look like degrees; send radians'):
        reader.read(degrees)
