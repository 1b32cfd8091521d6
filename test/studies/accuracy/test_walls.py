# SPDX-License-Identifier: Apache-2.0
"""Kinks have zero energy, anti-kinks equal energies at each site, and positions are found."""

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, SPINNER, WOBBLER, chain_of

from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.continuum import wall_theory
from soliton_linkage_studies.accuracy.walls import left_of, nearest_arc, wall_path

ROTORS = 60


@pytest.mark.parametrize('example', CLASSES)
def test_a_kink_has_zero_energy_at_every_position(example):
    for leg in [0, 1]:
        chain = chain_of(example, ROTORS)
        path = wall_path(chain, 1, leg)
        assert path.charge == 1
        scale = chain.stiffness * chain.spacing**2
        for position in (29.0, 29.37, 30.5, 31.9):
            angles = left_of(chain, 1) + path.relative_angles(ROTORS, position)
            assert float(chain.elastic_energy(angles)) < 1e-9 * scale
            found = path.nearest(angles, position + 0.1, 6.0)
            assert found == pytest.approx(position, abs=1e-5)
            assert path.misfit(angles, found, 6.0) < 1e-4


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER])
def test_an_anti_kink_has_equal_energy_at_each_site_and_a_continuous_path(example):
    chain = chain_of(example, ROTORS)
    path = wall_path(chain, -1)
    assert not path.pinned
    costs = [
        float(chain.elastic_energy(left_of(chain, -1) + path.relative_angles(ROTORS, position)))
        for position in (29.2, 30.2, 31.2)
    ]
    assert costs[1:] == pytest.approx([costs[0]] * 2, rel=1e-5)
    if example is FLIPPER:
        assert costs[0] == pytest.approx(wall_theory(chain).energy(0.0, charge=-1), rel=0.3)
    slopes = [
        np.linalg.norm(path.derivative(ROTORS, position)) for position in np.arange(29, 31, 0.1)
    ]
    assert max(slopes) == pytest.approx(min(slopes), rel=0.02)


def test_an_anti_kink_of_spinners_is_pinned_at_its_equilibrium():
    chain = chain_of(SPINNER, ROTORS)
    path = wall_path(chain, -1)
    assert path.pinned
    position = path.nearest_allowed(30.2)
    angles = left_of(chain, -1) + path.relative_angles(ROTORS, position)
    limit = 2e-4 * chain.stiffness * chain.spacing**2
    assert np.abs(chain.spring_torques(angles)[2:-2]).max() < limit
    assert path.nearest(angles, 30.2, 6.0) == position
    assert path.nearest_allowed(position + 2) == pytest.approx(position + 2)


@pytest.mark.parametrize('example', CLASSES)
def test_the_nearest_configuration_of_an_orbit_is_found(example):
    orbit = UniformOrbit(chain_of(example, 20))
    for share in (0.1, 0.23, 0.5, 0.81):
        arc = share * orbit.length
        turned = orbit.configuration(arc) + 2 * np.pi
        assert nearest_arc(orbit, turned, arc + 0.1) == pytest.approx(arc, abs=1e-5)
