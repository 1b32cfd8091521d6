# SPDX-License-Identifier: Apache-2.0
"""The nearest point by rotors that are seen and by springs, against that by all rotors."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER, chain_of

from soliton_linkage.estimation.orbit_model import UnseenRotorCorrection
from soliton_linkage.linear.rigidity import rigidity_matrix
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

ROTORS, RATE = 10, 8.0
ARC_STEP = 1e-4


@lru_cache(maxsize=3)
def orbit_of(example: tuple[float, float]) -> Orbit:
    return UniformOrbit(chain_of(example, ROTORS))


def stiffness(orbit: Orbit, arc: float) -> Array:
    """K = R^T k R, dense, shape (N, N)."""
    levers = rigidity_matrix(orbit.chain, orbit.configuration(arc)).toarray()
    return np.asarray(levers.T @ (orbit.chain.stiffnesses[:, None] * levers))


def seen_shift(
    orbit: Orbit, arc: float, beside: Array, hidden: list[int], rate: float, noise: float
) -> tuple[float, float]:
    """Arc nearest to the rotors of a frame that are seen, without and with springs [rad]."""
    tangent = orbit.tangent(arc)
    seen = np.delete(np.arange(ROTORS), hidden)
    nearest = float(tangent[seen] @ beside[seen] / (tangent[seen] @ tangent[seen]))
    residuals = beside - nearest * tangent
    residuals[hidden] = np.nan
    return nearest, nearest + UnseenRotorCorrection(orbit).shift(arc, rate, residuals, 1.0, noise)


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])
@pytest.mark.parametrize('hidden', [[5], [4, 5], [3, 6]])
def test_rotors_in_balance_need_not_be_seen(
    example: tuple[float, float], hidden: list[int]
) -> None:
    orbit = orbit_of(example)
    arc = orbit.arc_at(4.7, 0)
    held, beside = stiffness(orbit, arc), np.random.default_rng(1).normal(0, 1e-3, ROTORS)
    others = np.delete(np.arange(ROTORS), hidden)
    pulled = held[hidden][:, others] @ beside[others]
    beside[hidden] = -np.linalg.solve(held[hidden][:, hidden], pulled)
    without, informed = seen_shift(orbit, arc, beside, hidden, 0.0, 1e-12)
    nearest = orbit.tangent(arc) @ beside
    assert informed == pytest.approx(nearest, abs=1e-8)
    assert abs(without - nearest) > 1e-6


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])
def test_rotors_that_springs_make_go_round_the_orbit_are_not_taken_for_another_place(
    example: tuple[float, float],
) -> None:
    orbit = orbit_of(example)
    arc = orbit.arc_at(4.4, 0)
    bend = (orbit.tangent(arc + ARC_STEP) - orbit.tangent(arc - ARC_STEP)) / (2 * ARC_STEP)
    turning = orbit.chain.moment_of_inertia * bend * RATE**2
    beside = -np.linalg.pinv(stiffness(orbit, arc), rcond=1e-9) @ turning
    without, informed = seen_shift(orbit, arc, beside, [5], RATE, 1e-12)
    assert abs(informed) < 0.02 * abs(without)


def test_what_noise_hides_is_not_believed_and_rotors_far_away_make_no_difference() -> None:
    orbit = orbit_of(SPINNER)
    arc = orbit.arc_at(4.7, 0)
    beside = np.random.default_rng(2).normal(0, 1e-3, ROTORS)
    without, informed = seen_shift(orbit, arc, beside, [5], 0.0, 1e-12)
    _, noisy = seen_shift(orbit, arc, beside, [5], 0.0, 100.0)
    assert abs(noisy - without) < 0.2 * abs(informed - without)
    far, same = seen_shift(orbit, orbit.arc_at(1.0, 0), beside, [9], 0.0, 1.0)
    assert same == far
