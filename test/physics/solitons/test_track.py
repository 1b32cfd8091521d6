# SPDX-License-Identifier: Apache-2.0
"""Paths of solitons: crossings of known paths, speeds and orbits of the linkage and the chain."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from chains import (
    FLIPPER,
    SPINNER,
    STRONG_WOBBLER,
    WIDE_FLIPPER,
    WIDE_SPINNER,
    WOBBLER,
    chain_of,
)
from linkage_motion import TOLERANCE, closed_orbit, distance, site

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.tanh_fit import find_solitons
from soliton_linkage.solitons.track import Track, find_crossings, follow, track_point

CHAIN = chain_of(FLIPPER, 21)
NOTHING = np.empty(0)


def nudged(chain: Chain, speed: float, duration: float, period: float) -> Recording:
    """Motion after a kick from the left-leaning state, in the units of docs/physics.md."""
    start = chain.uniform_state(-1)
    rate = speed * chain.spacing / chain.rotor_length / chain.time_unit
    rates = rate * mode_towards_last(chain, start)
    return simulate(chain, start, rates, duration * chain.time_unit, period * chain.time_unit)


def zigzag(speed: float, period: float, legs: int) -> Track:
    """Path of a point that runs up and down a chain of 21 rotors at a speed [rotors/s]."""
    times = period * np.arange(round(legs * 20 / speed / period) + 1)
    rotors = np.abs((speed * times + 20) % 40 - 20)
    return Track(times, rotors, np.gradient(rotors, times))


def test_a_frame_without_a_soliton_has_no_place() -> None:
    assert np.isnan(track_point(CHAIN, ())).all()


def test_the_place_of_a_frame_is_that_of_its_first_soliton() -> None:
    angles = site(CHAIN, 10, False, False, 5)[0][2]
    solitons = find_solitons(CHAIN, angles, mode_towards_last(CHAIN, angles))
    later = dataclasses.replace(solitons[0], rotor=15.0)
    rotor, velocity = track_point(CHAIN, (*solitons, later))
    assert rotor == solitons[0].rotor
    assert velocity * CHAIN.spacing == pytest.approx(solitons[0].velocity)


@pytest.mark.parametrize('legs', [1, 2, 5])
@pytest.mark.parametrize('speed', [0.5, 3.0])
def test_a_path_up_and_down_the_chain_crosses_it_once_a_leg(speed: float, legs: int) -> None:
    period = 0.01 / speed
    crossings = find_crossings(CHAIN, zigzag(speed, period, legs))
    assert [crossing.direction for crossing in crossings] == [1, -1, 1, -1, 1][:legs]
    for leg, crossing in enumerate(crossings):
        assert crossing.site_rate == pytest.approx(speed, rel=1e-9)
        assert crossing.start == pytest.approx((20 * leg + 4) / speed, abs=1.01 * period)
        assert crossing.end == pytest.approx((20 * leg + 16) / speed, abs=1.01 * period)


def test_a_path_that_turns_back_half_way_has_not_crossed() -> None:
    times = np.linspace(0, 1, 101)
    rotors = 12 - np.abs(24 * times - 12)
    assert find_crossings(CHAIN, Track(times, rotors, 0 * times)) == ()


def test_frames_in_which_the_soliton_was_not_found_are_passed_over() -> None:
    track = zigzag(2.0, 0.01, 2)
    rotors = track.sites.copy()
    rotors[::3] = np.nan
    rotors[np.abs(track.times - 10) < 1] = np.nan
    crossings = find_crossings(CHAIN, Track(track.times, rotors, track.site_rates))
    assert [crossing.direction for crossing in crossings] == [1, -1]
    assert [crossing.site_rate for crossing in crossings] == pytest.approx([2, 2], rel=1e-9)


@pytest.mark.parametrize(
    ('example', 'rotors', 'kick', 'speed', 'leg'),
    [
        (FLIPPER, 20, 0.10, 0.193, 110),
        (WIDE_FLIPPER, 60, 0.08, 0.55, 122),
        (WOBBLER, 20, 0.08, 0.068, 303),
        (SPINNER, 20, 0.3, 0.137, 163),
        (WIDE_SPINNER, 50, 1.0, 0.29, 185),
    ],
)
def test_the_chains_that_show_each_phase_move_at_the_speeds_of_an_independent_program(
    example: tuple[float, float], rotors: int, kick: float, speed: float, leg: float
) -> None:
    chain = chain_of(example, rotors)
    recording = nudged(chain, kick, 2.2 * leg, leg / 100)
    there, back = find_crossings(chain, follow(chain, recording))[:2]
    assert (there.direction, back.direction) == (1, -1)
    # The table has two digits.
    for crossing in (there, back):
        assert crossing.site_rate * chain.time_unit == pytest.approx(speed, rel=0.03)
    middles = [(crossing.start + crossing.end) / 2 for crossing in (there, back)]
    assert (middles[1] - middles[0]) / chain.time_unit == pytest.approx(leg, rel=0.03)


@pytest.mark.parametrize('example', [FLIPPER, WIDE_FLIPPER, WOBBLER, SPINNER, WIDE_SPINNER])
def test_a_slow_wall_moves_at_the_speed_of_the_rigid_linkage(
    example: tuple[float, float],
) -> None:
    chain = chain_of(example, 40)
    walls, arc = site(chain, 12, False, False, 9)
    rate = 0.02 * chain.spacing / chain.rotor_length / chain.time_unit * arc
    start = walls[0]
    duration = 8 * arc / rate
    recording = simulate(
        chain, start, rate * mode_towards_last(chain, start), duration, duration / 50, 1e-8
    )
    places = follow(chain, recording).sites
    # Elastic corrections are of the order of (v / c)^2 with c about 1 spacing per time unit.
    assert places[-1] - places[0] == pytest.approx(8, rel=0.01)


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])
def test_the_orbit_grows_by_the_arc_of_a_spacing_a_leg_with_each_rotor(
    example: tuple[float, float],
) -> None:
    _, arc = site(chain_of(example, 40), 19, False, False, 9)
    orbits = [closed_orbit(chain_of(example, rotors), 0.05) for rotors in (11, 10)]
    legs = 2 if chain_of(example, 2).motion is Motion.SPINNER else 4
    # Each orbit is closed to within 0.6 of its sampling, and edges feel the wall by its tail.
    assert 0.05 * (len(orbits[0]) - len(orbits[1])) == pytest.approx(legs * arc, abs=0.15)


@pytest.mark.parametrize(
    ('example', 'rotors'),
    [
        *((each, 10) for each in (FLIPPER, WIDE_FLIPPER, WOBBLER, STRONG_WOBBLER, SPINNER)),
        (FLIPPER, 11),
        (SPINNER, 11),
    ],
)
def test_flippers_are_restored_by_two_round_trips_and_not_by_one(
    example: tuple[float, float], rotors: int
) -> None:
    chain = chain_of(example, rotors)
    orbit = closed_orbit(chain)
    gaps = distance(orbit, orbit[0])
    # The first and the last tenth are the start and the return themselves.
    inner = gaps[len(gaps) // 10 : -len(gaps) // 10]
    assert gaps[-1] < 0.05
    assert inner.min() > 0.1
    if chain.motion is Motion.SPINNER:
        return
    half = gaps[4 * len(gaps) // 10 : 6 * len(gaps) // 10]
    assert half.min() > 1.0
    assert np.abs(chain.spring_extensions(orbit)).max() < 1e4 * TOLERANCE * chain.rotor_length
