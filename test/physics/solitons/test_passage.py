# SPDX-License-Identifier: Apache-2.0
"""Walls pass if every bond is of one class, and return only at a bond of another class."""

import dataclasses
import math
import re
from functools import lru_cache

import numpy as np
import pytest
from chains import CLASSES, EPS, EXAMPLES, FLIPPER, SPINNER, WOBBLER, any_chain, chain_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Deviations, drawn_deviations
from soliton_linkage.solitons.passage import (
    blocked_bonds,
    find_obstacles,
    length_excesses,
    motion_of_bonds,
)
from soliton_linkage_studies.measures import check_passable, follow_wall

ROTORS = 7


def deviating(chain: Chain, seed: int, fraction: float) -> Chain:
    drawn = drawn_deviations(
        chain.number_of_rotors, seed, rotor_length=fraction, spacing=fraction, stiffness=fraction
    )
    return dataclasses.replace(chain, deviations=drawn)


def with_odd_bond(chain: Chain, bond: int, rest_length: float) -> Chain:
    """Return a chain, one of whose springs deviates by a fraction of its length at rest."""
    fractions = [0.0] * chain.number_of_springs
    fractions[bond] = rest_length
    return dataclasses.replace(chain, deviations=Deviations(rest_length=tuple(fractions)))


@lru_cache(maxsize=64)
def passes(chain: Chain) -> bool:
    """Whether the wall crosses the chain of bars and returns."""
    try:
        return all(leg.crossed for leg in follow_wall(chain))
    except (ArithmeticError, ValueError):
        return False


def travels(spacing: float, first: float, second: float, bar: float) -> tuple[bool, bool]:
    """Whether each of two rotors can turn by a full turn, found by trying every angle.

    The distance from the pivot of the other rotor to the mass must lie between |bar - length| and
    bar + length.
    """
    angles = np.linspace(0, 2 * np.pi, 20001)
    turning = []
    for length, other in ((first, second), (second, first)):
        distances = np.hypot(spacing - length * np.sin(angles), length * np.cos(angles))
        reached = (distances <= bar + other) & (distances >= abs(bar - other))
        turning.append(bool(reached.all()))
    return turning[0], turning[1]


@given(
    st.floats(0.05, 20), st.floats(0.05, 20), st.floats(0.05, 20), st.sampled_from([False, True])
)
def test_a_bond_without_obstacle_is_a_double_crank_or_a_triple_rocker(
    first, second, bar, spinning
):
    margins = (
        bar - 1 - abs(first - second),
        first + second - 1 - bar,
        1 + bar - abs(first - second),
        first + second + 1 - bar,
    )
    assume(min(map(abs, margins)) > 1e-3)
    assume(margins[3] > 0)
    chain = Chain(2, spacing=1.0, rotor_length=first, rest_angle=0.5)
    chain = dataclasses.replace(
        chain,
        deviations=Deviations(
            rotor_length=(0.0, second / first - 1), rest_length=(bar / chain.rest_length - 1,)
        ),
    )
    clear = not blocked_bonds(chain).any()
    assert clear == (bar > 1 + abs(first - second))
    if clear and spinning:
        both = travels(1.0, first, second, bar)
        assert both == ((True, True) if margins[1] > 0 else (False, False))


@given(any_chain())
def test_bonds_without_deviations_have_the_class_of_their_chain(chain):
    rounding = 16 * EPS * (chain.spacing + chain.rotor_length)
    assume(chain.rest_length - chain.spacing > rounding)
    reach = float(length_excesses(chain)[0])
    assume(min(abs(reach), abs(reach - chain.spacing)) > rounding)
    assert find_obstacles(chain) == ()
    assert motion_of_bonds(chain) is chain.motion


@pytest.mark.parametrize(
    ('example', 'edge'),
    [
        *((example, Edge.FIRST) for example in EXAMPLES),
        *((example, Edge.LAST) for example in CLASSES),
    ],
)
def test_without_deviations_the_wall_crosses_and_returns_from_either_edge(example, edge):
    chain = chain_of(example, 6)
    legs = follow_wall(chain, edge, legs=4)
    sense = 1 if edge is Edge.FIRST else -1
    assert [leg.direction for leg in legs] == [sense, -sense, sense, -sense]
    assert all(leg.crossed for leg in legs)
    for leg in legs:
        assert (leg.furthest if leg.direction > 0 else 5 - leg.furthest) > 2.5
    # After two legs a spinner has returned, and a flipper is its mirror image. The end of a leg
    # is known to one frame, in which rotors turn by less than 2 theta_bar.
    assert legs[3].arc == pytest.approx(legs[1].arc, rel=0, abs=chain.rest_angle)


@pytest.mark.parametrize(('example', 'seeds'), [(FLIPPER, 8), (WOBBLER, 4), (SPINNER, 4)])
def test_a_chain_with_deviations_of_ten_percent_stops_a_wall_only_at_an_obstacle(example, seeds):
    outcomes = set()
    for seed in range(seeds):
        chain = deviating(chain_of(example, ROTORS), seed, 0.1)
        outcomes.add(passes(chain))
        assert passes(chain) or blocked_bonds(chain).any()
    assert example != FLIPPER or outcomes == {False, True}


@settings(max_examples=8)
@given(
    st.floats(math.log(0.1), math.log(10)),
    st.floats(0.2, 1.3),
    st.floats(0.0, 0.1),
    st.integers(0, 2**32),
    st.integers(3, 6),
)
def test_the_wall_passes_any_chain_without_obstacles(
    logarithm, rest_angle, fraction, seed, rotors
):
    chain = deviating(chain_of((math.exp(logarithm), rest_angle), rotors), seed, fraction)
    excess = length_excesses(chain) - chain.spacings
    # At the limit the bars are in line, and the motion takes longer and longer.
    assume(float(np.abs(excess).min()) > 0.02 * chain.spacing)
    assume(not blocked_bonds(chain).any())
    assert passes(chain)


@pytest.mark.parametrize(
    ('example', 'fraction', 'relation'), [(FLIPPER, -0.2, 'longer'), (SPINNER, 1.0, 'shorter')]
)
def test_an_obstacle_has_the_number_and_the_lengths_of_its_bond(example, fraction, relation):
    chain = with_odd_bond(chain_of(example, ROTORS), 4, fraction)
    (obstacle,) = find_obstacles(chain)
    assert obstacle.bond == 4
    assert obstacle.spacing == chain.spacing
    assert obstacle.rotor_lengths == (chain.rotor_length, chain.rotor_length)
    assert obstacle.rest_length == pytest.approx((1 + fraction) * chain.rest_length, rel=EPS)
    assert relation in obstacle.reason or 'must be longer than' in obstacle.reason
    assert motion_of_bonds(chain) is None


def test_a_chain_whose_wall_reverses_is_rejected_with_the_bond_and_its_limit():
    refused = 0
    for seed in range(6):
        chain = deviating(chain_of(FLIPPER, ROTORS), seed, 0.08)
        if passes(chain):
            check_passable(chain)
            continue
        with pytest.raises(ValueError, match='lower the deviations of the chain') as refusal:
            check_passable(chain)
        named = re.search(r'rotor \S+ of 0 to 6: on bond (\d)', str(refusal.value))
        if named:
            refused += 1
            (obstacle,) = (each for each in find_obstacles(chain) if each.bond == int(named[1]))
            first, second = obstacle.rotor_lengths
            assert f'rotors of {first:.6g} m and {second:.6g} m' in str(refusal.value)
            assert f'{obstacle.spacing:.6g} m apart' in str(refusal.value)
            assert f'{obstacle.rest_length:.6g} m {obstacle.reason};' in str(refusal.value)
    assert refused


def test_rings_are_rejected_because_they_have_no_edges():
    for example in CLASSES:
        ring = dataclasses.replace(chain_of(example, 8), periodic=True)
        complaint = (
            'Chain.periodic = True joins rotor 7 to rotor 0, .*; free the ends of the chain'
        )
        with pytest.raises(ValueError, match=complaint):
            follow_wall(ring)
        with pytest.raises(ValueError, match=complaint):
            check_passable(ring)
