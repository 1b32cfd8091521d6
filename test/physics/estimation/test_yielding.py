# SPDX-License-Identifier: Apache-2.0
"""Springs yield as equations of all rotors say, and slow walls go as energy has them go."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.estimation.orbit_model import ComplianceCorrection, rate_after_impulse
from soliton_linkage.linear.rigidity import dynamical_matrix
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit

FLIPPER, WOBBLER, SPINNER = (
    Chain(17, rotor_length=length, rest_angle=rest)
    for length, rest in ((0.05, 0.97), (0.1, 0.77), (0.13, 1.3))
)


def bent(orbit: Orbit, arc: float) -> tuple[Array, Array]:
    """Phi'' and D^(-1) Phi'' of the dynamical matrix D."""
    step = 1e-3
    bend = (orbit.tangent(arc + step) - orbit.tangent(arc - step)) / (2 * step)
    matrix = dynamical_matrix(orbit.chain, orbit.configuration(arc)).toarray()
    return bend, np.linalg.lstsq(matrix, bend, rcond=1e-9)[0]


@pytest.mark.parametrize('chain', [FLIPPER, WOBBLER, SPINNER])
@pytest.mark.parametrize('leg', [0, 1])
def test_mu_is_what_bent_paths_cost(chain: Chain, leg: int) -> None:
    orbit = orbit_of(chain)
    yielding = ComplianceCorrection(orbit)
    for site in (8.0, 8.3, 7.55):
        arc = orbit.arc_at(site, leg)
        bend, given = bent(orbit, arc)
        assert yielding.mu(arc) == pytest.approx(bend @ given, rel=0.02)


def test_a_chain_that_deviates_yields_at_the_same_places() -> None:
    even = orbit_of(WOBBLER)
    drawn = drawn_deviations(17, 3, spacing=0.03)
    uneven = orbit_of(replace(WOBBLER, deviations=drawn))
    one, other = ComplianceCorrection(even), ComplianceCorrection(uneven)
    for site in (4.0, 9.3):
        found, expected = other.mu(uneven.arc_at(site, 1)), one.mu(even.arc_at(site, 1))
        assert found == pytest.approx(expected, rel=0.1)


def nearest_arc(orbit: Orbit, angles: Array, arc: float) -> float:
    """Arc nearest to angles on the orbit, from one that is near it."""
    for _ in range(8):
        arc += orbit.tangent(arc) @ (angles - orbit.configuration(arc))
    return arc


def test_a_slow_wall_keeps_its_energy_from_rotor_to_rotor() -> None:
    orbit = orbit_of(WOBBLER)
    yielding, slow, begin = ComplianceCorrection(orbit), 1.2, orbit.arc_at(5.0, 0)
    angles = orbit.configuration(begin) - slow**2 * bent(orbit, begin)[1]
    period = 0.25 * WOBBLER.time_unit
    run = simulate(WOBBLER, angles, slow * orbit.tangent(begin), 800 * period, period)
    arcs = [begin]
    for frame in run.angles[1:]:
        arcs.append(nearest_arc(orbit, frame, arcs[-1]))
    went = np.gradient(arcs, period)[20:-20]
    said = [yielding.rate_ratio(arc, slow, begin) for arc in arcs[20:-20]]
    assert np.std(went / said) < 0.3 * np.std(went)


@pytest.mark.parametrize(('share', 'rate'), [(0.5, 100.0), (0.98, 1.0)])
def test_a_fast_wall_and_one_that_yields_much_are_not_told_to_vary(
    share: float, rate: float
) -> None:
    """Near d_c the lowest order does not hold, however slow the wall is."""
    length = share / math.sin(0.77) ** 2 * WOBBLER.spacing
    orbit = orbit_of(Chain(17, rotor_length=length, rest_angle=0.77))
    one, other = orbit.arc_at(5.0, 0), orbit.arc_at(5.5, 0)
    assert ComplianceCorrection(orbit).rate_ratio(other, rate, one) == 1.0
    assert ComplianceCorrection(orbit).rate_ratio(other, 1e-3 * rate, one) != 1.0


@pytest.mark.parametrize('rate', [-3.0, 0.0, 0.5])
@pytest.mark.parametrize('added', [-2.0, 0.0, 7.0])
def test_momentum_adds_up(rate: float, added: float) -> None:
    mu = 0.03
    pushed = rate_after_impulse(rate, added, mu)
    before, after = (each + 2 * mu * each**3 for each in (rate, pushed))
    assert after == pytest.approx(before + added)
