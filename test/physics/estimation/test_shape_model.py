# SPDX-License-Identifier: Apache-2.0
"""Kinks of all classes that are two of several walls are placed as well as one that is alone."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.solitons.anti_kink import anti_kink_path, resting_anti_kink
from soliton_linkage.solitons.static_wall import site_arc, static_wall

NOISE = 0.01
FRAMES = 80
CHAINS = {
    'flipper': Chain(61, rest_angle=0.97),
    'wide flipper': Chain(121, rest_angle=0.3),
    'wobbler': Chain(61, rotor_length=0.1, rest_angle=0.77),
    'spinner': Chain(81, rotor_length=0.2, rest_angle=1.18),
}


def kink_and_anti_kink(chain: Chain, site: float) -> tuple[Array, tuple[float, float]]:
    """A kink at a place and an anti-kink, in staggered angles of a chain twice as long, and where.

    The anti-kink is as far from its end, that of spinners where it rests. That of wobbling
    flippers is the image of the kink, n -> 2 N - 2 - n.
    """
    inner = staggered(static_wall(chain, site))[1:-1]
    far = chain.number_of_rotors - 1 - site
    if chain.motion is Motion.SPINNER:
        far, state = resting_anti_kink(chain, 2 * (far // 2) + 0.5)
        other = staggered(state)[1:-1]
    elif chain.lean_ratio < 1:
        other = staggered(CubicSpline(*anti_kink_path(chain, math.floor(far)))(far))[1:-1]
    else:
        other = inner[::-1]
    return np.concatenate([inner, inner[-1:], other]), (site - 1, len(inner) + far)


@pytest.mark.parametrize('name', CHAINS)
def test_a_kink_and_an_anti_kink_are_within_what_is_stated(name: str) -> None:
    chain = CHAINS[name]
    rng, errors = np.random.default_rng(1), []
    rotors = 2 * (chain.number_of_rotors - 2) + 1
    fresh = Analyser(replace(chain, number_of_rotors=rotors), NOISE)
    for site in chain.number_of_rotors // 2 + np.array([-3.0, -2.7, -2.45, -1.8]):
        theta, true = kink_and_anti_kink(chain, float(site))
        analyser = deepcopy(fresh)
        angles = staggered(theta)
        for frame in range(FRAMES):
            noise = NOISE * rng.standard_normal(len(theta))
            found = analyser.analyse(frame * 4_000_000, angles + noise)
            assert found is not None
        walls = found.solitons
        assert [each.charge for each in walls] == [1, -1]
        assert found.topology is not None
        assert found.topology.charge == 0
        errors += [
            (w.rotor - x) * chain.spacing / w.position_deviation
            for w, x in zip(walls, true, strict=True)
        ]
        bound = NOISE / site_arc(chain) / math.sqrt(FRAMES) * chain.spacing
        assert all(each.position_deviation < 3 * bound for each in walls)
    assert 0.4 < math.sqrt(np.mean(np.square(errors))) < 1.6
    assert max(map(abs, errors)) < 4
