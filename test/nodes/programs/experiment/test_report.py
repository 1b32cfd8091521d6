# SPDX-License-Identifier: Apache-2.0
"""The report of a bag matches its content, for the recordings of the suite."""

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Motion
from soliton_linkage.solitons.track import find_crossings, follow
from soliton_linkage_nodes.programs.experiment.report import (
    RecordedRun,
    draw,
    largest_difference,
    read_run,
    summarise,
)

BAGS = Path(__file__).resolve().parents[4] / 'bags'
MOTIONS = {
    'flipper': Motion.FLIPPER,
    'wobbler': Motion.WOBBLING_FLIPPER,
    'spinner': Motion.SPINNER,
}
NUDGES = {'flipper': 10.0, 'wobbler': 4.0, 'spinner': 12.5}


@cache
def run_of(name: str) -> RecordedRun:
    return read_run(BAGS / f'{name}_0')


@pytest.mark.parametrize('name', MOTIONS)
def test_the_recorded_motion_is_the_simulated_one(name):
    run = run_of(name)
    chain = run.named.chain
    assert chain.motion is MOTIONS[name]
    rest = chain.uniform_state(-1)
    rates = NUDGES[name] * edge_mode(chain, rest, Edge.FIRST)
    again = simulate(chain, rest, rates, run.recording.times[-1] + 0.5, 0.02)
    moving = np.flatnonzero(np.abs(run.recording.rates).max(axis=1) > 0.1)[0]
    # The frame of the kick may show the state before it.
    moving -= int(np.abs(run.recording.angles[moving] - rest).max() > 1e-6)
    length = len(run.recording.times) - moving
    # At rest before the nudge the solver moves the rotors by rounding, which then grows.
    np.testing.assert_allclose(
        run.recording.angles[moving:], again.angles[:length], rtol=0, atol=1e-7
    )


@pytest.mark.parametrize('name', MOTIONS)
def test_the_track_is_that_of_the_simulated_wall(name):
    run = run_of(name)
    fitted = follow(run.named.chain, run.recording)
    both = np.isfinite(run.track.sites) & np.isfinite(fitted.sites)
    assert both.mean() > 0.5
    apart = np.abs(run.track.sites - fitted.sites)[both]
    assert np.median(apart) < 0.1
    assert run.crossings == find_crossings(run.named.chain, run.track)
    assert len(run.crossings) >= 2


def test_the_summary_is_valid_json_and_true_to_the_bag():
    run = run_of('flipper')
    summary = json.loads(json.dumps(summarise(run), allow_nan=False))
    assert summary['motion'] == 'flipper'
    assert summary['rotors'] == 20
    assert summary['lost_messages'] == 0
    assert summary['publish_rate_hz'] == pytest.approx(50, rel=1e-3)
    speeds = [crossing.site_rate for crossing in run.crossings]
    assert summary['speed_rotors_per_s'] == pytest.approx(np.mean(speeds))


def test_the_pictures_are_drawn(tmp_path):
    draw(run_of('spinner'), tmp_path)
    for picture in ('kymograph.png', 'track.png'):
        assert np.std(imread(tmp_path / picture)[..., :3]) > 0.05


def test_the_largest_difference_is_over_the_frames_of_both():
    assert largest_difference({}, {}) == 0
    assert largest_difference({1: (2.0,), 2: ()}, {1: (2.5,), 2: (), 3: (9.0,)}) == 0.5
    assert largest_difference({1: (2.0, 5.0)}, {1: (2.0, 4.0)}) == 1.0
    assert largest_difference({1: (2.0,)}, {1: ()}) == math.inf
    assert largest_difference({1: (2.0,)}, {2: (3.0,)}) == 0
