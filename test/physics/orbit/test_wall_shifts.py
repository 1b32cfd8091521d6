# SPDX-License-Identifier: Apache-2.0
"""Errors of walls by deviations, compared with chains that have one deviation each."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from soliton_linkage.linear.bands import tail_ratio
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.orbit import UniformOrbit
from soliton_linkage.orbit.wall_shifts import WallShifts

ROTORS, SMALL = 9, 1e-4
FLIPPER, WOBBLER, SPINNER = (0.9, 0.7), (0.8, 1.6), (1.1, 3.4)
"""Rest angles [rad] and lean ratios d."""


def chain_of(rest_angle: float, lean_ratio: float) -> Chain:
    length = lean_ratio * Chain.spacing / (2 * math.sin(rest_angle))
    return Chain(ROTORS, rotor_length=length, rest_angle=rest_angle)


def deviating(chain: Chain) -> list[Chain]:
    """Chains with one spacing, one rotor length or one mass larger by a small fraction."""
    single = SMALL * np.eye(3 * ROTORS - 1)
    parts = (np.split(row, [ROTORS - 1, 2 * ROTORS - 1]) for row in single)
    return [
        replace(chain, deviations=Deviations(*(tuple(part.tolist()) for part in each)))
        for each in parts
    ]


def left_part(chain: Chain, near: Array, bond: int) -> float:
    """Part of |t|^2 on the left of a bond, in the closed configuration next to given angles."""
    return float(np.sum(zero_mode(chain, unstretched(chain, near))[: bond + 1] ** 2))


def arc_at(chain: Chain, orbit: UniformOrbit, bond: int, leg: int) -> float:
    """Arc at which a chain next to the orbit has the same part of its mode on the left."""
    arc = orbit.arc_at(bond + 0.5, leg)
    part = float(np.sum(orbit.tangent(arc)[: bond + 1] ** 2))

    def beyond(at: float) -> float:
        return left_part(chain, orbit.configuration(at), bond) - part

    return float(brentq(beyond, arc - 0.01, arc + 0.01, xtol=1e-9))


def passage(chain: Chain, orbit: UniformOrbit, bond: int, leg: int) -> float:
    """Time from one bond to the next in free motion, in arbitrary units."""
    ends = [arc_at(chain, orbit, each, leg) for each in (bond, bond + 1)]
    path = [unstretched(chain, orbit.configuration(arc)) for arc in np.linspace(*ends, 20)]
    steps = np.diff(np.unwrap(path, axis=0), axis=0)
    return float(np.sqrt(steps**2 @ chain.moments_of_inertia).sum())


@pytest.mark.parametrize(
    ('example', 'bond', 'leg'), [(FLIPPER, 1, 3), (WOBBLER, 4, 1), (SPINNER, 3, 0)]
)
def test_errors_of_arc_and_rate_agree_with_chains_with_single_deviations(example, bond, leg):
    chain = chain_of(*example)
    orbit = UniformOrbit(chain)
    far = orbit.configuration(orbit.arc_at(orbit.middle, 0))
    others = deviating(chain)
    turns = np.array([unstretched(each, far) - far for each in others])
    added = turns[:, 1] - tail_ratio(chain) * turns[:, 2]
    arcs = [arc_at(each, orbit, bond, leg) - orbit.arc_at(bond + 0.5, leg) for each in others]
    even = passage(chain, orbit, bond, leg)
    times = [passage(each, orbit, bond, leg) / even - 1 for each in others]
    shifts = WallShifts(orbit).at(bond + 0.5, leg)
    scale = np.linalg.norm(added)
    assert shifts.arc == pytest.approx(np.linalg.norm(arcs) / scale, rel=1e-3)
    assert shifts.rate == pytest.approx(np.linalg.norm(times) / scale, rel=0.02)
