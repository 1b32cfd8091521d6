# SPDX-License-Identifier: Apache-2.0
"""What is stated of walls where rotors and springs differ, which nobody told."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER, chain_of
from scipy import stats
from scipy.optimize import brentq

from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

ROTORS, NOISE, BOND = 20, 0.005, 9
DRAWS, FRAMES = 25, 18


def resting(orbit: UniformOrbit, seed: int, share: float) -> Array:
    """Angles of a chain that deviates by a share, with half of its mode left of the bond."""
    drawn = drawn_deviations(ROTORS, seed, spacing=share, rotor_length=share)
    chain = replace(orbit.chain, deviations=drawn)

    def angles(arc: float) -> Array:
        return unstretched(chain, orbit.configuration(arc))

    def beyond_half(arc: float) -> float:
        return float(np.sum(zero_mode(chain, angles(arc))[: BOND + 1] ** 2)) - 0.5

    low, high = (orbit.arc_at(site, 0) for site in (BOND - 0.5, BOND + 1.5))
    return angles(float(brentq(beyond_half, low, high, xtol=1e-4)))


@pytest.mark.parametrize(('example', 'share'), [(FLIPPER, 0.03), (WOBBLER, 0.03), (SPINNER, 0.03)])
def test_what_is_stated_of_the_place_is_true_from_the_first_frame_on(
    example: tuple[float, float], share: float
) -> None:
    orbit = UniformOrbit(chain_of(example, ROTORS))
    scores, fresh = np.empty((DRAWS, FRAMES)), OrbitFilter(orbit)
    for seed in range(DRAWS):
        random, angles = np.random.default_rng(seed), resting(orbit, seed, share)
        tracker = deepcopy(fresh)
        for frame in range(FRAMES):
            noisy = angles + NOISE * random.standard_normal(ROTORS)
            said = tracker.update(0.004 * frame, noisy)
            scores[seed, frame] = (said.site - BOND - 0.5) / said.site_deviation
    squares = np.sum(scores**2, axis=0)
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], DRAWS)
    assert squares.max() < high
    assert low < squares[-1]


def test_a_rotor_that_stays_off_in_an_even_chain_is_a_wrong_reading() -> None:
    orbit, off = UniformOrbit(chain_of(WOBBLER, ROTORS)), 1.2
    angles, random = resting(orbit, 0, 0.0), np.random.default_rng(0)
    angles[BOND + 2] += off
    tracker = OrbitFilter(orbit)
    for frame in range(40):
        said = tracker.update(0.004 * frame, angles + NOISE * random.standard_normal(ROTORS))
    stated = said.site_deviation * orbit.site_arc
    assert stated < 0.1 * off
