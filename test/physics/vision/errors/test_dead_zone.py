# SPDX-License-Identifier: Apache-2.0
"""Errors along the way of dots in films that keep only what changes by more than a step."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.vision.errors.dead_zone import DeadZone

ROTORS = 200
PIXELS = np.full(ROTORS, 50.0)
SAID = np.full(ROTORS, 2e-4)
NEVER, SEEN = np.zeros(ROTORS, dtype=bool), np.ones(ROTORS, dtype=bool)


def moved(
    pictures: int, along: float, lasting: float, jitter: float = 0.0, wave: float = 0.0
) -> DeadZone:
    """Dots on parabolas and waves of 8 Hz, with errors over what pixels say that last."""
    random, zone = np.random.default_rng(1), DeadZone(ROTORS)
    phases = random.uniform(0, 2 * np.pi, ROTORS)
    errors = random.normal(size=(2, ROTORS))
    for picture in range(pictures):
        time = picture / 60 + jitter * random.uniform() / 60
        fresh = np.sqrt(1 - lasting**2) * random.normal(size=(2, ROTORS))
        errors = lasting * errors + fresh
        angles = 3.0 * time + 2.0 * time**2 + wave * np.sin(50 * time + phases)
        zone.take(time, angles + along * SAID * errors[0], 2.0 * errors[1], SAID, PIXELS, 1.0)
    return zone


@pytest.mark.parametrize('jitter', [0.0, 0.4])
def test_errors_along_the_way_are_told_from_motion_at_whatever_times_pictures_come(
    jitter: float,
) -> None:
    zone = moved(60, 4.0, 0.0, jitter, 1e-3)
    assert np.sqrt(zone.variances(1.0, 1.0)) == pytest.approx(4.0, rel=0.05)


def test_errors_that_last_are_found_by_those_across_the_way() -> None:
    zone = moved(90, 4.0, 0.4)
    assert np.sqrt(zone.variances(1.0, 1.0)) == pytest.approx(4.0, rel=0.06)


def test_jumps_are_believed_until_dots_have_moved() -> None:
    assert DeadZone(2).variances(1.0, 9.0) == pytest.approx(9.0)


def test_a_dot_that_is_repeated_for_long_stands() -> None:
    zone = moved(60, 4.0, 0.0)
    stands, creeps = np.arange(ROTORS) == 0, np.arange(ROTORS) % 2 == 1
    for picture in range(90):
        zone.take_repeated(stands | (creeps & (picture % 5 > 0)), SEEN)
    deviations = np.sqrt(zone.variances(1.0, 1.0))
    moving = deviations[2]
    assert deviations[0] == pytest.approx(np.sqrt(1 + (moving**2 - 1) / (1 + 90 / 4)), rel=1e-6)
    assert deviations[0] < deviations[1] < moving


def test_it_is_there_where_some_dots_are_repeated_and_others_are_not() -> None:
    zone = DeadZone(ROTORS)
    for repeated in (NEVER, SEEN):
        zone.take_repeated(repeated, SEEN)
        assert not zone.there
    zone.take_repeated(np.arange(ROTORS) < 3, SEEN)
    assert zone.there
