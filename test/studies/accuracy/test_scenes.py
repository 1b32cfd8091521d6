# SPDX-License-Identifier: Apache-2.0
"""Walls in scenes have the stated positions and velocities."""

from dataclasses import replace

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, SPINNER, WOBBLER, chain_of

from soliton_linkage.estimation.orbit_model import ComplianceCorrection
from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.solitons.tanh_fit import find_solitons
from soliton_linkage_studies.accuracy.cells import AccuracyCell
from soliton_linkage_studies.accuracy.scenes import frames_beside, scene_of
from soliton_linkage_studies.accuracy.walls import averages_and_slopes

FRAMES = 60
CHAIN_OF = {example: chain_of(example, 12) for example in CLASSES}


def cell_of(example: tuple[float, float], rotors: int, **others: object) -> AccuracyCell:
    cell = AccuracyCell('mine', chain_of(example, rotors), 0.01, 0.15, 0.2, FRAMES)
    return replace(cell, **others)


@pytest.mark.parametrize('example', CLASSES)
def test_a_wall_without_phonons_moves_at_the_requested_constant_speed(example):
    cell = cell_of(example, 30)
    scene = scene_of(cell, FRAMES, np.random.default_rng(4))
    assert scene.angles.shape == (FRAMES, 30)
    assert scene.positions.shape == scene.instants.shape == scene.site_rates.shape == (FRAMES, 1)
    sound = speed_of_sound(cell.chain) / cell.chain.spacing
    inner = scene.scored[:, 0]
    assert np.abs(scene.site_rates[inner]) == pytest.approx(0.15 * sound, rel=0.2)
    assert scene.instants[inner] == pytest.approx(scene.positions[inner], abs=0.01)
    period = cell.period * cell.chain.time_unit
    slopes = np.diff(scene.positions[:, 0]) / period
    both = inner[1:] & inner[:-1]
    assert slopes[both] == pytest.approx(scene.site_rates[1:, 0][both], rel=0.05)


@pytest.mark.parametrize('example', CLASSES)
def test_a_nudged_wall_moves_away_from_its_edge(example):
    scene = scene_of(cell_of(example, 12, nudged=True), FRAMES, np.random.default_rng(3))
    assert np.abs(np.diff(scene.instants[:, 0])).max() < 0.3
    for frame in np.flatnonzero(scene.scored[:, 0])[::20]:
        (wall,) = find_solitons(CHAIN_OF[example], scene.angles[frame])
        assert wall.rotor == pytest.approx(scene.positions[frame, 0], abs=0.7)


@pytest.mark.parametrize('example', CLASSES)
def test_walls_of_both_charges_have_their_detected_positions(example):
    cell = cell_of(example, 70, walls=2)
    scene = scene_of(cell, FRAMES, np.random.default_rng(2))
    assert sorted(scene.charges) == [-1, 1]
    for frame in (0, len(scene.angles) - 1):
        seen = find_solitons(cell.chain, scene.angles[frame])
        positions = [each.rotor for each in seen]
        assert [each.charge for each in seen] == list(scene.charges)
        assert positions == pytest.approx(list(scene.positions[frame]), abs=0.7)


def test_impulses_change_the_rate_and_are_reported():
    cell = cell_of(FLIPPER, 30, impulse_interval=2 * FRAMES)
    scene = scene_of(cell, 4 * FRAMES, np.random.default_rng(1))
    assert len(scene.impulse_frames) == len(scene.impulses) > 0
    for frame, impulses in zip(scene.impulse_frames, scene.impulses, strict=True):
        assert impulses.shape == (30,)
        assert scene.site_rates[frame] != pytest.approx(scene.site_rates[frame - 1], rel=1e-3)


def test_disorder_changes_the_true_chain_but_not_the_configured_one():
    scene = scene_of(cell_of(FLIPPER, 16, disorder=0.05), FRAMES, np.random.default_rng(1))
    plain = scene_of(cell_of(FLIPPER, 16), FRAMES, np.random.default_rng(1))
    assert np.abs(np.sin(scene.angles[0]) - np.sin(plain.angles[0])).max() > 0.01


def test_scenes_without_intact_walls_state_none():
    for others in [{'noise_only': True}, {'kick': 3.0}]:
        scene = scene_of(cell_of(FLIPPER, 16, **others), FRAMES, np.random.default_rng(1))
        assert scene.charges == ()
        assert scene.angles.shape == (FRAMES, 16)
        assert scene.positions.shape == (FRAMES, 0)


def test_a_linear_track_equals_its_average_and_impulses_divide_it():
    track = np.concatenate([0.3 * np.arange(40), 12.0 - 0.1 * np.arange(60)])
    means, slopes = averages_and_slopes(track, 5, [40])
    assert means == pytest.approx(track)
    assert slopes[:40] == pytest.approx(0.3)
    assert slopes[40:] == pytest.approx(-0.1)


def test_a_wave_with_the_period_of_the_average_is_removed():
    frames = np.arange(200)
    wave = np.sin(2 * np.pi * frames / 21)
    means, slopes = averages_and_slopes(0.01 * frames + wave, 10)
    inner = slice(30, -30)
    assert means[inner] == pytest.approx(0.01 * frames[inner], abs=1e-9)
    assert slopes[inner] == pytest.approx(0.01, abs=0.02)


def test_the_oscillation_of_an_anti_kink_in_a_well_is_not_averaged():
    cell, barrier_speed = cell_of(FLIPPER, 30, period=0.01), 20.0
    # The potential 1/2 barrier_speed^2 sin(pi x)^2 has the period of one rotor spacing.
    phases = np.pi * barrier_speed * cell.period * cell.chain.time_unit * np.arange(4000)
    means, slopes = averages_and_slopes(
        np.sin(phases), frames_beside(0.1, cell, barrier_speed), cubic=False
    )
    inner = slice(500, -500)
    assert means[inner] == pytest.approx(np.sin(phases)[inner], abs=0.01)
    assert slopes[inner] == pytest.approx(
        (phases[1] * np.cos(phases))[inner], abs=0.05 * phases[1]
    )


def test_a_piece_shorter_than_the_average_has_a_valid_average():
    means, slopes = averages_and_slopes(np.array([1.0, 5.0]), 9, [1])
    assert means == pytest.approx([1.0, 5.0])
    assert slopes == pytest.approx([0.0, 0.0])


def test_slopes_of_a_cubic_track_are_exact():
    for wide in [1, 2, 9]:
        times = np.arange(100.0) - 50
        _, slopes = averages_and_slopes(times**3 - 7 * times, wide, cubic=True)
        inner = slice(30, -30)
        assert slopes[inner] == pytest.approx(3 * times[inner] ** 2 - 7)


def test_an_acceleration_does_not_bias_the_average_position_under_a_force():
    frames = np.arange(200)
    track = 0.01 * frames + 2e-3 * frames**2
    means, slopes = averages_and_slopes(track, 10, cubic=True, forced=True)
    inner = slice(70, -70)
    assert means[inner] == pytest.approx(track[inner])
    assert slopes[inner] == pytest.approx(np.gradient(track)[inner])


@pytest.mark.parametrize('period', [21, 42])
def test_the_ripple_between_rotors_is_not_in_the_slope_under_a_force(period):
    frames = np.arange(600)
    track = 0.6 * frames - 4e-4 * frames**2 + 0.1 * np.sin(2 * np.pi * frames / period)
    _, slopes = averages_and_slopes(track, 10, cubic=True, forced=True)
    inner = slice(70, -70)
    ripple = 0.1 * 2 * np.pi / period
    assert np.abs(slopes - 0.6 + 8e-4 * frames)[inner].max() < 0.2 * ripple


def test_the_slope_of_a_wall_that_stops_is_correct_before_and_after_the_stop():
    left = np.maximum(300.0 - np.arange(600), 0.0)
    track = -1e-3 * left**2
    means, slopes = averages_and_slopes(track, 10, cubic=True, forced=True)
    inner = slice(70, -70)
    assert means[inner] == pytest.approx(track[inner], abs=1e-4)
    assert slopes[inner] == pytest.approx(2e-3 * left[inner], abs=1e-3)


@pytest.mark.parametrize(('example', 'speed'), [(WOBBLER, 0.1), (WOBBLER, 0.15), (SPINNER, 0.1)])
def test_the_analyser_predicts_the_ripple_of_the_site(example, speed):
    cell = cell_of(example, 40, speed=speed)
    scene = scene_of(cell, 800, np.random.default_rng(2))
    sites, rate = scene.instants[:, 0], float(np.median(np.abs(scene.site_rates)))
    assert scene.scored.all()
    frames = np.arange(len(sites))
    ripple = np.std(sites - np.polyval(np.polyfit(frames, sites, 3), frames))
    orbit = orbit_of(cell.chain)
    variance = ComplianceCorrection(orbit).ripple(rate * orbit.site_arc)
    assert np.sqrt(variance) == pytest.approx(ripple, rel=0.25)
