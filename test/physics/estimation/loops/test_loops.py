# SPDX-License-Identifier: Apache-2.0
"""Loops of the estimation against their naive twins, and against closed forms."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any

import naive_filters
import naive_frames
import naive_tails
import numpy as np
import pytest

from soliton_linkage.estimation.loops import (
    filter_loops,
    frame_loops,
    likelihood_loops,
    offset_loops,
    state_loops,
    tail_loops,
    wobble_loops,
)
from soliton_linkage.estimation.loops.filter_loops import Records
from soliton_linkage.estimation.settings import DEFAULTS, FilterSettings, OffsetSettings
from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage.linkage.deviations import drawn_deviations

SEEDS = range(6)
ROTORS, WALL = 60, 27
BASE, KICKS = 26, 8
MODULES = [
    (filter_loops, naive_filters),
    (offset_loops, naive_filters),
    (frame_loops, naive_frames),
    (state_loops, naive_frames),
    (tail_loops, naive_tails),
    (wobble_loops, naive_tails),
]

Case = tuple[str, tuple[Any, ...]]


def angles_of(random: np.random.Generator) -> Array:
    """A wall between leaning rotors, with noise, whole turns and gaps."""
    signs = 1.0 - 2.0 * (np.arange(ROTORS) % 2)
    theta = -0.97 * np.tanh((np.arange(ROTORS) - WALL) / 3)
    angles = np.where(signs > 0, theta, math.pi - theta) + 0.03 * random.standard_normal(ROTORS)
    angles += 2 * math.pi * random.integers(-2, 3, ROTORS)
    angles[random.random(ROTORS) < 0.1] = math.nan
    return np.asarray(angles)


def flags(random: np.random.Generator, share: float, count: int = ROTORS) -> frame_loops.Flags:
    return np.asarray(random.random(count) < share)


def filters(random: np.random.Generator) -> Records:
    """Filters in any state."""
    factors = random.standard_normal((BASE + KICKS, 4, 4))
    covariances = factors @ factors.transpose(0, 2, 1)
    made = np.zeros(BASE + KICKS, filter_loops.FILTER)
    naive_filters.put(made, random.standard_normal((BASE + KICKS, 4)), covariances)
    for name in ('weight', 'wander', 'wander_at_edges', 'bias_variance'):
        made[name] = random.random(BASE + KICKS)
    made['weight'] /= made['weight'].sum()
    made['share'][1:BASE] = made['weight'][1:BASE] / made['weight'][1:BASE].sum()
    made['likelihood'][1:BASE] = random.standard_normal(BASE - 1)
    made['odds'][BASE:] = np.append(random.standard_normal(KICKS - 1), -math.inf)
    return made


def of_filters(random: np.random.Generator) -> list[Case]:
    made = filters(random)
    freedoms = 7.0 if random.random() < 0.5 else math.inf
    settings = FilterSettings(kick_evidence=0.5).record
    return [
        *[
            ('predict', (made, 0.01, 0.9, 3.0, 0.8, at_edge, ratio, 0.7, 5.0, 0.1))
            for at_edge, ratio in ((False, 1.0), (True, 0.7))
        ],
        ('expected_measurement', (made,)),
        ('update', (made, BASE, 0.3, 0.1, freedoms)),
        ('set_weights', (made, settings, BASE, 1.2)),
        *[('mixture', (made, count)) for count in (BASE, BASE + KICKS)],
        ('suppose_kick', (made, BASE, 3, 0.01, 0.2)),
        ('begin_steady', (made, BASE)),
        ('begin_kicked', (made, BASE)),
        *[
            ('measure', (made, given, BASE, 0.3, 0.1, freedoms, *odds, 0.01, 0.2, 0.5))
            for given in (settings, FilterSettings(kick_beyond_chance=0.5).record)
            for odds in ((1.2, False, 7), (-60.0, True, 1023), (60.0, False, 2))
        ],
        *of_offsets(random),
    ]


def of_offsets(random: np.random.Generator) -> list[Case]:
    encoders = np.zeros(ROTORS, offset_loops.ENCODER)
    for name in encoders.dtype.names or ():
        encoders[name] = random.random(ROTORS)
    encoders['offset_rest_angle'] *= -0.5
    encoders['means'] = random.integers(0, 9, ROTORS)
    for name in ('weight_before', 'weight_beyond'):
        encoders[name][random.random(ROTORS) < 0.3] = 0.0
    sides, row = random.integers(-1, 2, ROTORS).astype(float), np.zeros(ROTORS)
    angles, times = angles_of(random), random.integers(0, 9, ROTORS).astype(float)
    again = np.where(flags(random, 0.15), angles, 0.1)
    stuck = flags(random, 0.1)
    settings = OffsetSettings(significance=0.5, beyond_chance=0.1).record
    return [
        ('add_residuals', (encoders, angles, sides, 0.3)),
        ('solve', (encoders, 0.2, 3.0)),
        ('find_sure', (encoders, settings, 0.01, row, row)),
        *[
            ('compare_means', (encoders, angles, times, 0.2, *ends, row, np.zeros((6, ROTORS))))
            for ends in ((20.5, 33.0), (-3.0, 12.0), (math.inf, -math.inf))
        ],
        ('beyond_chance', (encoders, settings, sides, 0.02, times)),
        *[
            ('find_stuck', (angles, again, flags(random, 0.5), stuck, few, 0.05))
            for few in (0.01, 0.9)
        ],
    ]


def of_angles(random: np.random.Generator) -> list[Case]:
    angles, others = angles_of(random), angles_of(random)
    whole = np.nan_to_num(others)
    tangent = random.standard_normal(12)
    last = np.append(others[:-1], math.nan)
    return [
        ('unwrap', (np.append(angles[:-1], 1e10), last, np.zeros(ROTORS), np.zeros(ROTORS))),
        ('all_within', (whole, 40.0)),
        ('all_within', (angles, math.inf)),
        *[('median_change', (angles[:n], whole[:n], others[:n])) for n in (ROTORS, 17, 16, 0)],
        ('compare', (angles, 0.1 * whole, True, whole, tangent, -whole, 20, np.zeros(ROTORS))),
        ('products_in_time', (whole, whole**2, whole - 1, tangent / 4, 30)),
    ]


def of_springs(random: np.random.Generator) -> list[Case]:
    cases: list[Case] = []
    for periodic in (False, True):
        chain = Chain(number_of_rotors=ROTORS, periodic=periodic)
        angles = np.nan_to_num(angles_of(random))
        springs = chain.number_of_springs
        rows, half = np.array(chain.springs(angles)), random.random(springs)
        seen = half * flags(random, 0.8, springs)
        empty = np.zeros((3, springs))
        ends = np.array([-math.inf, 20.3, 31.8, math.inf])
        ring = np.array([-28.2, 20.3, 31.8, 80.3])
        cases += [
            ('of_angles', (angles, chain.spring_parameters, periodic, empty)),
            *[
                ('elastic', (rows, half, seen, half, periodic, 0.01, walls, reach))
                for walls in (ends, ends[[0, 3]], ring)
                for reach in (3.3, 9.0)
            ],
        ]
    rates = random.standard_normal(ROTORS)
    bars = angles, chain.spring_parameters, True
    rows = rows * np.where(np.arange(springs) // 4 == 5, [[1.0], [1e-200], [1e200]], 1.0)
    far = np.exp(np.cumsum(random.standard_normal(2000)))
    long = np.array([far, far, far * np.where(np.arange(2000) % 700 < 350, 8.0, 0.125)])
    return [
        *cases,
        *[
            ('kinetic', (rates**2, np.abs(rates), rates, 0.3, walls, 4.2))
            for walls in (ends, ends[[0, 3]], ring)
        ],
        (
            'report',
            (*bars, *(half,) * 3, 0.1, *(rates**2,) * 2, rates, 0.2, ring, 4.2, 20, 33, 0.4),
        ),
        ('topology', (np.ascontiguousarray(rows[:, :-1]), 20, 33, 0.4)),
        ('topology', (long, 900, 900, 0.4)),
        ('topology', (np.zeros((3, 5)), 2, 3, 0.4)),
    ]


def of_walls(random: np.random.Generator) -> list[Case]:
    angles = angles_of(random)
    whole = np.nan_to_num(angles)
    settings = DEFAULTS.wobble.record
    wall = 10, 20, WALL + 1, 40
    tail = 0.6 ** np.arange(15) * (-1) ** np.arange(15) + 0.01 * random.standard_normal(15)
    sides = np.zeros(20), np.zeros(20)
    bars = [
        np.array([(0.05, 0.1, 0.97, *each)], wobble_loops.BARS)
        for each in ((1.65, 0.0), (0.8, 0.0), (1.65, 1.0))
    ]
    beyond = np.arange(ROTORS) - WALL - 0.3
    wave = 0.6 ** np.abs(beyond) * np.cos(math.pi * np.abs(beyond))
    wobbling = staggered(-np.sign(beyond) * (0.97 + wave))
    wave = wave[WALL + 1 :] * (1 + 0.1 * random.random())
    return [
        *[
            ('beside_wall', (image, whole[10:45] + 0.01, *wall, spins, 0.97, *sides))
            for image in (whole, math.pi - whole)
            for spins in (False, True)
        ],
        *[('tail_of_side', (tail, 0.5, small)) for small in (0.0, 0.05, 0.7)],
        *[('overshooting', (tail, 0.97, calm)) for calm in (0.0, 1e-9, 0.1)],
        ('tail_sums', (tail, 1, 9, 0.97, 2.0)),
        ('tail_sums', (tail, 3, 2, 0.97, 2.0)),
        *[('half_wavelength', (wave, begin, 12, 0.97, 0.01, 0.3)) for begin in (0, 3, 10, 12, 13)],
        *[
            (
                'wobble',
                (settings, each, seen, at_rest, 10, WALL + 0.3, *errors),
            )
            for seen, errors in (
                (whole, (0.03, 0.04)),
                (wobbling + 0.003 * np.sin(whole), (0.003, 0.04)),
            )
            for at_rest in (whole[10:45] + 0.01, wobbling[10:45], np.repeat(whole[10:45:5], 7))
            for each in bars
        ],
        ('wobble', (settings, bars[1], whole, whole[:9] + 0.1, 0, 0.3, 0.1, 0.1)),
    ]


def of_motion(random: np.random.Generator) -> list[Case]:
    angles, flat, settings = angles_of(random), np.zeros((3, 3)), DEFAULTS.motion.record
    sines, cosines = np.sin(angles), np.cos(angles)
    turned = 0.97 + math.pi / 2 * (1 + np.tanh((np.arange(ROTORS) - WALL) / 3))
    spun = staggered(turned + 0.02 * random.standard_normal(ROTORS))
    lean = math.asin(0.8)
    factors = random.standard_normal((3, 5))
    one = factors @ factors.T
    return [
        *[
            ('observe', (settings, each, 0.01, 29.0, lean, one))
            for each in (angles, spun)
            for lean in (0.9, math.nan)
        ],
        ('bond_of_wall', (sines,)),
        ('bond_of_wall', (np.array([]),)),
        ('bond_of_wall', (np.array([0.0, 0.0, -1.0]),)),
        ('uniform_part', (angles, sines, cosines, WALL, ROTORS - 1)),
        ('uniform_part', (angles, sines, cosines, WALL - 1, 0)),
        *[
            ('tail_products', (settings, angles, *side, noise, np.zeros((3, 3))))
            for side in ((WALL, ROTORS - 1, 7, -lean, -1.0), (WALL - 1, 0, 9, lean, 1.0))
            for noise in (0.005, 0.03, 0.2)
        ],
        *[
            ('evidence', (settings, each, np.sin(each), np.cos(each), noise, flat))
            for each in (angles, spun, math.pi - spun, angles[:30], angles[WALL:], angles[:6])
            for noise in (0.0, 0.2)
        ],
        ('tail_ratio', (settings, one, 0.97)),
        ('tail_ratio', (settings, flat, math.nan)),
    ]


CASES = [of_filters, of_angles, of_springs, of_walls, of_motion]


def twins(name: str) -> tuple[Any, Any]:
    """A loop and the same in numpy."""
    loops, naive = next(each for each in MODULES if hasattr(each[0], name))
    return getattr(loops, name), getattr(naive, name)


def same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and one.dtype.names:
        return all(same(one[name], other[name]) for name in one.dtype.names)
    if isinstance(one, tuple):
        return one == other
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
def test_loops_compute_what_numpy_does(
    cases: Callable[[np.random.Generator], list[Case]], seed: int
) -> None:
    for name, arguments in cases(np.random.default_rng(seed)):
        found, expected = (ran(function, arguments) for function in twins(name))
        assert same(found[0], expected[0]), name
        for left, right in zip(found[1], expected[1], strict=True):
            assert same(left, right), name


def test_every_loop_is_compared_and_is_called_as_its_twin() -> None:
    random = np.random.default_rng(0)
    cases = [case for each in CASES for case in each(random)]
    public = {
        name
        for loops, _ in MODULES
        for name, value in vars(loops).items()
        if hasattr(value, 'py_func') and not name.startswith('_')
    }
    assert {name for name, _ in cases} == public - {'next_deviation', 'wrapped'}
    for name, _ in cases:
        loop, twin = twins(name)
        assert inspect.signature(loop.py_func) == inspect.signature(twin)


def test_nothing_is_compiled_in_a_frame() -> None:
    # Another type than those compiled for is refused, not compiled.
    with pytest.raises(TypeError):
        frame_loops.all_within(np.zeros(4, dtype=np.float32), 1.0)
    frozen = np.ones(4)
    frozen.flags.writeable = False
    assert frame_loops.all_within(frozen, 1.0)


def test_a_scan_finds_the_likelihood_of_each_sample() -> None:
    random, variance, bound, floor = np.random.default_rng(5), 0.04, 2.5, -4.0
    angles, walls = angles_of(random), angles_of(random)
    apart = np.remainder(angles - walls + math.pi, 2 * math.pi) - math.pi
    expected = likelihood_loops.frame_likelihood(apart, variance, bound, floor)
    table = np.empty(2 + math.ceil(math.pi / math.sqrt(variance) * 32))
    likelihood_loops.tabulate(variance, bound, floor, table)
    found, first = np.empty(1), np.zeros(1, dtype=np.int64)
    sums, begins = np.zeros((1, ROTORS + 1)), np.array([0, ROTORS])
    likelihood_loops.scan(angles, sums, sums, first, first, begins, walls, table, found)
    assert found[0] == pytest.approx(expected, abs=ROTORS / (8 * 32**2))


def test_a_filter_without_a_share_may_be_the_likeliest_by_any_amount() -> None:
    # The steady filter and one with all shares expect 0, one without a share and a kick expect 1.
    made = np.zeros(4, filter_loops.FILTER)
    made['arc'] = [0.0, 0.0, 1.0, 1.0]
    made['arc_arc'] = variance = 1e-12
    made['share'][1] = 1.0
    made['weight'][:2] = 0.5
    made['likelihood'][2] = -2000.0
    against, largest = filter_loops.update(made, 3, 1.0, variance, math.inf)
    assert against == pytest.approx(0.0, abs=1e-9)
    assert largest == made['odds'][3] == pytest.approx(1 / (4 * variance))
    assert made['share'][1:3] == pytest.approx([0.0, 1.0])


@pytest.mark.parametrize('periodic', [False, True])
def test_springs_are_those_of_the_chain(periodic: bool) -> None:
    deviations = drawn_deviations(12, 3, periodic, rotor_length=0.1, spacing=0.1, rest_length=0.1)
    chain = Chain(number_of_rotors=12, periodic=periodic, deviations=deviations)
    angles = np.random.default_rng(2).uniform(-4, 4, 12)
    rows = np.empty((3, chain.number_of_springs))
    state_loops.of_angles(angles, chain.spring_parameters, periodic, rows)
    assert rows == pytest.approx(np.array(chain.springs(angles)), rel=1e-12, abs=1e-15)


def test_the_mode_sits_where_its_squares_do_however_far_they_fall() -> None:
    # Squares of 10^(2 k) as far as k = 400 below the largest, and up again.
    falls = np.concatenate([np.arange(500), np.arange(500)[::-1], np.full(3, 0)])
    exponents = 2.0 * falls
    ratios = 10.0 ** np.diff(exponents)
    rows = np.ones((3, len(ratios)))
    rows[1] = np.sqrt(ratios)
    *_, centre = state_loops.topology(rows, 1, 1, 0.5)
    weights = 10.0 ** (exponents - exponents.max())
    assert centre == pytest.approx(np.arange(len(weights)) @ weights / weights.sum(), rel=1e-9)
