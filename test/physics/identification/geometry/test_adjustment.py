# SPDX-License-Identifier: Apache-2.0
"""Lengths are as near to the truth as the bound allows, and what is stated of them holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, SPINNER, WOBBLER, passage, read, unequal

from soliton_linkage.identification.geometry.adjustment import adjusted, bound
from soliton_linkage.identification.geometry.bundle import Bundle, misclosures
from soliton_linkage.identification.geometry.lengths import Lengths, lengths_of, split
from soliton_linkage.identification.geometry.start import equal_rotors
from soliton_linkage.identification.geometry.tolerances import Tolerances, unknowns_of
from soliton_linkage.linkage.chain import Chain

DRAWS = 3
NEARLY_STOPPING = 6041
"""Seed of a chain whose first two bonds nearly stop walls."""


def test_slopes_of_misclosures_are_their_changes() -> None:
    chain = unequal(WOBBLER, 3)
    angles = np.random.default_rng(1).uniform(-3, 3, (10, 4))
    lengths = lengths_of(chain)
    about = misclosures(lengths, angles)
    for unknown in range(4 * 10 - 2):
        step = np.zeros(4 * 10 - 2)
        step[unknown] = 1e-6
        rotor = unknown // 4
        shift = np.zeros((10, 1))
        if unknown % 4 == 1:
            shift[rotor] = 1e-6
        above = misclosures(lengths.changed(step), angles - shift).values
        below = misclosures(lengths.changed(-step), angles + shift).values
        change = (above - below) / 2e-6
        expected = np.zeros_like(change)
        if rotor < 9:
            expected[rotor] = about.slopes[rotor, :, unknown % 4]
        if unknown % 4 < 2 and rotor > 0:
            expected[rotor - 1] += about.slopes[rotor - 1, :, 4 + unknown % 4]
        np.testing.assert_allclose(change, expected, atol=1e-8)


def test_the_information_is_that_of_all_bonds_of_a_frame_together() -> None:
    """The naive twin: J^T (R R^T)^-1 J with full matrices."""
    chain = unequal(FLIPPER, 5)
    angles = passage(chain, 7)
    lengths = lengths_of(chain)
    matrix = np.zeros((38, 38))
    for frame in angles:
        about = misclosures(lengths, frame[:, None])
        rigidity, slopes = np.zeros((9, 10)), np.zeros((9, 38))
        for n in range(9):
            rigidity[n, n : n + 2] = about.first[n, 0], about.second[n, 0]
            slopes[n, 4 * n : 4 * n + 6] = about.slopes[n, 0]
        matrix += slopes.T @ np.linalg.solve(rigidity @ rigidity.T, slopes)
    found = Bundle(lengths, angles).normal_equations().matrix
    np.testing.assert_allclose(found, matrix, atol=1e-9 * np.abs(matrix).max())


def test_angles_do_not_tell_the_scale() -> None:
    chain = unequal(SPINNER, 2)
    matrix = Bundle(lengths_of(chain), passage(chain, 50)).normal_equations().matrix
    scale = np.ones(38)
    split(scale)[1][:] = 0
    assert np.abs(matrix @ scale).max() < 1e-9 * np.abs(matrix).max()


@pytest.mark.parametrize(
    'chain', [FLIPPER, WOBBLER, SPINNER], ids=['flipper', 'wobbler', 'spinner']
)
def test_lengths_are_as_near_as_the_bound_allows_and_deviations_true(chain: Chain) -> None:
    """Over chains and noise; `benchmark/identification.py` measures long ones, more often."""
    over_bound, over_stated, noises = [], [], []
    for seed in range(DRAWS):
        made = unequal(chain, 10 * seed)
        angles = passage(made)
        readings, offsets = read(angles, seed)
        found = adjusted(readings, equal_rotors(readings))
        assert found.settled
        true = replace(lengths_of(made).scaled(1.0), offsets=offsets)
        errors = unknowns_of(found.lengths) - unknowns_of(true)
        least = np.sqrt(np.diag(bound(made, angles, 0.01, Tolerances(0.05, 0.05))))
        over_bound.append(errors / least)
        over_stated.append(errors / found.deviations)
        noises.append(found.noise)
    # Of 3 times 38 errors, of which neighbours go together.
    assert np.sqrt(np.mean(np.square(over_bound))) == pytest.approx(1, abs=0.3)
    assert np.sqrt(np.mean(np.square(over_stated))) == pytest.approx(1, abs=0.3)
    assert np.mean(noises) == pytest.approx(0.01, rel=0.02)


@pytest.mark.parametrize('seed', [0, 2])
def test_lengths_of_bonds_that_nearly_stop_walls_are_found(seed: int) -> None:
    """Frames in which a bond is in line with a rotor close on either side of that."""
    many = lengths_of(unequal(replace(FLIPPER, number_of_rotors=40), NEARLY_STOPPING))
    few = many.rotor_lengths[:6], many.spacings[:5], many.rest_lengths[:5]
    made = Lengths(*few, np.zeros(6)).chain(FLIPPER)
    room = made.rest_lengths - made.spacings - np.abs(np.diff(made.rotor_lengths))
    assert (np.sort(room / made.spacings)[:2] < 0.005).all()
    readings, offsets = read(passage(made, 250), seed)
    found = adjusted(readings, equal_rotors(readings))
    errors = unknowns_of(found.lengths.scaled(1.0))
    errors -= unknowns_of(replace(lengths_of(made).scaled(1.0), offsets=offsets))
    assert found.settled
    assert found.noise == pytest.approx(0.01, rel=0.05)
    assert np.abs(errors / found.deviations).max() < 4
