# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of the estimation against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from soliton_linkage.estimation import filter_bank, likelihood, state_loops
from soliton_linkage.estimation.frames import all_within
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations

ROTORS, WALL = 60, 27


def angles_of(random: np.random.Generator) -> Array:
    """A wall between leaning rotors, with noise, whole turns and gaps."""
    signs = 1.0 - 2.0 * (np.arange(ROTORS) % 2)
    theta = -0.97 * np.tanh((np.arange(ROTORS) - WALL) / 3)
    angles = np.where(signs > 0, theta, math.pi - theta) + 0.03 * random.standard_normal(ROTORS)
    angles += 2 * math.pi * random.integers(-2, 3, ROTORS)
    angles[random.random(ROTORS) < 0.1] = math.nan
    return np.asarray(angles)


def test_nothing_is_compiled_in_a_frame() -> None:
    # Another type than those compiled for is refused, not compiled.
    with pytest.raises(TypeError):
        all_within(np.zeros(4, dtype=np.float32), 1.0)
    frozen = np.ones(4)
    frozen.flags.writeable = False
    assert all_within(frozen, 1.0)


def test_a_scan_finds_the_likelihood_of_each_sample() -> None:
    random, variance, bound, floor = np.random.default_rng(5), 0.04, 2.5, -4.0
    angles, walls = angles_of(random), angles_of(random)
    apart = np.remainder(angles - walls + math.pi, 2 * math.pi) - math.pi
    expected = likelihood.frame_likelihood(apart, variance, bound, floor)
    table = np.empty(2 + math.ceil(math.pi / math.sqrt(variance) * 32))
    likelihood.tabulate(variance, bound, floor, table)
    found, first = np.empty(1), np.zeros(1, dtype=np.int64)
    sums, begins = np.zeros((1, ROTORS + 1)), np.array([0, ROTORS])
    samples = likelihood.SampledWalls(first, first, begins, walls)
    likelihood.scan(angles, sums, sums, samples, table, found)
    assert found[0] == pytest.approx(expected, abs=ROTORS / (8 * 32**2))


def test_a_filter_without_a_share_may_be_the_likeliest_by_any_amount() -> None:
    # The steady filter and one with all shares expect 0, one without a share and a kick expect 1.
    made = np.zeros(4, filter_bank.FILTER)
    made['state'][:, filter_bank.ARC] = [0.0, 0.0, 1.0, 1.0]
    variance = 1e-12
    made['covariance'][:, filter_bank.ARC, filter_bank.ARC] = variance
    made['probability'][1] = 1.0
    made['weight'][:2] = 0.5
    made['likelihood'][2] = -2000.0
    against, largest = filter_bank.update(made, 3, 1.0, variance, math.inf)
    assert against == pytest.approx(0.0, abs=1e-9)
    assert largest == made['odds'][3] == pytest.approx(1 / (4 * variance))
    assert made['probability'][1:3] == pytest.approx([0.0, 1.0])


@pytest.mark.parametrize('periodic', [False, True])
def test_springs_are_those_of_the_chain(periodic: bool) -> None:
    deviations = drawn_deviations(12, 3, periodic, rotor_length=0.1, spacing=0.1, rest_length=0.1)
    chain = Chain(number_of_rotors=12, periodic=periodic, deviations=deviations)
    angles = np.random.default_rng(2).uniform(-4, 4, 12)
    rows = np.empty((3, chain.number_of_springs))
    state_loops.of_angles(angles, chain.spring_parameters, periodic, rows)
    assert rows == pytest.approx(np.array(chain.springs(angles)), rel=1e-12, abs=1e-15)


def test_the_mode_sits_where_its_squares_do_however_far_they_fall() -> None:
    # Squares of 10^(2 k) as far as k = 400 below the largest, and up again.
    falls = np.concatenate([np.arange(500), np.arange(500)[::-1], np.full(3, 0)])
    exponents = 2.0 * falls
    ratios = 10.0 ** np.diff(exponents)
    rows = np.ones((3, len(ratios)))
    rows[1] = np.sqrt(ratios)
    *_, centre = state_loops.topology(rows, 1, 1, 0.5)
    weights = 10.0 ** (exponents - exponents.max())
    assert centre == pytest.approx(np.arange(len(weights)) @ weights / weights.sum(), rel=1e-9)
