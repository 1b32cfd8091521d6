# SPDX-License-Identifier: Apache-2.0
"""Lengths that chance put beyond the limits of a passing wall come back by the least."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, SPINNER, unequal

from soliton_linkage.identification.geometry.lengths import Lengths, lengths_of
from soliton_linkage.identification.geometry.passable import nearly_stopping, passable
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.passage import blocked_bonds

SPREAD = 0.01
COVARIANCE = SPREAD**2 * np.eye(38)


def blocked(lengths: Lengths) -> Array:
    return np.flatnonzero(blocked_bonds(lengths.chain(Chain())))


@pytest.mark.parametrize('chain', [FLIPPER, SPINNER], ids=['flipper', 'spinner'])
def test_a_bond_that_chance_shortened_lets_walls_pass_again(chain: Chain) -> None:
    true = lengths_of(unequal(chain, 2))
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


def test_a_bond_that_is_surely_too_short_stays_so() -> None:
    true = lengths_of(unequal(FLIPPER, 2))
    rest = true.rest_lengths.copy()
    rest[4] = 0.8 * true.spacings[4]
    wrong = replace(true, rest_lengths=rest)
    assert passable(wrong, COVARIANCE) is wrong


@pytest.mark.parametrize(
    ('chain', 'spread'), [(FLIPPER, 0.02), (SPINNER, 0.05)], ids=['flipper', 'spinner']
)
def test_bonds_are_as_likely_to_stop_walls_as_lengths_that_are_drawn(
    chain: Chain, spread: float
) -> None:
    lengths = lengths_of(unequal(chain, 2))
    random = np.random.default_rng(1)

    def drawn(values: Array) -> Array:
        return values * np.exp(spread * random.standard_normal((20_000, len(values))))

    r, a, rest = map(drawn, (lengths.rotor_lengths, lengths.spacings, lengths.rest_lengths))
    spins = r[:, :-1] + r[:, 1:] > a + rest
    stopped = (rest < a + np.abs(np.diff(r))) | (spins != (chain is SPINNER))
    shares = stopped.mean(axis=0)
    told = nearly_stopping(lengths, spread**2 * np.eye(len(COVARIANCE)))
    assert 0 < len(told) < len(shares)
    for bond, share in enumerate(shares.tolist()):
        assert told.get(bond, 0.0) == pytest.approx(share, abs=0.02)


def test_a_bond_that_surely_stops_walls_is_not_among_those_that_may() -> None:
    lengths = lengths_of(unequal(FLIPPER, 2))
    rest = lengths.rest_lengths.copy()
    rest[4] = 0.8 * lengths.spacings[4]
    assert 4 not in nearly_stopping(replace(lengths, rest_lengths=rest), COVARIANCE)
