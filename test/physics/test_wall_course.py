# SPDX-License-Identifier: Apache-2.0
"""The course of a wall from rotor to rotor: the rotor that moves most, all the way round."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER, chain_of

from soliton_linkage.chain import Chain
from soliton_linkage.deviations import drawn_deviations
from soliton_linkage.rigidity import zero_mode
from soliton_linkage.static_wall import hung_from
from soliton_linkage.wall_course import Course, wall_course

ROTORS = 16
BESIDE = ROTORS - 1
EXAMPLES = pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])


def deviating(example: tuple[float, float]) -> Chain:
    drawn = drawn_deviations(ROTORS, 5, rotor_length=0.05, spacing=0.05, rest_length=0.05)
    return dataclasses.replace(chain_of(example, ROTORS), deviations=drawn)


def sides(course: Course, piece: int) -> tuple[list[int], list[int]]:
    """Sides of all bars of the chain, picked from those beside the seed."""
    bars = np.arange(ROTORS - 1) - int(course.seeds[piece]) + BESIDE
    return course.left_sides[piece][bars].tolist(), course.right_sides[piece][bars].tolist()


@EXAMPLES
def test_the_seed_moves_most(example: tuple[float, float]) -> None:
    chain = deviating(example)
    course = wall_course(chain, BESIDE)
    for piece, seed in enumerate(course.seeds.tolist()):
        left, right = (np.array(each, dtype=np.float64) for each in sides(course, piece))
        for angle in np.linspace(course.begins[piece], course.ends[piece], 7).tolist():
            mode = np.abs(zero_mode(chain, hung_from(chain, seed, angle, left, right)))
            assert mode[seed] >= mode.max() * (1 - 1e-6)


@EXAMPLES
def test_every_rotor_is_a_seed_in_every_leg(example: tuple[float, float]) -> None:
    course = wall_course(deviating(example), BESIDE)
    ways = 2 if example == SPINNER else 4
    assert np.bincount(course.seeds, minlength=ROTORS)[1:-1].min() >= ways
    assert course.seeds[0] == course.seeds[-1]


@EXAMPLES
def test_rotors_of_flippers_come_back_and_those_of_spinners_turn_once(
    example: tuple[float, float],
) -> None:
    chain = deviating(example)
    course = wall_course(chain, BESIDE)
    inner = np.arange(4, ROTORS - 4)
    turns = np.array([(course.ends - course.begins)[course.seeds == n].sum() for n in inner])
    if example == SPINNER:
        # While another rotor is the seed each turns as well, and the same way.
        assert (np.abs(turns) < 2 * np.pi).all()
        for rotor in inner.tolist():
            ways = np.sign((course.ends - course.begins)[course.seeds == rotor])
            assert abs(ways.sum()) == len(ways)
    else:
        assert np.abs(turns).max() < 1e-9


@EXAMPLES
def test_halves_are_the_same_way(example: tuple[float, float]) -> None:
    course = wall_course(deviating(example), 2)
    halves = course.halves()
    assert len(halves) == 2 * len(course)
    assert halves.begins[::2].tolist() == course.begins.tolist()
    assert halves.ends[1::2].tolist() == course.ends.tolist()
    assert halves.ends[::2].tolist() == halves.begins[1::2].tolist()
    assert halves.seeds[1::2].tolist() == course.seeds.tolist()
