# SPDX-License-Identifier: Apache-2.0
"""The integrator of the cells conserves energy and agrees with the simulator."""

from dataclasses import replace

import numpy as np
import pytest
from chains import CLASSES, SPINNER, chain_of

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage_studies.accuracy.springs import Springs


def launched(chain: Chain, speed: float) -> tuple[np.ndarray, np.ndarray]:
    angles = chain.uniform_state(-1)
    return angles, speed / chain.time_unit * mode_towards_last(chain, angles)


@pytest.mark.parametrize('example', CLASSES)
def test_the_integrator_agrees_with_the_simulator(example):
    uniform = chain_of(example, 12)
    drawn = drawn_deviations(12, 3, spacing=0.02, rotor_length=0.02, stiffness=0.05, mass=0.05)
    for chain in (uniform, replace(uniform, deviations=drawn)):
        angles, rates = launched(chain, 0.2)
        period = 0.37 * chain.time_unit
        motion = Springs(chain, angles, rates, period).record(60)
        other = simulate(chain, angles, rates, 59 * period, period, 1e-11)
        assert np.abs(motion.angles - other.angles).max() < 1e-4
        assert motion.rates[-1] == pytest.approx(other.rates[-1], abs=1e-3 / chain.time_unit)


def test_energy_is_conserved_except_for_damping():
    chain = chain_of(SPINNER, 20)
    angles, rates = launched(chain, 0.5)
    springs = Springs(chain, angles, rates, 0.5 * chain.time_unit)
    before = energy(springs)
    for _ in range(300):
        springs.advance()
    assert energy(springs) == pytest.approx(before, rel=1e-5)
    springs.advance(np.full(20, 1 / springs.period))
    assert energy(springs) < 0.6 * before


def energy(springs: Springs) -> float:
    chain = springs.chain
    return float(chain.elastic_energy(springs.angles) + chain.kinetic_energy(springs.rates))
