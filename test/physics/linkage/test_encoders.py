# SPDX-License-Identifier: Apache-2.0
"""Encoders: noise of its variance, steps, offsets, and rates that are differences of readings."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.encoders import EncoderErrors, Encoders

ROTORS = 200
PERIOD = 0.01
ANGLES = np.linspace(-20.0, 20.0, ROTORS)
SEEDS = st.integers(0, 10**9 - 1)


def encoders(**errors: float | int | tuple[float, ...]) -> Encoders:
    return Encoders(ROTORS, PERIOD, EncoderErrors(**errors))


def readings(reader: Encoders, frames: int = 200) -> Array:
    return np.array([reader.read(frame, ANGLES)[0] for frame in range(frames)])


def test_noise_is_white_and_normal_with_the_deviation_asked_for():
    for noise in [1e-6, 0.01, 0.05, 2.0]:
        drawn = (readings(encoders(noise=noise, seed=3)) - ANGLES) / noise
        count = drawn.size
        # Five standard errors of each moment of a normal draw.
        assert abs(drawn.mean()) < 5 / math.sqrt(count)
        assert abs(drawn.var() - 1) < 5 * math.sqrt(2 / count)
        assert abs((drawn**4).mean() - 3) < 5 * math.sqrt(96 / count)
        for shifted in (drawn[1:] * drawn[:-1], drawn[:, 1:] * drawn[:, :-1]):
            assert abs(shifted.mean()) < 5 / math.sqrt(shifted.size)


@given(SEEDS)
def test_the_noise_of_a_frame_depends_on_the_seed_and_its_number_alone(seed):
    in_order, alone = encoders(noise=0.1, seed=seed), encoders(noise=0.1, seed=seed)
    other = encoders(noise=0.1, seed=seed + 1)
    for frame in range(3):
        expected, _ = in_order.read(frame, ANGLES)
    assert np.array_equal(alone.read(2, ANGLES)[0], expected)
    assert not np.array_equal(other.read(2, ANGLES)[0], expected)


def test_quantised_readings_are_whole_steps_and_within_half_of_one():
    for step in [2 * math.pi / 4096, 0.1, 1.0]:
        reading, _ = encoders(quantisation=step).read(0, ANGLES)
        assert reading / step == pytest.approx(np.round(reading / step), rel=0, abs=1e-9)
        assert np.abs(reading - ANGLES).max() <= step / 2 * (1 + 1e-9)


def test_offsets_are_constant_and_come_before_the_steps():
    offsets = tuple(np.linspace(-1, 1, ROTORS).tolist())
    assert np.array_equal(encoders(offsets=offsets).read(0, ANGLES)[0], ANGLES + offsets)
    stepped, _ = encoders(offsets=offsets, quantisation=0.5).read(0, ANGLES)
    assert np.array_equal(stepped, 0.5 * np.round((ANGLES + offsets) / 0.5))


def test_rates_are_differences_of_readings_over_the_period():
    reader, twin = (encoders(noise=0.01, quantisation=0.001, seed=5) for _ in range(2))
    before, rates = reader.read(0, ANGLES)
    assert not rates.any()
    for frame in range(1, 5):
        reading, rates = reader.read(frame, ANGLES + 0.1 * frame)
        assert np.array_equal(reading, twin.read(frame, ANGLES + 0.1 * frame)[0])
        assert np.array_equal(rates, (reading - before) / PERIOD)
        before = reading


def test_without_the_frame_before_there_are_no_rates():
    for forget in [False, True]:
        reader = encoders(noise=0.01)
        reader.read(0, ANGLES)
        if forget:
            reader.forget()
        _, rates = reader.read(1 if forget else 2, ANGLES + 1)
        assert not rates.any()


def test_errors_of_nothing_are_none():
    assert EncoderErrors().none
    assert EncoderErrors(offsets=(0.0, 0.0), seed=4).none
    for errors in ({'noise': 0.1}, {'quantisation': 0.1}, {'offsets': (0.0, 0.1)}):
        assert not EncoderErrors(**errors).none


def test_errors_out_of_their_range_are_rejected():
    for errors, complaint in [
        ({'noise': -0.1}, r'EncoderErrors\.noise = -0\.1 must lie in the range 0 to 10 rad'),
        ({'quantisation': math.nan}, r'quantisation = nan must be a finite number'),
        ({'seed': -1}, r'seed = -1 must lie'),
        ({'offsets': (0.0, math.inf)}, 'offset of rotor 1 = inf rad must lie in the range'),
    ]:
        with pytest.raises(ValueError, match=complaint):
            EncoderErrors(**errors)


def test_offsets_must_fit_the_chain():
    with pytest.raises(
        ValueError, match='2 offsets of encoders do not fit a chain of 200 rotors; give one'
    ):
        encoders(offsets=(0.1, 0.2))
