# SPDX-License-Identifier: Apache-2.0
"""Errors of dots beyond the noise of pixels are learnt from the pictures so far."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.vision.dot_errors import DeadZone, DotMeasurements, ErrorScale, RepeatDetector

ROTORS = 40
WAYS = np.where(np.arange(ROTORS) < 30, 0.0, 2.0)
ONES, NEVER = np.ones(ROTORS), np.zeros(ROTORS, dtype=bool)
DOTS = 200
PIXELS, TURNING = np.full(DOTS, 50.0), np.full(DOTS, 2e-4)
NONE, ALL = np.zeros(DOTS, dtype=bool), np.ones(DOTS, dtype=bool)
PLACES = np.array([[3.0, 10.0], [20.0, 10.0], [np.nan, np.nan]])


def test_dots_are_repeated_where_no_pixel_near_them_differs() -> None:
    repeats = RepeatDetector()
    picture = np.random.default_rng(1).integers(0, 256, (20, 40), dtype=np.uint8)
    assert not repeats.compare(picture, PLACES, 4.0).any()
    changed = picture.copy()
    changed[10, 10] += 1
    changed[7, 22] += 1
    assert repeats.compare(changed, PLACES, 4.0).tolist() == [True, False, False]
    changed[8, 3] += 1
    assert repeats.compare(changed, PLACES, 4.0).tolist() == [False, True, False]


def look(
    scatter: ErrorScale,
    lengths: np.ndarray,
    picture: int = 0,
    angles: np.ndarray = 0 * ONES,
    repeated: np.ndarray = NEVER,
) -> np.ndarray:
    return scatter.update(
        DotMeasurements(picture / 60, angles, ONES, lengths, ONES, WAYS, repeated)
    )


def test_the_scatter_of_dots_that_stand_and_of_those_that_move_is_found() -> None:
    random, scatter = np.random.default_rng(1), ErrorScale(ROTORS)
    for picture in range(400):
        lengths = np.where(WAYS, 2.0, 0.5) * random.normal(size=ROTORS)
        factors = look(scatter, lengths, picture)
    np.testing.assert_allclose(factors, np.where(WAYS, 2.0, 0.5), rtol=0.1)


def test_dots_that_were_all_repeated_for_long_are_off_by_what_they_jump() -> None:
    random, scatter = np.random.default_rng(3), ErrorScale(ROTORS)
    angles = 0 * ONES
    for picture in range(400):
        if picture % 10 == 0:
            angles = angles + 3.0 * random.normal(size=ROTORS)
        repeated = np.full(ROTORS, picture % 10 > 0)
        factors = look(scatter, random.normal(size=ROTORS), picture, angles, repeated)
    np.testing.assert_allclose(factors, 3.0, rtol=0.1)


def moved(
    pictures: int, along: float, lasting: float, jitter: float = 0.0, wave: float = 0.0
) -> DeadZone:
    """Dots on parabolas and waves of 8 Hz, with errors over what pixels say that last."""
    random, zone = np.random.default_rng(1), DeadZone(DOTS)
    phases = random.uniform(0, 2 * np.pi, DOTS)
    errors = random.normal(size=(2, DOTS))
    for picture in range(pictures):
        time = picture / 60 + jitter * random.uniform() / 60
        fresh = np.sqrt(1 - lasting**2) * random.normal(size=(2, DOTS))
        errors = lasting * errors + fresh
        angles = 3.0 * time + 2.0 * time**2 + wave * np.sin(50 * time + phases)
        angles += along * TURNING * errors[0]
        shown = DotMeasurements(time, angles, TURNING, 2.0 * errors[1], PIXELS, 0 * PIXELS, NONE)
        zone.take(shown, 1.0)
    return zone


@pytest.mark.parametrize(
    ('pictures', 'lasting', 'jitter', 'wave', 'tolerance'),
    [(60, 0.0, 0.0, 1e-3, 0.05), (60, 0.0, 0.4, 1e-3, 0.05), (90, 0.4, 0.0, 0.0, 0.06)],
)
def test_errors_along_the_way_are_separated_from_motion_even_if_they_last(
    pictures: int, lasting: float, jitter: float, wave: float, tolerance: float
) -> None:
    zone = moved(pictures, 4.0, lasting, jitter, wave)
    assert np.sqrt(zone.variances(1.0, 1.0)) == pytest.approx(4.0, rel=tolerance)


def test_a_dot_that_is_repeated_for_long_stands() -> None:
    zone = moved(60, 4.0, 0.0)
    stands, creeps = np.arange(DOTS) == 0, np.arange(DOTS) % 2 == 1
    for picture in range(90):
        zone.take_repeated(stands | (creeps & (picture % 5 > 0)), ALL)
    deviations = np.sqrt(zone.variances(1.0, 1.0))
    moving = deviations[2]
    assert deviations[0] == pytest.approx(np.sqrt(1 + (moving**2 - 1) / (1 + 90 / 4)), rel=1e-6)
    assert deviations[0] < deviations[1] < moving


def test_it_is_there_where_some_dots_are_repeated_and_others_are_not() -> None:
    zone = DeadZone(DOTS)
    for repeated in (NONE, ALL):
        zone.take_repeated(repeated, ALL)
        assert not zone.there
    zone.take_repeated(np.arange(DOTS) < 3, ALL)
    assert zone.there
