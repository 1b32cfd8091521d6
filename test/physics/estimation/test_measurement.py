# SPDX-License-Identifier: Apache-2.0
"""The likelihood of a frame: its density, and that no reading alone moves an arc far."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from soliton_linkage.estimation.likelihood import frame_likelihood
from soliton_linkage.estimation.measurement import FrameLikelihood
from soliton_linkage.estimation.settings import DEFAULTS

GIVEN = DEFAULTS.likelihood
TANGENT = np.array([0.1, 0.5, 0.7, -0.5, 0.05])
FIRST, ROTORS = 3, 12


def likelihood() -> FrameLikelihood:
    return FrameLikelihood(2.0, GIVEN)


@pytest.mark.parametrize('sigma', [0.01, 0.1])
def test_the_density_is_one_over_all_differences(sigma: float) -> None:
    floor = likelihood().floor(sigma**2)

    def density(apart: float) -> float:
        return math.exp(frame_likelihood(np.array([apart]), sigma**2, GIVEN.bound, floor))

    whole = quad(density, -math.pi, math.pi, points=(-3 * sigma, 0, 3 * sigma), limit=200)[0]
    of_nothing = 2 * math.pi * math.exp(floor)
    assert of_nothing / whole == pytest.approx(GIVEN.wrong, rel=0.05)


def test_the_step_ahead_is_that_of_weighted_least_squares() -> None:
    differences = np.random.default_rng(1).normal(0, 0.1, ROTORS)
    differences[[0, 5]] = np.nan
    view = likelihood().linearise(2.0, FIRST, TANGENT, differences.copy(), 0.1**2)
    used = np.array([True, True, False, True, True])
    about, weights = differences[FIRST : FIRST + 5][used], view.weights[FIRST : FIRST + 5][used]
    ahead = weights * TANGENT[used] @ about / (weights @ TANGENT[used] ** 2)
    assert view.arc == pytest.approx(2.0 + ahead)
    assert view.information == pytest.approx(weights @ TANGENT[used] ** 2)
    left = view.inlying[FIRST : FIRST + 5]
    assert left[used] == pytest.approx(about - ahead * TANGENT[used])
    assert left[2] == 0
    assert view.known == 10
    assert view.degrees_of_freedom == 3
    assert np.isnan(view.residuals).nonzero()[0].tolist() == [0, 5]


@pytest.mark.parametrize('rotor', [1, 2, 3])
def test_no_reading_alone_moves_the_arc_by_more_than_the_bound(rotor: int) -> None:
    sigma = 0.01
    for size in np.geomspace(0.001, 3.0, 60).tolist():
        differences = np.zeros(ROTORS)
        differences[FIRST + rotor] = size
        view = likelihood().linearise(2.0, FIRST, TANGENT, differences, sigma**2)
        moved = abs(view.arc - 2.0) * math.sqrt(view.information) / sigma
        assert moved < GIVEN.bound


def test_a_wide_guess_of_the_arc_makes_no_outliers_of_what_moves() -> None:
    differences = np.zeros(ROTORS)
    differences[FIRST : FIRST + 5] = 0.3 * TANGENT
    assert likelihood().linearise(2.0, FIRST, TANGENT, differences.copy(), 0.01**2).unbelieved
    view = likelihood().linearise(2.0, FIRST, TANGENT, differences, 0.01**2, spread=0.15**2)
    assert not view.unbelieved
    assert view.arc == pytest.approx(2.3)


def test_doubtful_rotors_do_not_count() -> None:
    differences = np.full(ROTORS, 0.001)
    doubtful = np.zeros(ROTORS, dtype=np.bool_)
    doubtful[FIRST + 2] = True
    view = likelihood().linearise(2.0, FIRST, TANGENT, differences, 0.01**2, doubtful=doubtful)
    assert view.weights[FIRST + 2] == 0
    assert view.information == pytest.approx(TANGENT @ TANGENT - TANGENT[2] ** 2)


def test_frames_that_are_refused_by_chance_are_as_rare_as_stated() -> None:
    random, told = np.random.default_rng(2), likelihood()
    refused = 0
    for _ in range(3000):
        differences = 0.01 * random.standard_normal(ROTORS)
        wrong = random.random(ROTORS) < 0.03
        differences[wrong] = random.uniform(-math.pi, math.pi, int(wrong.sum()))
        view = told.linearise(2.0, FIRST, TANGENT, differences, 0.01**2)
        refused += not told.explains(view, 0.1)
    assert refused < 10
    for _ in range(100):
        differences = random.uniform(-math.pi, math.pi, ROTORS)
        view = told.linearise(2.0, FIRST, TANGENT, differences, 0.1**2)
        assert not told.explains(view, 0.2**2)
