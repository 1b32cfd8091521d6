# SPDX-License-Identifier: Apache-2.0
"""Domains are the best division of a chain, and rotors that are read wrongly are none."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.estimation.shape_model import domain_borders
from soliton_linkage.estimation.wall_loops import domains
from soliton_linkage.linkage.chain import Array

OPPOSITE = DEFAULTS.walls.domain_bonds


def value(polarised: Array, leans: Array, cost: float) -> float:
    return float(np.clip(polarised, -1, 1) @ leans) - cost * np.count_nonzero(np.diff(leans))


@pytest.mark.parametrize('seed', range(4))
def test_no_other_division_is_better(seed: int) -> None:
    polarised = np.random.default_rng(seed).normal(0, 1.2, 10)
    right = np.empty(10, dtype=np.bool_)
    domains(polarised, OPPOSITE, right)
    found = value(polarised, np.where(right, 1.0, -1.0), OPPOSITE)
    others = (
        value(polarised, np.array(each), OPPOSITE) for each in product((-1.0, 1.0), repeat=10)
    )
    assert found == pytest.approx(max(others), abs=1e-12)


def test_two_bonds_that_a_wrong_rotor_turns_over_are_no_domain_and_three_are() -> None:
    polarised = np.ones(20)
    polarised[8:10] = -1
    assert domain_borders(polarised, OPPOSITE) == []
    polarised[10] = -1
    assert domain_borders(polarised, OPPOSITE) == [(8.0, 1), (11.0, -1)]


def test_charges_alternate_and_borders_lie_where_the_polarisation_vanishes() -> None:
    polarised = np.tanh((np.arange(40) - 12.25) / 2) * np.tanh((np.arange(40) - 30.5) / 2)
    places, charges = zip(*domain_borders(polarised, OPPOSITE), strict=True)
    assert charges == (1, -1)
    np.testing.assert_allclose(places, (12.75, 31.0), atol=0.01)
