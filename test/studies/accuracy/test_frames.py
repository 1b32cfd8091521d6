# SPDX-License-Identifier: Apache-2.0
"""Frames are made in chunks, each from a seed of its own."""

from __future__ import annotations

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, chain_of

from soliton_linkage_studies.accuracy.estimators import (
    ORBIT_COLD,
    ORBIT_NEAR,
    EstimatorTrial,
    bound,
    estimators_of,
)
from soliton_linkage_studies.accuracy.frames import FrameStudy

CHAINS = (chain_of(FLIPPER, 10), chain_of(SPINNER, 16))


def study(frames: int, seed: int = 7) -> FrameStudy:
    trial = EstimatorTrial(frames=frames, noise=np.nan, coarse_start=0.2, cold_every=100)
    return FrameStudy(CHAINS, (0.01, 0.02), trial, seed)


def test_a_chunk_depends_on_the_seed_and_its_number_alone() -> None:
    few, many = study(300), study(600)
    again = few.sample(0, 1, 0)
    for name, pairs in many.sample(0, 1, 0).items():
        np.testing.assert_array_equal(pairs, again[name])
    others = [few.sample(0, 1, 1), few.sample(0, 0, 0), study(300, seed=8).sample(0, 1, 0)]
    for other in others:
        assert other[ORBIT_NEAR][0, 0] != again[ORBIT_NEAR][0, 0]


@pytest.mark.parametrize('frames', [20, 250, 260])
def test_every_frame_is_in_one_chunk(frames: int) -> None:
    tasks = study(frames).tasks()
    chunks = (len(tasks) - len(CHAINS)) // 4
    sizes = [len(study(frames).sample(0, 0, chunk)[ORBIT_NEAR]) for chunk in range(chunks)]
    assert sum(sizes) == frames
    assert min(sizes) > 0


def test_lines_are_those_of_their_chain_and_noise() -> None:
    """Samples that say which chain, noise and chunk they are of come out where they belong."""
    mine = study(500)
    samples = []
    for chain in CHAINS:
        for noise in mine.noises:
            for chunk in range(2):
                value = 100 * CHAINS.index(chain) + noise + 2 * chunk
                samples.append({name: np.full((3, 2), value) for name in estimators_of(chain)})
    lines = mine.lines(samples)
    for line in lines:
        assert line.accuracy.bias == pytest.approx(100 * CHAINS.index(line.chain) + line.noise + 1)
        assert line.accuracy.frames == 6
        assert line.accuracy.bound == bound(line.chain, line.noise)
    assert len(lines) == 2 * (4 + 5)
    assert lines[3].estimator == ORBIT_COLD
