# SPDX-License-Identifier: Apache-2.0
"""What dots scatter more than their pixels say is learnt, of those that stand and that move."""

from __future__ import annotations

import numpy as np

from soliton_linkage.vision.errors.scatter import Scatter, Sightings

ROTORS = 40
WAYS = np.where(np.arange(ROTORS) < 30, 0.0, 2.0)
ONES, NEVER = np.ones(ROTORS), np.zeros(ROTORS, dtype=bool)


def look(
    scatter: Scatter,
    lengths: np.ndarray,
    picture: int = 0,
    angles: np.ndarray = 0 * ONES,
    repeated: np.ndarray = NEVER,
) -> np.ndarray:
    return scatter.look(Sightings(picture / 60, angles, ONES, lengths, ONES, WAYS, repeated))


def test_pixels_are_believed_to_begin_with() -> None:
    assert look(Scatter(ROTORS), np.full(ROTORS, np.nan)).tolist() == [1.0] * ROTORS


def test_the_scatter_of_dots_that_stand_and_of_those_that_move_is_found() -> None:
    random, scatter = np.random.default_rng(1), Scatter(ROTORS)
    for picture in range(400):
        lengths = np.where(WAYS, 2.0, 0.5) * random.normal(size=ROTORS)
        factors = look(scatter, lengths, picture)
    np.testing.assert_allclose(factors, np.where(WAYS, 2.0, 0.5), rtol=0.1)


def test_dots_that_were_all_repeated_for_long_are_off_by_what_they_jump() -> None:
    random, scatter = np.random.default_rng(3), Scatter(ROTORS)
    angles = 0 * ONES
    for picture in range(400):
        if picture % 10 == 0:
            angles = angles + 3.0 * random.normal(size=ROTORS)
        repeated = np.full(ROTORS, picture % 10 > 0)
        factors = look(scatter, random.normal(size=ROTORS), picture, angles, repeated)
    np.testing.assert_allclose(factors, 3.0, rtol=0.1)
