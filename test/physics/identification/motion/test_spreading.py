# SPDX-License-Identifier: Apache-2.0
"""Deviations are those to first order, or as wide as samples; priors are drawn as wide as told."""

from __future__ import annotations

import numpy as np
import pytest
from passages import WOBBLER, unequal

from soliton_linkage.identification.geometry.lengths import lengths_of
from soliton_linkage.identification.geometry.tolerances import Tolerances
from soliton_linkage.identification.motion.free_motion import FreeMotion, parts_of
from soliton_linkage.identification.motion.motion_prior import MotionPrior
from soliton_linkage.identification.motion.spreading import widened

AT = parts_of(10)
SIZE = AT.forces.stop


def test_what_samples_spread_further_is_stated_larger_by_that() -> None:
    random = np.random.default_rng(1)
    mixed = random.standard_normal((SIZE, SIZE)) / 10 + np.eye(SIZE)
    covariance = mixed @ mixed.T
    samples = random.standard_normal((400, SIZE)) @ mixed.T
    samples[:, AT.stiffnesses] *= 2
    samples[:, AT.masses] /= 2
    over = np.sqrt(np.diag(widened(covariance, samples, AT)) / np.diag(covariance))
    assert over[AT.lengths] == pytest.approx(1.0, abs=0.05)
    assert over[AT.stiffnesses] == pytest.approx(2.0, rel=0.05)
    assert over[AT.masses].tolist() == [1.0] * 10
    assert over[AT.forces].tolist() == [1.0] * 3


def test_means_that_are_drawn_have_the_information_of_the_prior() -> None:
    chain, alike = unequal(WOBBLER, 1), np.ones(10)
    lengths = lengths_of(chain).scaled(1.0)
    motion = FreeMotion(lengths, 2500 * alike[1:], alike, 0.0, 0 * alike, 0 * alike)
    prior, random = MotionPrior(0.0, Tolerances(0.05, 0.05)), np.random.default_rng(2)
    information, _ = prior.about(motion)
    shifts = np.array([prior.drawn(motion, random).shift for _ in range(300)])
    np.testing.assert_allclose(prior.drawn(motion, random).about(motion)[0], information)
    squares = np.einsum('si,ij,sj->s', shifts, information, shifts)
    known = np.linalg.matrix_rank(information, tol=1e-6)
    assert known == SIZE - 4
    assert squares.mean() == pytest.approx(known, rel=5 * np.sqrt(2 / known / 300))
    assert np.abs(shifts[:, AT.stiffnesses].mean(axis=1)).max() < 1e-6
