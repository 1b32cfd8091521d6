# SPDX-License-Identifier: Apache-2.0
"""Frames: queued impulses, unwrapping, unseen rotors, and the noise of rates."""

import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.estimation.frames import ImpulseQueue, OnOrbit, Unwrapper, complete
from soliton_linkage.estimation.noise import RateNoise
from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linear.normal_modes import normal_modes
from soliton_linkage.linkage.chain import Array, Chain, wrapped

SECOND = 10**9
DAY = 24 * 3600 * SECOND
ONE, OTHER, LAST = (np.full(3, float(number)) for number in range(3))


def due(waiting: ImpulseQueue, stamp: int) -> list[tuple[Array, int]]:
    """Return the impulses that act from a frame on, and their age [ns]."""
    return [
        (apply_impulse.impulses, round(apply_impulse.ago * SECOND))
        for apply_impulse in waiting.due(stamp)
    ]


def test_an_impulse_acts_from_the_next_frame():
    for order in permutations([(15, ONE), (20, OTHER), (31, LAST)]):
        waiting = ImpulseQueue()
        assert waiting.due(10) == []
        for stamp, impulses in order:
            waiting.add(stamp, impulses)
        assert sorted(ago for _, ago in due(waiting, 20)) == [0, 5]
        assert waiting.due(30) == []
        assert due(waiting, 40) == [(LAST, 9)]
        assert waiting.due(50) == []
        assert waiting.late == 0


def test_a_late_impulse_is_counted_and_has_no_effect():
    for stamp in [19, 20]:
        waiting = ImpulseQueue()
        waiting.due(20)
        waiting.add(stamp, ONE)
        assert waiting.due(30) == []
        assert waiting.late == 1


def test_an_impulse_of_an_unknown_clock_acts_from_the_next_frame():
    for stamp in [None, 0, 2 * DAY]:
        waiting = ImpulseQueue()
        waiting.due(DAY)
        waiting.add(stamp, ONE)
        assert due(waiting, DAY + 1) == [(ONE, 0)]
        assert waiting.late == 0


def test_impulses_are_dropped_when_the_clock_is_set_back():
    waiting = ImpulseQueue()
    waiting.due(50 * SECOND)
    waiting.add(50 * SECOND + 1, ONE)
    assert waiting.due(SECOND) == []
    assert waiting.due(51 * SECOND) == []


CHAINS = {
    'flipper': Chain(number_of_rotors=9),
    'spinner': Chain(number_of_rotors=9, rotor_length=0.2, rest_angle=1.18),
}


def there(chain: Chain, frame: Array) -> OnOrbit:
    """Return a right-leaning chain at rest, with the residuals of a frame."""
    angles = chain.uniform_state(1)
    rates = np.linspace(1, 2, 9)
    return OnOrbit(angles, rates, wrapped(frame - angles))


@given(st.integers(0, 2**32 - 1))
def test_wrapped_angles_are_unwrapped(seed):
    generator = np.random.default_rng(seed)
    angles = np.cumsum(generator.uniform(-3, 3, (50, 4)), axis=0)
    seen = wrapped(angles)
    seen[generator.random((50, 4)) < 0.1] = np.nan
    gaps = np.isnan(seen) | np.isnan(np.roll(seen, 1, axis=0))
    unwrapper = Unwrapper(4)
    read = np.array([unwrapper.unwrapped(frame) for frame in seen])
    steps = np.diff(read, axis=0)[~gaps[1:]]
    np.testing.assert_allclose(steps, np.diff(angles, axis=0)[~gaps[1:]], atol=1e-12)
    known = ~np.isnan(seen)
    np.testing.assert_allclose(wrapped(read - seen)[known], 0, atol=1e-12)
    assert (np.isnan(read) == np.isnan(seen)).all()


def test_an_invalid_angle_is_unseen():
    for value in [math.nan, math.inf, -math.inf, 1e12, -1e300]:
        unwrapper = Unwrapper(2)
        unwrapper.unwrapped(np.array([1.0, 2.0]))
        read = unwrapper.unwrapped(np.array([1.1, value]))
        assert read[0] == 1.1
        assert math.isnan(read[1])
        np.testing.assert_array_equal(unwrapper.last, [1.1, 2.0])


def test_unseen_rotors_are_filled_in_from_the_orbit_with_their_turns():
    for name in CHAINS:
        chain = CHAINS[name]
        frame = chain.uniform_state(1) + 0.01
        frame[[2, 3, 8]] = np.nan
        last = chain.uniform_state(1)
        last[3] += 4 * math.pi
        expected = there(chain, frame)
        whole = complete(chain, frame, None, expected, last)
        assert whole.from_orbit
        assert not whole.others
        np.testing.assert_array_equal(np.flatnonzero(whole.filled), [2, 3, 8])
        assert whole.angles[2] == expected.angles[2]
        assert whole.angles[3] == pytest.approx(expected.angles[3] + 4 * math.pi)
        seen = [0, 1, 4, 5, 6, 7]
        np.testing.assert_array_equal(whole.angles[seen], frame[seen])
        assert whole.rates is None


def test_one_distant_rotor_is_unseen_and_two_adjacent_ones_are_a_domain():
    for name in CHAINS:
        chain = CHAINS[name]
        far = math.pi / 2 if name == 'spinner' else chain.rest_angle
        for off, filled, others in (([4], [4], False), ([0], [0], False), ([4, 5], [], True)):
            frame = chain.uniform_state(1)
            frame[off] += far + 0.05
            rates = np.zeros(9)
            whole = complete(chain, frame, rates, there(chain, frame), frame)
            assert np.flatnonzero(whole.filled).tolist() == filled
            assert whole.others == others
            assert whole.rates is not None
            np.testing.assert_array_equal(whole.rates[filled], there(chain, frame).rates[filled])
            near = chain.uniform_state(1)
            near[off] += far - 0.05
            assert not complete(chain, near, None, there(chain, near), near).filled.any()


def test_missing_rates_are_filled_in_from_the_orbit():
    chain = CHAINS['flipper']
    frame, rates = chain.uniform_state(1), np.zeros(9)
    rates[[1, 2]] = math.nan, math.inf
    whole = complete(chain, frame, rates, there(chain, frame), frame)
    assert whole.rates is not None
    np.testing.assert_array_equal(whole.rates[[1, 2]], there(chain, frame).rates[[1, 2]])
    assert complete(chain, frame, rates, None, frame).rates is None
    known = complete(chain, frame, np.ones(9), None, frame).rates
    np.testing.assert_array_equal(known, np.ones(9))


def test_without_an_orbit_rotors_lean_like_their_neighbours():
    chain = CHAINS['flipper']
    frame = chain.uniform_state(-1)
    frame[[0, 4, 5, 8]] = np.nan
    whole = complete(chain, frame, None, None, frame)
    np.testing.assert_allclose(np.sin(whole.angles), np.sin(chain.uniform_state(-1)), atol=1e-12)
    np.testing.assert_allclose(np.cos(whole.angles), np.cos(chain.uniform_state(-1)), atol=1e-12)
    assert not whole.from_orbit
    nothing = complete(chain, np.full(9, np.nan), None, None, frame)
    assert np.isnan(nothing.angles).all()


CHAIN = Chain(number_of_rotors=30)
PERIOD = 0.1 / band_edges(CHAIN)[1]


def phonons(times: Array, generator: np.random.Generator) -> Array:
    """Return rates of all phonons with a mean square of 1 rad^2/s^2, shape (T, N)."""
    modes = normal_modes(CHAIN, CHAIN.uniform_state(1))
    phases = generator.uniform(0, 2 * math.pi, len(modes.frequencies))
    waves = np.cos(np.outer(times, modes.frequencies) + phases)
    rates = waves @ modes.shapes.T
    return np.asarray(rates / rates.std())


def noise_of(times: Array, rates: Array) -> float:
    noise = RateNoise(CHAIN)
    for time, frame in zip(times.tolist(), rates, strict=True):
        noise.update(time, frame)
    return noise.deviation


def test_white_noise_is_measured():
    for deviation in [0.01, 1.0]:
        generator = np.random.default_rng(5)
        times = PERIOD * np.arange(4000)
        rates = deviation * generator.standard_normal((4000, 30))
        rates[:, 7] = np.nan
        assert noise_of(times, rates) == pytest.approx(deviation, rel=0.02)


def test_phonons_do_not_count_as_noise():
    generator = np.random.default_rng(6)
    times = PERIOD * np.arange(500)
    waves = phonons(times, generator)
    assert noise_of(times, waves) < 0.01
    noisy = waves + 0.1 * generator.standard_normal(waves.shape)
    assert noise_of(times, noisy) == pytest.approx(0.1, rel=0.05)


def test_an_unknown_noise_is_nan():
    generator = np.random.default_rng(7)
    rates = generator.standard_normal((100, 30))
    assert math.isnan(noise_of(10 * PERIOD * np.arange(100), rates))
    uneven = noise_of(PERIOD * np.cumsum(np.arange(100) % 2 + 1), rates)
    assert uneven == pytest.approx(1, rel=0.1)
    assert math.isnan(noise_of(PERIOD * np.arange(2), rates[:2]))
    assert math.isnan(noise_of(PERIOD * np.arange(100), np.full((100, 30), np.nan)))


def test_a_restart_discards_all_frames():
    noise = RateNoise(CHAIN)
    for number in range(10):
        noise.update(PERIOD * number, np.full(30, (-1.0) ** number))
    assert noise.deviation > 1
    noise.restart()
    assert math.isnan(noise.deviation)
