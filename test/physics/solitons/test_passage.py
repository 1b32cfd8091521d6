# SPDX-License-Identifier: Apache-2.0
"""Walls pass where every bond is of one class, and turn back only where one is not."""

from __future__ import annotations

import dataclasses
import math
import re
from functools import lru_cache

import numpy as np
import pytest
from chains import EPS, EXAMPLES, FLIPPER, SPINNER, WOBBLER, any_chain, chain_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import Edge, rigidity_bands
from soliton_linkage.linear.statics import rest_state
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.deviations import Deviations, drawn_deviations
from soliton_linkage.solitons.passage import (
    blocked_bonds,
    find_obstacles,
    length_excesses,
    motion_of_bonds,
)
from soliton_linkage_studies.traversal import check_passable, follow_wall

CLASSES = (FLIPPER, WOBBLER, SPINNER)
ROTORS = 7


def deviating(chain: Chain, seed: int, fraction: float) -> Chain:
    """Draw deviations of r, a and k_e."""
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
    """Whether the wall crosses the chain of bars and returns; a chain that jams lets none by."""
    try:
        return all(leg.crossed for leg in follow_wall(chain))
    except (ArithmeticError, ValueError):
        return False


def travels(spacing: float, first: float, second: float, bar: float) -> tuple[bool, bool]:
    """Whether each of two rotors can turn all the way round, by trying every angle.

    The other rotor must reach the bar's other end: the distance from its pivot to the mass lies
    between |bar - length| and bar + length.
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
    first: float, second: float, bar: float, spinning: bool
) -> None:
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
def test_bonds_without_deviations_are_of_the_class_of_their_chain(chain: Chain) -> None:
    rounding = 16 * EPS * (chain.spacing + chain.rotor_length)
    assume(chain.rest_length - chain.spacing > rounding)
    reach = float(length_excesses(chain)[0])
    assume(min(abs(reach), abs(reach - chain.spacing)) > rounding)
    assert find_obstacles(chain) == ()
    assert motion_of_bonds(chain) is chain.motion
    lean = chain.lean_ratio
    squares = 4 * chain.rotor_length**2 - chain.rest_length**2
    size = 4 * chain.rotor_length**2 + chain.rest_length**2
    assert squares == pytest.approx(
        chain.spacing**2 * (lean**2 - 1), rel=0, abs=16 * EPS * (size + chain.spacing**2)
    )


@pytest.mark.parametrize(
    ('example', 'edge'),
    [
        *((example, Edge.FIRST) for example in EXAMPLES),
        *((example, Edge.LAST) for example in CLASSES),
    ],
)
def test_without_deviations_the_wall_crosses_and_returns_from_either_edge(
    example: tuple[float, float], edge: Edge
) -> None:
    chain = chain_of(example, 6)
    legs = follow_wall(chain, edge, legs=4)
    sense = 1 if edge is Edge.FIRST else -1
    assert [leg.direction for leg in legs] == [sense, -sense, sense, -sense]
    assert all(leg.crossed for leg in legs)
    for leg in legs:
        assert (leg.furthest if leg.direction > 0 else 5 - leg.furthest) > 2.5
    # Two legs later a spinner is where it was and a flipper is its own image; each end is seen
    # within a frame, in which the wall goes less than its width and rotors turn by 2 theta_bar.
    assert legs[3].arc == pytest.approx(legs[1].arc, rel=0, abs=chain.rest_angle)


@pytest.mark.parametrize(('example', 'seeds'), [(FLIPPER, 8), (WOBBLER, 4), (SPINNER, 4)])
def test_deviations_of_a_tenth_stop_no_wall_but_where_there_is_an_obstacle(
    example: tuple[float, float], seeds: int
) -> None:
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
def test_any_chain_without_obstacles_lets_the_wall_pass(
    logarithm: float, rest_angle: float, fraction: float, seed: int, rotors: int
) -> None:
    chain = deviating(chain_of((math.exp(logarithm), rest_angle), rotors), seed, fraction)
    excess = length_excesses(chain) - chain.spacings
    # At the border the bars lie in line, where the motion takes ever longer.
    assume(float(np.abs(excess).min()) > 0.02 * chain.spacing)
    assume(not blocked_bonds(chain).any())
    assert passes(chain)


def levers_along(chain: Chain, turns: float) -> Array:
    """A_n and B_n of all springs along the motion of the bars from rest, (T, 2, springs)."""
    angles = rest_state(chain, -1)
    kick = np.ones(chain.number_of_rotors)
    simulation = RigidSimulation(chain, angles, kick, 0.1, 1e-8)
    speed = float(np.linalg.norm(simulation.rates))
    recording = simulation.record(2 * math.pi * turns / speed)
    return np.stack(rigidity_bands(chain, recording.angles), axis=1)


@pytest.mark.parametrize('seed', [1, 2])
@pytest.mark.parametrize('example', CLASSES)
def test_rotors_come_into_line_with_bars_in_flippers_and_never_in_spinners(
    example: tuple[float, float], seed: int
) -> None:
    chain = deviating(chain_of(example, 5), seed, 0.03)
    levers = levers_along(chain, 3)
    in_line = bool((np.sign(levers) != np.sign(levers[0])).any())
    assert in_line == (motion_of_bonds(chain) is not Motion.SPINNER)


@pytest.mark.parametrize(
    ('example', 'fraction', 'relation'), [(FLIPPER, -0.2, 'longer'), (SPINNER, 1.0, 'shorter')]
)
def test_a_bond_of_another_class_is_named_with_its_lengths(
    example: tuple[float, float], fraction: float, relation: str
) -> None:
    chain = with_odd_bond(chain_of(example, ROTORS), 4, fraction)
    (obstacle,) = find_obstacles(chain)
    assert obstacle.bond == 4
    assert obstacle.spacing == chain.spacing
    assert obstacle.rotor_lengths == (chain.rotor_length, chain.rotor_length)
    assert obstacle.rest_length == pytest.approx((1 + fraction) * chain.rest_length, rel=EPS)
    assert relation in obstacle.reason or 'must be longer than' in obstacle.reason
    assert motion_of_bonds(chain) is None


def test_only_a_wall_that_turns_back_is_refused_with_its_bond_and_the_limit() -> None:
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


def test_the_frames_of_a_way_are_as_many_as_its_arc_however_little_rotors_lean(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames, advance = 0, RigidSimulation.advance

    def counted(simulation: RigidSimulation) -> None:
        nonlocal frames
        frames += 1
        advance(simulation)

    monkeypatch.setattr(RigidSimulation, 'advance', counted)
    arcs = []
    for rest_angle in (0.03, 0.01, 0.003):
        frames = 0
        legs = follow_wall(chain_of((0.5, rest_angle), 10))
        assert [leg.crossed for leg in legs] == [True, True]
        arcs.append(sum(leg.arc for leg in legs))
        # 40 frames a radian, and as many for the way to the edge, which is shorter than a leg.
        assert frames <= 40 * 1.5 * arcs[-1] + 3
    # The rotors between the edges turn by 2 theta_bar in a leg, whose arc is that of the edges.
    for arc, rest_angle in zip(arcs, (0.03, 0.01), strict=False):
        assert arc == pytest.approx(arcs[-1], abs=2 * 2 * rest_angle * math.sqrt(10) + 0.1)


@pytest.mark.parametrize('legs', [0, -1])
def test_a_way_of_no_legs_is_refused(legs: int) -> None:
    with pytest.raises(ValueError, match=f'legs = {legs} must be 1 or more; give 2'):
        follow_wall(chain_of(FLIPPER, 5), legs=legs)


@pytest.mark.parametrize('example', CLASSES)
def test_a_ring_is_refused_for_want_of_edges(example: tuple[float, float]) -> None:
    ring = dataclasses.replace(chain_of(example, 8), periodic=True)
    complaint = 'Chain.periodic = True joins rotor 7 to rotor 0, .*; free the ends of the chain'
    with pytest.raises(ValueError, match=complaint):
        follow_wall(ring)
    with pytest.raises(ValueError, match=complaint):
        check_passable(ring)
