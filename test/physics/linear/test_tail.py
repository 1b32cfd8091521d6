# SPDX-License-Identifier: Apache-2.0
"""Tails beside a wall: of two kinds, exact beside exact walls."""

import math

import numpy as np
import pytest
from chains import EPS, FLIPPER, STRONG_WOBBLER, WOBBLER, any_chain, chain_of
from hypothesis import assume, given
from linkage_motion import wall_between

from soliton_linkage.linear.bands import continuum_tail, exact_tail, wobble_exponents
from soliton_linkage.linkage.chain import staggered


@given(any_chain())
def test_the_wobble_solves_its_equation(chain):
    ub, a = chain.rotor_length * math.sin(chain.rest_angle), chain.spacing
    assume(abs(chain.lean_ratio * math.sqrt(2) - 1) > 1e-6)
    plus, minus = wobble_exponents(chain)
    assert plus + minus == pytest.approx(2 / ub, rel=8 * EPS)
    assert plus * minus == pytest.approx(8 / a**2, rel=32 * EPS)
    for exponent in (plus, minus):
        terms = (a * exponent) ** 2 / 8, -(a**2) * exponent / (4 * ub), 1
        assert abs(sum(terms)) <= 1e3 * EPS * sum(map(abs, terms))
        assert exponent.real > 0
    oscillates = chain.lean_ratio > 1 / math.sqrt(2)
    assert (plus.imag != 0) == oscillates
    tail = continuum_tail(chain)
    assert (tail.wave_number > 0) == oscillates
    if oscillates:
        assert tail.decay_length == pytest.approx(ub, rel=8 * EPS)
        assert tail.wave_number < math.sqrt(8) / a
    else:
        assert tail.decay_length >= ub


def test_the_tails_agree_far_from_d_1():
    narrow, wide = chain_of((0.5, 0.02), 2), chain_of((20.0, 1.5), 2)
    for chain, rel in ((narrow, 1e-3), (wide, 1e-3)):
        exact, continuum = exact_tail(chain), continuum_tail(chain)
        assert exact.decay_length == pytest.approx(continuum.decay_length, rel=rel)
    assert continuum_tail(wide).wave_number * wide.spacing == pytest.approx(2.828, abs=1e-3)
    assert exact_tail(wide).wave_number * wide.spacing == pytest.approx(math.pi)


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, (1.2, 0.77), STRONG_WOBBLER, (1.8, 0.77)])
def test_the_exact_tail_is_that_of_the_exact_wall(example):
    chain = chain_of(example, 80)
    tail = exact_tail(chain)
    displacements = np.sin(staggered(wall_between(chain, 39))) - math.sin(chain.rest_angle)
    # From the wall outwards, deviations small beside 1 and large beside rounding.
    far = np.flatnonzero(np.abs(displacements[:39]) < 1e-5)
    far = far[np.abs(displacements[far]) > 1e-10]
    ratios = displacements[far[1:]] / displacements[far[1:] - 1]
    growth = math.exp(chain.spacing / tail.decay_length)
    growth *= math.cos(tail.wave_number * chain.spacing)
    assert len(ratios) >= 2
    assert ratios == pytest.approx(growth, rel=1e-3)
