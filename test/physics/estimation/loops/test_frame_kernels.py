# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of the analysis against their twins in numpy."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from soliton_linkage.estimation.loops import (
    filter_arrays,
    filter_kernels,
    frame_arrays,
    frame_kernels,
    tail_arrays,
    tail_kernels,
)
from soliton_linkage.linkage.chain import Array, Chain, staggered

SEEDS = range(6)
ROTORS, WALL = 60, 27
BASE, KICKS = 26, 8
MODULES = [
    (filter_kernels, filter_arrays),
    (frame_kernels, frame_arrays),
    (tail_kernels, tail_arrays),
]
NO_FLAGS = np.zeros(0, dtype=np.bool_)

Case = tuple[str, tuple[Any, ...]]


def angles_of(random: np.random.Generator) -> Array:
    """A wall between leaning rotors, with noise, whole turns and gaps."""
    signs = 1.0 - 2.0 * (np.arange(ROTORS) % 2)
    theta = -0.97 * np.tanh((np.arange(ROTORS) - WALL) / 3)
    angles = np.where(signs > 0, theta, math.pi - theta) + 0.03 * random.standard_normal(ROTORS)
    angles += 2 * math.pi * random.integers(-2, 3, ROTORS)
    angles[random.random(ROTORS) < 0.1] = math.nan
    return np.asarray(angles)


def flags(random: np.random.Generator, share: float, count: int = ROTORS) -> frame_arrays.Flags:
    return np.asarray(random.random(count) < share)


def filters(random: np.random.Generator) -> tuple[Array, Array, Array]:
    """States, spreads and weights."""
    factors = random.standard_normal((BASE + KICKS, 3, 3))
    spreads = factors @ factors.transpose(0, 2, 1)
    rows = spreads[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].T
    weights = random.random(BASE + KICKS)
    states = random.standard_normal((3, BASE + KICKS))
    return states, np.ascontiguousarray(rows), weights / weights.sum()


def of_filters(random: np.random.Generator) -> list[Case]:
    states, spreads, weights = filters(random)
    shares = weights[1:BASE] / weights[1:BASE].sum()
    odds = np.append(random.standard_normal(KICKS - 1), -math.inf)
    errors = random.random(BASE + KICKS)
    freedoms = 7.0 if random.random() < 0.5 else math.inf
    likelihoods = random.standard_normal(BASE - 1)
    of_weights = weights, shares, odds
    return [
        ('predict', (states, spreads, weights, errors, errors[::-1].copy(), 0.01, 0.9, 3.0)),
        ('expected_measurement', (states, spreads, weights)),
        (
            'take_in',
            (states, spreads, weights, shares, likelihoods, odds, 0.3, 0.1, freedoms),
        ),
        ('weigh', (weights, shares, odds, 1.2, 9.0, 1.0)),
        ('mixture', (weights, states, spreads, BASE, 0.02)),
        ('suppose_kick', (states, spreads, errors, odds, weights, 3, 0.01, 0.2)),
        *[
            ('settle', (states, spreads, errors, *of_weights, against, 9.0, 1.0, *kick, 0.02))
            for against, kick in (
                (1.2, (3, 0.01, 0.2)),
                (-6.0, (0, 0.1, 0.3)),
                (6.0, (7, 1.0, 2.0)),
            )
        ],
        *of_offsets(random),
    ]


def of_offsets(random: np.random.Generator) -> list[Case]:
    weights, sums = random.random((2, ROTORS)), random.standard_normal((2, ROTORS))
    weights[random.random((2, ROTORS)) < 0.3] = 0.0
    sides, row = random.integers(-1, 2, ROTORS).astype(float), np.zeros(ROTORS)
    angles, times = angles_of(random), random.integers(0, 9, ROTORS).astype(float)
    solution = random.random((5, ROTORS))
    solution[3] *= -0.5
    gathered = weights, sums, times, angles, sides, 0.3
    again = np.where(flags(random, 0.15), angles, 0.1)
    stuck = flags(random, 0.1)
    return [
        ('gather', gathered),
        ('solve', (weights, sums, 0.2, 3.0, np.zeros((5, ROTORS)))),
        ('learn', (*gathered, 0.01, 0.2, 3.0, solution, row, row)),
        *[
            (
                'surprise',
                (weights, solution, angles, times, 0.2, *ends, row, np.zeros((6, ROTORS))),
            )
            for ends in ((20.5, 33.0), (-3.0, 12.0), (math.inf, -math.inf))
        ],
        ('stand_apart', (solution, sides, 0.02, times)),
        *[('find_stuck', (angles, again, flags(random, 0.5), stuck, few)) for few in (0.01, 0.9)],
        ('lasting_residuals', (weights, sums, *np.zeros((2, 2 * ROTORS)))),
        ('lasting_residuals', (0 * weights, sums, *np.zeros((2, 2 * ROTORS)))),
    ]


def of_angles(random: np.random.Generator) -> list[Case]:
    angles, others = angles_of(random), angles_of(random)
    whole = np.nan_to_num(others)
    tangent = random.standard_normal(12)
    differences = np.where(random.random(ROTORS) < 0.1, math.nan, random.standard_normal(ROTORS))
    found = np.zeros(ROTORS, np.bool_), np.zeros(12, np.bool_), np.zeros(12)
    limited = 20, tangent, random.choice([0.5, 2.0, 9.0]), 0.1, 0.2
    knots = np.cumsum(random.random(30))
    last = np.append(others[:-1], math.nan)
    return [
        ('unwrap', (np.append(angles[:-1], 1e10), last, np.zeros(ROTORS), np.zeros(ROTORS))),
        ('all_within', (whole, 40.0)),
        ('all_within', (angles, math.inf)),
        ('known_changes', (angles, whole, others, np.zeros(ROTORS))),
        ('sines_and_cosines', (np.append(angles, [0.0, 3e7, -2e5]), *np.zeros((2, ROTORS + 3)))),
        ('compare', (angles, 0.1 * whole, True, whole, tangent, -whole, 20, np.zeros(ROTORS))),
        ('look', (differences, *limited, NO_FLAGS, *found)),
        ('look', (differences, *limited, flags(random, 0.2), *found)),
        ('look', (np.full(ROTORS, math.nan), *limited, NO_FLAGS, *found)),
        ('products_in_time', (tangent, tangent**2, tangent - 1, tangent / 4, 3, 0, 1, 8)),
        ('products_in_time', (tangent, tangent**2, tangent - 1, tangent / 4, 3, 20, 9, 0)),
        ('spline', (knots, random.standard_normal((22, 5)), 7, knots[12] + 0.01, np.zeros(5))),
    ]


def of_springs(random: np.random.Generator) -> list[Case]:
    cases: list[Case] = []
    for periodic in (False, True):
        chain = Chain(number_of_rotors=ROTORS, periodic=periodic)
        angles = np.nan_to_num(angles_of(random))
        sines, cosines = np.sin(angles), np.cos(angles)
        springs = chain.number_of_springs
        rows, half = np.array(chain.springs(angles)), random.random(springs)
        seen = half * flags(random, 0.8, springs)
        empty = np.zeros((3, springs))
        ends = np.array([-math.inf, 20.3, 31.8, math.inf])
        ring = np.array([-28.2, 20.3, 31.8, 80.3])
        cases += [
            ('springs', (sines, cosines, chain.spring_parameters, periodic, empty)),
            *[
                ('elastic', (rows, half, seen, half, periodic, 1e-4, walls, reach))
                for walls in (ends, ends[[0, 3]], ring)
                for reach in (3.3, 9.0)
            ],
        ]
    rates = random.standard_normal(ROTORS)
    rows = rows * np.where(np.arange(springs) // 4 == 5, [[1.0], [1e-200], [1e200]], 1.0)
    far = np.exp(np.cumsum(random.standard_normal(2000)))
    long = np.array([far, far, far * np.where(np.arange(2000) % 700 < 350, 8.0, 0.125)])
    return [
        *cases,
        *[
            ('kinetic', (rates**2, np.abs(rates), rates, 0.1, walls, 4.2))
            for walls in (ends, ends[[0, 3]], ring)
        ],
        ('topology', (np.ascontiguousarray(rows[:, :-1]), 20, 33, 0.4)),
        ('topology', (long, 900, 900, 0.4)),
        ('topology', (np.zeros((3, 5)), 2, 3, 0.4)),
    ]


def of_walls(random: np.random.Generator) -> list[Case]:
    angles = angles_of(random)
    whole = np.nan_to_num(angles)
    table, offsets = random.standard_normal((3, 402)), 100.0 + 201 * (np.arange(ROTORS) % 2)
    wall = 10, 20, WALL + 1, 40
    tail = 0.6 ** np.arange(15) * (-1) ** np.arange(15) + 0.01 * random.standard_normal(15)
    sides = np.zeros(20), np.zeros(20)
    beyond = np.arange(ROTORS) - WALL - 0.3
    wave = 0.6 ** np.abs(beyond) * np.cos(math.pi * np.abs(beyond))
    wobbling = staggered(-np.sign(beyond) * (0.97 + wave))
    wave = wave[WALL + 1 :] * (1 + 0.1 * random.random())
    return [
        ('contraction_sums', (angles, table, offsets, 15, 40, 27.3, 1.2, 0.1, 100.0)),
        *[
            ('beside_wall', (image, whole[10:45] + 0.01, *wall, spins, 0.97, *sides))
            for image in (whole, math.pi - whole)
            for spins in (False, True)
        ],
        *[('tail_of_side', (tail, 0.5, small)) for small in (0.0, 0.05, 0.7)],
        *[('overshooting', (tail, 0.97, calm)) for calm in (0.0, 1e-9, 0.1)],
        ('tail_sums', (tail, 1, 9, 0.97, 2.0)),
        ('tail_sums', (tail, 3, 2, 0.97, 2.0)),
        *[('half_wavelength', (wave, begin, 12, 0.97, 0.01)) for begin in (0, 3, 10, 12, 13)],
        *[
            ('wobble', (seen, at_rest, *wall, spins, 0.97, 0.05, 2.0, calm, noise, 0.04))
            for seen, noise in ((whole, 0.03), (wobbling + 0.003 * np.sin(whole), 0.003))
            for at_rest in (whole[10:45] + 0.01, wobbling[10:45], np.repeat(whole[10:45:5], 7))
            for spins, calm in ((False, 0.0), (False, 0.03), (True, 0.0))
        ],
        ('wobble', (whole, whole[:9] + 0.1, 0, 1, 1, 9, False, 0.97, 0.05, 2.0, 0.1, 0.1, 0.1)),
    ]


def of_motion(random: np.random.Generator) -> list[Case]:
    angles, flat = angles_of(random), np.zeros((2, 3, 3))
    sines, cosines = np.sin(angles), np.cos(angles)
    turned = 0.97 + math.pi / 2 * (1 + np.tanh((np.arange(ROTORS) - WALL) / 3))
    spun = staggered(turned + 0.02 * random.standard_normal(ROTORS))
    lean = math.asin(0.8)
    factors = random.standard_normal((2, 3, 5))
    one = factors @ factors.transpose(0, 2, 1)
    other = one * [[[0.3]], [[0.0]]]
    return [
        ('bond_of_wall', (sines,)),
        ('bond_of_wall', (np.array([]),)),
        ('bond_of_wall', (np.array([0.0, 0.0, -1.0]),)),
        ('uniform_part', (angles, sines, cosines, WALL, ROTORS - 1)),
        ('uniform_part', (angles, sines, cosines, WALL - 1, 0)),
        ('tail_products', (angles, WALL, ROTORS - 1, -lean, -1.0, lean, 0.05, np.ones((3, 3)))),
        ('tail_products', (angles, WALL - 1, 0, lean, 1.0, lean, 0.01, np.ones((3, 3)))),
        *[
            ('evidence', (each, np.sin(each), np.cos(each), noise, flat))
            for each in (angles, spun, math.pi - spun, angles[:30], angles[WALL:], angles[:6])
            for noise in (0.0, 0.2)
        ],
        ('add_evidence', (3.0, 0.9, one, 29.0, 1.1, other, flat)),
        ('add_evidence', (-3.0, math.nan, one, -29.0, 1.1, other, flat)),
        ('add_evidence', (-3.0, 0.9, one, 0.5, math.nan, flat, flat)),
        ('add_evidence', (0.0, math.nan, flat, 0.5, math.nan, flat, flat)),
        ('tail_ratio', (one, 0.97)),
        ('tail_ratio', (other, 0.97)),
        ('tail_ratio', (flat, math.nan)),
    ]


CASES = [of_filters, of_angles, of_springs, of_walls, of_motion]


def twins(name: str) -> tuple[Any, Any]:
    """A kernel and the same in numpy."""
    kernels, arrays = next(each for each in MODULES if hasattr(each[0], name))
    return getattr(kernels, name), getattr(arrays, name)


def same(one: Any, other: Any) -> bool:
    return np.allclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True)


def numbers(found: Any) -> list[float]:
    """All numbers of nested tuples."""
    if isinstance(found, tuple):
        return [number for each in found for number in numbers(each)]
    return [] if found is None else [float(found)]


def ran(function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[Any, list[Any]]:
    """What a function returns, and what it leaves in its arguments."""
    given = [each.copy() if isinstance(each, np.ndarray) else each for each in arguments]
    with np.errstate(all='ignore'):
        return numbers(function(*given)), given


@pytest.mark.parametrize('cases', CASES)
@pytest.mark.parametrize('seed', SEEDS)
def test_kernels_compute_what_numpy_does(
    cases: Callable[[np.random.Generator], list[Case]], seed: int
) -> None:
    for name, arguments in cases(np.random.default_rng(seed)):
        found, expected = (ran(function, arguments) for function in twins(name))
        assert same(found[0], expected[0]), name
        for left, right in zip(found[1], expected[1], strict=True):
            assert same(left, right), name


def test_every_kernel_is_compared_and_is_called_as_its_twin() -> None:
    random = np.random.default_rng(0)
    cases = [case for each in CASES for case in each(random)]
    public = {
        name
        for kernels, _ in MODULES
        for name, value in vars(kernels).items()
        if hasattr(value, 'py_func') and not name.startswith('_')
    }
    assert {name for name, _ in cases} == public
    for name in public:
        kernel, twin = twins(name)
        assert inspect.signature(kernel.py_func) == inspect.signature(twin)


def test_nothing_is_compiled_in_a_frame() -> None:
    # Another type than those compiled for is refused, not compiled.
    with pytest.raises(TypeError):
        frame_kernels.all_within(np.zeros(4, dtype=np.float32), 1.0)
    frozen = np.ones(4)
    frozen.flags.writeable = False
    assert frame_kernels.all_within(frozen, 1.0)


@pytest.mark.parametrize('loops', MODULES[0])
def test_a_filter_without_a_share_may_be_the_likeliest_by_any_amount(loops: ModuleType) -> None:
    # The steady filter and one with all shares expect 0, one without a share and a kick expect 1.
    states, spreads = np.zeros((3, 4)), np.zeros((6, 4))
    states[0, 2:] = 1.0
    spreads[0] = variance = 1e-12
    shares, odds = np.array([1.0, 0.0]), np.zeros(1)
    weights, likelihoods = np.array([0.5, 0.5, 0.0, 0.0]), np.array([0.0, -2000.0])
    against, largest = loops.take_in(
        states, spreads, weights, shares, likelihoods, odds, 1.0, variance, math.inf
    )
    assert against == pytest.approx(0.0, abs=1e-9)
    assert largest == odds[0] == pytest.approx(1 / (4 * variance))
    assert shares == pytest.approx([0.0, 1.0])
