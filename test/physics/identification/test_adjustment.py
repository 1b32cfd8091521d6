# SPDX-License-Identifier: Apache-2.0
"""Estimated lengths reach the Cramer-Rao bound, and walls pass with them."""

from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, SPINNER, WOBBLER, passage, read, unequal

from soliton_linkage.identification.adjustment import (
    adjust,
    cramer_rao_bound,
    near_limit_bonds,
    passable,
)
from soliton_linkage.identification.bundle import Bundle, misclosures
from soliton_linkage.identification.lengths import (
    Lengths,
    Tolerances,
    chain_lengths,
    initial_lengths,
    split,
    to_unknowns,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.passage import blocked_bonds

DRAWS = 3
NEARLY_STOPPING = 6041
"""Seed of a chain whose first two bonds are close to a limit."""


def test_slopes_of_misclosures_agree_with_differences():
    chain = unequal(WOBBLER, 3)
    angles = np.random.default_rng(1).uniform(-3, 3, (10, 4))
    lengths = chain_lengths(chain)
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


def test_the_information_agrees_with_full_matrices():
    """Compare with J^T (R R^T)^-1 J."""
    chain = unequal(FLIPPER, 5)
    angles = passage(chain, 7)
    lengths = chain_lengths(chain)
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


def test_the_scale_is_not_observable():
    chain = unequal(SPINNER, 2)
    matrix = Bundle(chain_lengths(chain), passage(chain, 50)).normal_equations().matrix
    scale = np.ones(38)
    split(scale)[1][:] = 0
    assert np.abs(matrix @ scale).max() < 1e-9 * np.abs(matrix).max()


@pytest.mark.parametrize(
    'chain', [FLIPPER, WOBBLER, SPINNER], ids=['flipper', 'wobbler', 'spinner']
)
def test_errors_reach_the_bound_and_agree_with_stated_deviations(chain):
    """Use short chains; `benchmark/identification.py` measures long ones, with more draws."""
    over_bound, over_stated, noises = [], [], []
    for seed in range(DRAWS):
        made = unequal(chain, 10 * seed)
        angles = passage(made)
        readings, offsets = read(angles, seed)
        found = adjust(readings, initial_lengths(readings))
        assert found.converged
        true = replace(chain_lengths(made).scaled(1.0), offsets=offsets)
        errors = to_unknowns(found.lengths) - to_unknowns(true)
        least = np.sqrt(np.diag(cramer_rao_bound(made, angles, 0.01, Tolerances(0.05, 0.05))))
        over_bound.append(errors / least)
        over_stated.append(errors / found.deviations)
        noises.append(found.noise)
    # 3 times 38 errors, which are correlated between neighbours.
    assert np.sqrt(np.mean(np.square(over_bound))) == pytest.approx(1, abs=0.3)
    assert np.sqrt(np.mean(np.square(over_stated))) == pytest.approx(1, abs=0.3)
    assert np.mean(noises) == pytest.approx(0.01, rel=0.02)


@pytest.mark.parametrize('seed', [0, 2])
def test_lengths_of_bonds_close_to_a_limit_are_found(seed):
    """A frame whose bond is in line with a rotor can close on either side of it."""
    many = chain_lengths(unequal(replace(FLIPPER, number_of_rotors=40), NEARLY_STOPPING))
    few = many.rotor_lengths[:6], many.spacings[:5], many.rest_lengths[:5]
    made = Lengths(*few, np.zeros(6)).chain(FLIPPER)
    room = made.rest_lengths - made.spacings - np.abs(np.diff(made.rotor_lengths))
    assert (np.sort(room / made.spacings)[:2] < 0.005).all()
    readings, offsets = read(passage(made, 250), seed)
    found = adjust(readings, initial_lengths(readings))
    errors = to_unknowns(found.lengths.scaled(1.0))
    errors -= to_unknowns(replace(chain_lengths(made).scaled(1.0), offsets=offsets))
    assert found.converged
    assert found.noise == pytest.approx(0.01, rel=0.05)
    assert np.abs(errors / found.deviations).max() < 4


SPREAD = 0.01
COVARIANCE = SPREAD**2 * np.eye(38)


def blocked(lengths: Lengths) -> Array:
    return np.flatnonzero(blocked_bonds(lengths.chain(Chain())))


@pytest.mark.parametrize('chain', [FLIPPER, SPINNER], ids=['flipper', 'spinner'])
def test_a_bond_beyond_its_limit_by_noise_is_corrected(chain):
    true = chain_lengths(unequal(chain, 2))
    assert passable(true, COVARIANCE) is true
    limit = true.spacings[4] + abs(true.rotor_lengths[4] - true.rotor_lengths[5])
    rest = true.rest_lengths.copy()
    rest[4] = 0.995 * limit
    wrong = replace(true, rest_lengths=rest)
    assert 4 in blocked(wrong)
    found = passable(wrong, COVARIANCE)
    assert not blocked(found).size
    assert abs(found.rest_lengths[4] / rest[4] - 1) < SPREAD
    np.testing.assert_array_equal(found.rest_lengths[6:], rest[6:])


def test_a_bond_far_beyond_its_limit_is_neither_corrected_nor_near_it():
    true = chain_lengths(unequal(FLIPPER, 2))
    rest = true.rest_lengths.copy()
    rest[4] = 0.8 * true.spacings[4]
    wrong = replace(true, rest_lengths=rest)
    assert passable(wrong, COVARIANCE) is wrong
    assert 4 not in near_limit_bonds(wrong, COVARIANCE)


@pytest.mark.parametrize(
    ('chain', 'spread'), [(FLIPPER, 0.02), (SPINNER, 0.05)], ids=['flipper', 'spinner']
)
def test_probabilities_of_bonds_near_a_limit_agree_with_draws(chain, spread):
    lengths = chain_lengths(unequal(chain, 2))
    random = np.random.default_rng(1)

    def drawn(values: Array) -> Array:
        return values * np.exp(spread * random.standard_normal((20_000, len(values))))

    r, a, rest = map(drawn, (lengths.rotor_lengths, lengths.spacings, lengths.rest_lengths))
    spins = r[:, :-1] + r[:, 1:] > a + rest
    stopped = (rest < a + np.abs(np.diff(r))) | (spins != (chain is SPINNER))
    fractions = stopped.mean(axis=0)
    found = near_limit_bonds(lengths, spread**2 * np.eye(len(COVARIANCE)))
    assert 0 < len(found) < len(fractions)
    for bond, fraction in enumerate(fractions.tolist()):
        assert found.get(bond, 0.0) == pytest.approx(fraction, abs=0.02)
