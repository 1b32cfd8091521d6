# SPDX-License-Identifier: Apache-2.0
"""Errors of dots beyond pixel noise are estimated from the pictures."""

import numpy as np
import pytest

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.vision.dot_errors import DeadZone, DotMeasurements, ErrorScale, RepeatDetector
from soliton_linkage.vision.layout import MarkerLayout
from soliton_linkage.vision.rotor_tracks import RotorTracks

ROTORS = 40
WAYS = np.where(np.arange(ROTORS) < 30, 0.0, 2.0)
ONES, NEVER = np.ones(ROTORS), np.zeros(ROTORS, dtype=bool)
DOTS = 200
PIXELS, TURNING = np.full(DOTS, 50.0), np.full(DOTS, 2e-4)
NONE, ALL = np.zeros(DOTS, dtype=bool), np.ones(DOTS, dtype=bool)
PLACES = np.array([[3.0, 10.0], [20.0, 10.0], [np.nan, np.nan]])


def test_a_dot_is_repeated_if_all_its_pixels_are_equal():
    repeats = RepeatDetector()
    picture = np.random.default_rng(1).integers(0, 256, (20, 40), dtype=np.uint8)
    assert not repeats.compare(picture, PLACES, 4.0).any()
    changed = picture.copy()
    changed[10, 10] += 1
    changed[7, 22] += 1
    assert repeats.compare(changed, PLACES, 4.0).tolist() == [True, False, False]
    changed[8, 3] += 1
    assert repeats.compare(changed, PLACES, 4.0).tolist() == [False, True, False]


def update(
    scale: ErrorScale,
    lengths: np.ndarray,
    picture: int = 0,
    angles: np.ndarray = 0 * ONES,
    repeated: np.ndarray = NEVER,
) -> np.ndarray:
    return scale.update(DotMeasurements(picture / 60, angles, ONES, lengths, ONES, WAYS, repeated))


@pytest.mark.parametrize(('moving', 'resting'), [(0.9, 0.5), (2.0, 2.0)])
def test_errors_of_resting_and_moving_dots_are_estimated(moving, resting):
    random, scale = np.random.default_rng(1), ErrorScale(ROTORS)
    for picture in range(400):
        lengths = np.where(WAYS, moving, resting) * random.normal(size=ROTORS)
        factors = update(scale, lengths, picture)
    np.testing.assert_allclose(factors, np.where(WAYS, moving, resting), rtol=0.1)


def test_resting_dots_may_have_the_errors_of_moving_ones_if_these_are_much_larger():
    random, scale = np.random.default_rng(1), ErrorScale(ROTORS)
    for picture in range(100):
        factors = update(scale, np.where(WAYS, 3.0, 0.3) * random.normal(size=ROTORS), picture)
    np.testing.assert_allclose(factors, 3.0, rtol=0.1)


def test_small_errors_of_resting_dots_are_no_dead_zone_without_moving_dots():
    random, scale, rests = np.random.default_rng(1), ErrorScale(ROTORS), 0 * ONES
    for picture in range(100):
        errors = 0.3 * random.normal(size=ROTORS)
        dots = DotMeasurements(picture / 60, rests, ONES, errors, ONES, rests, NEVER)
        factors = scale.update(dots)
    np.testing.assert_allclose(factors, 0.3, rtol=0.1)


def test_the_constant_error_of_resting_dots_is_the_same_number_of_pixels_for_all_rotors():
    random, scale = np.random.default_rng(1), ErrorScale(ROTORS)
    pixels = np.linspace(20, 200, ROTORS)
    noise = 3e-3 / pixels
    for picture in range(400):
        lengths = random.normal(size=ROTORS)
        dots = DotMeasurements(picture / 60, 0 * ONES, noise, lengths, pixels, WAYS, NEVER)
        factors = scale.update(dots, 4e-3)
    np.testing.assert_allclose(factors * noise * pixels, np.where(WAYS, 3e-3, 5e-3), rtol=0.1)


def test_errors_of_moving_dots_exclude_the_constant_error_of_the_mean_length_at_rest():
    random, chain = np.random.default_rng(5), Chain(number_of_rotors=ROTORS)
    tracks, size = RotorTracks(MarkerLayout(chain)), 1e-5
    pivots = np.column_stack([chain.pivots, 0 * ONES])
    at_rest, errors = size * random.normal(size=ROTORS), []
    for picture in range(450):
        added = at_rest if picture < 300 else size * random.normal(size=ROTORS)
        lengths = chain.rotor_lengths + added
        errors.append(tracks.length_errors(lengths))
        tracks.add_lengths(pivots, pivots + np.column_stack([0 * ONES, lengths]))
    assert np.sqrt(np.mean(np.square(errors[350:]))) == pytest.approx(size, rel=0.05)


def test_errors_of_repeated_dots_are_estimated_from_their_jumps():
    random, scale = np.random.default_rng(3), ErrorScale(ROTORS)
    angles = 0 * ONES
    for picture in range(400):
        if picture % 10 == 0:
            angles = angles + 3.0 * random.normal(size=ROTORS)
        repeated = np.full(ROTORS, picture % 10 > 0)
        factors = update(scale, random.normal(size=ROTORS), picture, angles, repeated)
    np.testing.assert_allclose(factors, 3.0, rtol=0.1)


def moved(
    pictures: int,
    along: float,
    lasting: float,
    jitter: float = 0.0,
    wave: float = 0.0,
    resting: int = 0,
) -> DeadZone:
    """Move all but the first dots on parabolas with waves of 8 Hz and correlated errors."""
    random, zone = np.random.default_rng(1), DeadZone(DOTS)
    phases = random.uniform(0, 2 * np.pi, DOTS)
    errors = random.normal(size=(2, DOTS))
    for picture in range(pictures):
        time = picture / 60 + jitter * random.uniform() / 60
        fresh = np.sqrt(1 - lasting**2) * random.normal(size=(2, DOTS))
        errors = lasting * errors + fresh
        angles = 3.0 * time + 2.0 * time**2 + wave * np.sin(50 * time + phases)
        angles += along * TURNING * errors[0]
        angles[:resting] = 0.0
        shown = DotMeasurements(time, angles, TURNING, 2.0 * errors[1], PIXELS, 0 * PIXELS, NONE)
        zone.add(shown, 1.0)
    return zone


@pytest.mark.parametrize(
    ('pictures', 'lasting', 'jitter', 'wave', 'tolerance'),
    [(60, 0.0, 0.0, 1e-3, 0.05), (60, 0.0, 0.4, 1e-3, 0.05), (90, 0.4, 0.0, 0.0, 0.06)],
)
def test_errors_along_the_path_are_separated_from_motion(
    pictures, lasting, jitter, wave, tolerance
):
    zone = moved(pictures, 4.0, lasting, jitter, wave)
    assert np.sqrt(zone.variances(1.0, 1.0)) == pytest.approx(4.0, rel=tolerance)


def test_the_variance_falls_with_the_number_of_repeats_of_a_dot_that_has_not_moved():
    zone = moved(60, 4.0, 0.0, resting=DOTS // 2)
    stands, creeps = np.arange(DOTS) % 100 == 0, np.arange(DOTS) % 2 == 1
    for picture in range(90):
        zone.add_repeated(stands | (creeps & (picture % 5 > 0)), ALL)
    deviations = np.sqrt(zone.variances(1.0, 1.0))
    updated = deviations[2]
    assert deviations[0] == pytest.approx(np.sqrt(1 + (updated**2 - 1) / (1 + 90 / 4)), rel=1e-6)
    assert deviations[0] < deviations[1] < updated
    assert (deviations[100:] == updated).all()


def test_dots_in_a_dead_zone_have_its_errors_before_fast_dots_are_observed():
    scale, repeated = ErrorScale(ROTORS), np.arange(ROTORS) % 2 == 1
    pixels, rests = np.linspace(20, 200, ROTORS), 0 * ONES
    noise = 1e-3 / pixels
    for picture in range(20):
        dots = DotMeasurements(picture / 60, rests, noise, ONES, pixels, rests, repeated)
        errors = scale.update(dots) * noise * pixels
    np.testing.assert_allclose(errors[::2], 0.02, rtol=1e-2)
    assert (errors[1::2] < errors[::2]).all()
    hidden = np.full(ROTORS, np.nan)
    dots = DotMeasurements(1.0, hidden, hidden, hidden, hidden, rests, NEVER)
    assert np.isnan(scale.update(dots)).all()


def test_a_dead_zone_is_present_if_some_dots_repeat_and_others_do_not():
    zone = DeadZone(DOTS)
    for repeated in (NONE, ALL):
        zone.add_repeated(repeated, ALL)
        assert not zone.present
    zone.add_repeated(np.arange(DOTS) < 3, ALL)
    assert zone.present
