# SPDX-License-Identifier: Apache-2.0
"""What rounded readings tell, of rotors that rest and that turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, passage, read, unequal

from soliton_linkage.identification.geometry.adjustment import adjusted
from soliton_linkage.identification.geometry.bundle import Bundle
from soliton_linkage.identification.geometry.lengths import lengths_of
from soliton_linkage.identification.geometry.start import equal_rotors
from soliton_linkage.identification.geometry.tolerances import unknowns_of
from soliton_linkage.identification.rounding import repeats, rounding_noise

STEP = 2 * np.pi / 4096


def test_readings_repeat_as_long_as_they_are_the_same() -> None:
    rests = np.array([[1.0, 1.0, np.nan, 1.0, 2.0, 1.0, 1.0], np.arange(7.0)]).T
    expected = np.array([[3.0, 3.0, 1.0, 3.0, 1.0, 2.0, 2.0], np.ones(7)]).T
    np.testing.assert_array_equal(repeats(rests), expected)
    assert rounding_noise(rests) == 1 / np.sqrt(12)
    assert rounding_noise(np.ones((3, 2))) == 0


def test_frames_that_repeat_tell_as_much_as_one() -> None:
    chain = unequal(FLIPPER, 5)
    lengths, angles = lengths_of(chain), passage(chain, 20)
    repeated = np.repeat(angles, 7, axis=0)
    once, often = (Bundle(lengths, each, None, repeats(each)) for each in (angles, repeated))
    matrix = once.normal_equations().matrix
    np.testing.assert_allclose(often.normal_equations().matrix, matrix, atol=1e-9)
    assert often.conditions == pytest.approx(once.conditions)


def test_what_is_stated_of_rounded_readings_is_true_however_long_rotors_rest() -> None:
    """Errors over what is stated are 5 where each reading counts as new."""
    over = []
    for seed in range(50, 58):
        chain = unequal(FLIPPER, seed)
        moving = passage(chain, 300)
        angles = np.concatenate([np.repeat(moving[:1], 600, axis=0), moving])
        readings, offsets = read(angles, seed, noise=0.0)
        rounded = STEP * np.rint(readings / STEP)
        found = adjusted(rounded, equal_rotors(rounded))
        true = replace(lengths_of(chain).scaled(1.0), offsets=offsets)
        errors = unknowns_of(found.lengths.scaled(1.0)) - unknowns_of(true)
        over.append(errors / found.deviations)
    assert np.sqrt(np.mean(np.square(over))) == pytest.approx(1.0, abs=0.2)
