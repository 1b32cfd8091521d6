# SPDX-License-Identifier: Apache-2.0
"""What the analysis of a frame computes, against closed forms, and without compiled loops."""

from __future__ import annotations

import builtins
import enum
import math
from collections.abc import Sequence
from types import ModuleType

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from soliton_linkage.estimation.analyser import Analyser, Analysis
from soliton_linkage.estimation.loops import (
    filter_arrays,
    filter_kernels,
    frame_arrays,
    frame_kernels,
    tail_arrays,
    tail_kernels,
)
from soliton_linkage.estimation.loops.filter_arrays import filter_loops
from soliton_linkage.estimation.loops.frame_arrays import frame_loops
from soliton_linkage.estimation.loops.tail_arrays import tail_loops
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

LOOPS = [frame_arrays, frame_kernels]


@pytest.mark.parametrize('count', [1, 2, 5, 8, 101, 1000])
def test_the_median_is_that_of_numpy(count: int) -> None:
    values = np.random.default_rng(count).standard_normal(count)
    assert frame_arrays.median(values.copy()) == np.median(values)


@pytest.mark.parametrize('loops', LOOPS)
def test_splines_are_those_of_scipy(loops: ModuleType) -> None:
    random = np.random.default_rng(1)
    places = np.cumsum(0.1 + random.random(40))
    spline = make_interp_spline(places, random.standard_normal((40, 3)), k=7)
    found = np.empty(3)
    for at in [*places, *random.uniform(places[0], places[-1], 50)]:
        loops.spline(spline.t, spline.c, 7, at, found)
        assert found == pytest.approx(spline(at), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize('loops', LOOPS)
def test_sines_and_cosines_are_those_of_numpy_to_rounding(loops: ModuleType) -> None:
    random = np.random.default_rng(4)
    quarters = np.arange(-2000, 2001) * math.pi / 4
    spread = np.concatenate([random.uniform(-size, size, 3000) for size in (4.0, 1e5, 1e9)])
    angles = np.concatenate([quarters, spread, [1e5, -1e5, math.nan, 0.0]])
    sines, cosines = np.empty_like(angles), np.empty_like(angles)
    loops.sines_and_cosines(angles, sines, cosines)
    assert sines == pytest.approx(np.sin(angles), rel=0, abs=3e-16, nan_ok=True)
    assert cosines == pytest.approx(np.cos(angles), rel=0, abs=3e-16, nan_ok=True)


@pytest.mark.parametrize('loops', LOOPS)
@pytest.mark.parametrize('periodic', [False, True])
def test_springs_are_those_of_the_chain(loops: ModuleType, periodic: bool) -> None:
    deviations = drawn_deviations(12, 3, periodic, rotor_length=0.1, spacing=0.1, rest_length=0.1)
    chain = Chain(number_of_rotors=12, periodic=periodic, deviations=deviations)
    angles = np.random.default_rng(2).uniform(-4, 4, 12)
    rows = np.empty((3, chain.number_of_springs))
    loops.springs(np.sin(angles), np.cos(angles), chain.spring_parameters, periodic, rows)
    assert rows == pytest.approx(np.array(chain.springs(angles)), rel=1e-12, abs=1e-15)


@pytest.mark.parametrize('loops', LOOPS)
def test_the_mode_sits_where_its_squares_do_however_far_they_fall(loops: ModuleType) -> None:
    # Squares of 10^(2 k) as far as k = 400 below the largest, and up again.
    falls = np.concatenate([np.arange(500), np.arange(500)[::-1], np.full(3, 0)])
    exponents = 2.0 * falls
    ratios = 10.0 ** np.diff(exponents)
    rows = np.ones((3, len(ratios)))
    rows[1] = np.sqrt(ratios)
    *_, centre = loops.topology(rows, 1, 1, 0.5)
    weights = 10.0 ** (exponents - exponents.max())
    assert centre == pytest.approx(np.arange(len(weights)) @ weights / weights.sum(), rel=1e-9)


def analyses(chain: Chain, noise: float) -> list[Analysis]:
    orbit, random = UniformOrbit(chain), np.random.default_rng(3)
    analyser, found = Analyser(chain), []
    for number in range(60):
        arc = 5.0 + 0.02 * number
        angles = orbit.configuration(arc) + noise * random.standard_normal(chain.number_of_rotors)
        rates = noise * random.standard_normal(chain.number_of_rotors)
        if number % 10 == 0:
            angles[3] = math.nan
        found.append(analyser.analyse(10_000_000 * number, angles, rates))
    return [each for each in found if each is not None]


def told(value: object) -> list[object]:
    """All that an analysis says, value by value."""
    parts = value if isinstance(value, tuple) else getattr(value, '__dict__', None)
    if isinstance(value, enum.Enum) or parts is None:
        return [value]
    each = parts.values() if isinstance(parts, dict) else parts
    return [one for part in each for one in told(part)]


def forget_loops() -> None:
    for loops in (frame_loops, filter_loops, tail_loops):
        loops.cache_clear()


def test_numpy_steps_in_when_numba_is_absent(monkeypatch: pytest.MonkeyPatch) -> None:
    chain, real_import = Chain(number_of_rotors=16), builtins.__import__
    compiled = frame_kernels, filter_kernels, tail_kernels
    assert (frame_loops(), filter_loops(), tail_loops()) == compiled
    quick = analyses(chain, 0.01)

    def without_kernels(
        name: str,
        globals_: object = None,
        locals_: object = None,
        fromlist: Sequence[str] = (),
        level: int = 0,
    ) -> object:
        if {'frame_kernels', 'filter_kernels', 'tail_kernels'} & set(fromlist or ()):
            raise ImportError('No module named numba')
        return real_import(name, globals_, locals_, fromlist, level)

    monkeypatch.setattr(builtins, '__import__', without_kernels)
    forget_loops()
    try:
        in_numpy = frame_arrays, filter_arrays, tail_arrays
        assert (frame_loops(), filter_loops(), tail_loops()) == in_numpy
        slow = analyses(chain, 0.01)
    finally:
        forget_loops()
    for one, other in zip(quick, slow, strict=True):
        for left, right in zip(told(one), told(other), strict=True):
            if isinstance(left, float):
                assert left == pytest.approx(right, rel=1e-6, abs=1e-9, nan_ok=True)
            else:
                assert left == right
