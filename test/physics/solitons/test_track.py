# SPDX-License-Identifier: Apache-2.0
"""Crossings of known paths, and speeds of the linkage and of an independent program."""

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WIDE_FLIPPER, WIDE_SPINNER, WOBBLER, chain_of

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.solitons.static_wall import site_arc, static_wall
from soliton_linkage.solitons.track import Track, find_crossings, follow

CHAIN = chain_of(FLIPPER, 21)


def zigzag(speed: float, period: float, legs: int) -> Track:
    """Path of a point that runs up and down a chain of 21 rotors at a speed [rotors/s]."""
    times = period * np.arange(round(legs * 20 / speed / period) + 1)
    rotors = np.abs((speed * times + 20) % 40 - 20)
    return Track(times, rotors, np.gradient(rotors, times))


def test_a_path_up_and_down_the_chain_has_one_crossing_per_leg():
    for speed in [0.5, 3.0]:
        for legs in [1, 2, 5]:
            period = 0.01 / speed
            crossings = find_crossings(CHAIN, zigzag(speed, period, legs))
            assert [crossing.direction for crossing in crossings] == [1, -1, 1, -1, 1][:legs]
            for leg, crossing in enumerate(crossings):
                assert crossing.site_rate == pytest.approx(speed, rel=1e-9)
                assert crossing.start == pytest.approx((20 * leg + 4) / speed, abs=1.01 * period)
                assert crossing.end == pytest.approx((20 * leg + 16) / speed, abs=1.01 * period)


def test_a_path_that_reverses_half_way_is_no_crossing():
    times = np.linspace(0, 1, 101)
    rotors = 12 - np.abs(24 * times - 12)
    assert find_crossings(CHAIN, Track(times, rotors, 0 * times)) == ()


def test_frames_without_a_soliton_do_not_divide_a_crossing():
    track = zigzag(2.0, 0.01, 2)
    rotors = track.sites.copy()
    rotors[::3] = np.nan
    rotors[np.abs(track.times - 10) < 1] = np.nan
    crossings = find_crossings(CHAIN, Track(track.times, rotors, track.site_rates))
    assert [crossing.direction for crossing in crossings] == [1, -1]
    assert [crossing.site_rate for crossing in crossings] == pytest.approx([2, 2], rel=1e-9)


@pytest.mark.parametrize('example', [FLIPPER, WIDE_FLIPPER, WOBBLER, SPINNER, WIDE_SPINNER])
def test_a_slow_wall_has_the_speed_of_the_rigid_linkage(example):
    chain = chain_of(example, 40)
    start, arc = static_wall(chain, 12.5), site_arc(chain)
    rate = 0.02 * chain.spacing / chain.rotor_length / chain.time_unit * arc
    duration = 8 * arc / rate
    recording = simulate(
        chain, start, rate * mode_towards_last(chain, start), duration, duration / 50, 1e-8
    )
    sites = follow(chain, recording).sites
    # Elastic corrections are of the order of (v / c)^2 with c about 1 spacing per time unit.
    assert sites[-1] - sites[0] == pytest.approx(8, rel=0.01)
