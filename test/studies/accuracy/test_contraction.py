# SPDX-License-Identifier: Apache-2.0
"""Measured speeds and widths of walls agree with the truth within the stated deviations."""

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, chain_of

from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage_studies.accuracy.contraction import measured_passage, rest_width

SPEED = 6.0
NOISE = 0.02


def steady(chain: Chain) -> tuple[Array, Array]:
    """Return times and angles of a rigid-bar chain whose wall moves at `SPEED`."""
    orbit = UniformOrbit(chain)
    times = np.linspace(0, (chain.number_of_rotors - 1) / SPEED, 400)
    begin = orbit.arc_at(0.0, 0)
    arcs = begin + SPEED * orbit.site_arc * times
    return times, np.array([orbit.configuration(arc) for arc in arcs])


def speed_over_sound(chain: Chain) -> float:
    return SPEED * chain.spacing / speed_of_sound(chain)


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_a_wall_at_constant_velocity_has_its_speed_and_width(example):
    # At a constant arc rate the site rate is constant to 1e-6 only far from the edges.
    chain = chain_of(example, 32)
    times, angles = steady(chain)
    exact = measured_passage(chain, times, angles)
    assert exact.speed == pytest.approx(speed_over_sound(chain), rel=1e-6)
    assert exact.width == pytest.approx(1.0, rel=1e-5)
    noise = NOISE * np.random.default_rng(1).standard_normal(angles.shape)
    noisy = measured_passage(chain, times, angles + noise)
    assert 0 < abs(noisy.speed - exact.speed) < 4 * noisy.speed_deviation
    assert noisy.speed_deviation < 0.01 * noisy.speed
    assert 0 < abs(noisy.width - exact.width) < 4 * noisy.width_deviation
    assert noisy.width_deviation < 0.02


def test_a_wall_that_never_reaches_the_middle_is_rejected():
    chain = chain_of(FLIPPER, 24)
    times, angles = steady(chain)
    with pytest.raises(ValueError, match='in the middle of the chain in 0 frames, but 10'):
        measured_passage(chain, times[:50], angles[:50])


def test_a_wide_static_wall_has_the_continuum_width():
    """The width in the discrete chain is smaller by a fraction of order d^2."""
    off = []
    for rest_angle in (0.2, 0.4):
        chain = chain_of((0.5, rest_angle), 80)
        off.append(1 - rest_width(chain))
    assert 0 < off[0] < 0.01
    assert off[1] / off[0] == pytest.approx(4, rel=0.25)
