# SPDX-License-Identifier: Apache-2.0
"""The fit of a chain of springs reaches the motion of the readings, not a local minimum."""

from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, read, unequal

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.identification.free_motion import FreeMotion
from soliton_linkage.identification.lengths import chain_lengths
from soliton_linkage.identification.motion_fit import MotionFitter
from soliton_linkage.identification.windows import FreeWindow
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import drawn_deviations

PERIOD = 0.0045
NOISE = 0.01
FRAMES, WINDOW = 1600, 400


def test_merged_windows_of_a_wobbling_flipper_fit_as_well_as_the_true_motion():
    drawn = drawn_deviations(
        12, 0, spacing=0.02, rotor_length=0.02, rest_length=0.02, mass=0.05, stiffness=0.05
    )
    chain = replace(Chain(12, 0.1, 0.1, 0.77), deviations=drawn)
    start = leaning(chain, -1).angles
    kick = 4.0 * edge_mode(chain, start, Edge.FIRST)
    motion = simulate(chain, start, kick, PERIOD * (FRAMES - 1), PERIOD)
    random = np.random.default_rng(0)
    readings = motion.angles + NOISE * random.standard_normal(motion.angles.shape)
    # Errors of 2 % make the motion of a window diverge from the readings of the next windows.
    lengths = chain_lengths(chain).scaled(1.0)
    mean = chain.masses.mean()
    rotor_lengths, rest_lengths, stiffnesses, masses = (
        each * np.exp(0.02 * random.standard_normal(each.shape))
        for each in (
            lengths.rotor_lengths,
            lengths.rest_lengths,
            chain.stiffnesses / mean,
            chain.masses / mean,
        )
    )
    lengths = replace(lengths, rotor_lengths=rotor_lengths, rest_lengths=rest_lengths)
    windows = [
        FreeWindow(
            slice(begin, begin + WINDOW),
            FreeMotion(
                lengths, stiffnesses, masses, 0.0, motion.angles[begin], motion.rates[begin]
            ),
        )
        for begin in range(0, FRAMES, WINDOW)
    ]
    weights = np.ones_like(readings)
    fitter = MotionFitter(
        windows, PERIOD * np.arange(FRAMES), readings, weights, NOISE, tolerance=None
    )
    found = fitter.fit(bar_noise=0.1)
    assert found is not None
    assert len(found.windows) == 1
    assert np.sum(found.residuals**2) < np.sum((readings - motion.angles) ** 2)


@pytest.mark.parametrize('kick', [0.0, 0.4])
def test_a_kick_where_one_window_ends_and_the_next_begins_increases_the_likelihood(kick):
    chain = unequal(FLIPPER, 3)
    start = leaning(chain, -1).angles
    mode = edge_mode(chain, start, Edge.FIRST)
    first = simulate(chain, start, 10.0 * mode, 0.6, 0.01)
    rates = (1 + kick) * first.rates[-1]
    second = simulate(chain, first.angles[-1], rates, 0.6, 0.01)
    angles = np.concatenate([first.angles, second.angles[1:]])
    readings = read(angles, 1, NOISE, 0.0)[0]
    lengths = chain_lengths(chain).scaled(1.0)
    mean = chain.masses.mean()
    forces = chain.stiffnesses / mean, chain.masses / mean, 0.0
    windows = [
        FreeWindow(slice(0, 60), FreeMotion(lengths, *forces, start, 10.0 * mode)),
        FreeWindow(slice(60, 121), FreeMotion(lengths, *forces, first.angles[-1], rates)),
    ]
    times = 0.01 * np.arange(len(angles))
    fitter = MotionFitter(windows, times, readings, np.ones_like(readings), NOISE, tolerance=None)
    ((_, gain),) = fitter.decreases_at_boundaries()
    assert gain > 150 if kick else gain < 50
