# SPDX-License-Identifier: Apache-2.0
"""Where the nanoseconds of our integrator go, a rotor and force."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from integrate_peers import Problem

from soliton_linkage import nystrom_kernels as kernels
from soliton_linkage.chain_motion import ChainMotion
from soliton_linkage.nystrom_steps import KICKS, CompiledSteps

REPEATS = 7
BUDGET = 2e6
"""Rotors and forces in a timed call: some milliseconds."""

WHOLE = 'integrating'


def account(sizes: list[int]) -> dict[str, dict[str, list[float]]]:
    """Nanoseconds of a rotor and force in long runs, and of its loops called on their own."""
    return {str(size): {WHOLE: whole(size), **loops(size)} for size in sizes}


def whole(size: int) -> list[float]:
    problem = Problem('flipper', size, 1.0, 0.5, 0.97, 0.1)
    steps = CompiledSteps(ChainMotion(problem.chain))
    state = np.concatenate([problem.angles, problem.rates])
    count = max(4, math.ceil(BUDGET / size / len(KICKS)))
    return nanoseconds(lambda: steps.advance(state, 0.1, count), count * len(KICKS) * size)


def loops(size: int) -> dict[str, list[float]]:
    """Over rows long enough to drown the call, as many times as there is a budget."""
    longer = max(size, 8000)
    work = np.random.default_rng(1).uniform(-0.1, 0.1, (4, longer + 1))
    rows = list(work)
    coefficients = (1.1, 0.2, 0.3, 0.4, 0.5)
    calls: dict[str, Callable[[], None]] = {
        'spring, kick and turn': lambda: kernels.kick_and_turn(
            *rows, longer, coefficients, (1e-9, 1e-9)
        ),
        'turn alone': lambda: kernels.turn(work, kernels.RATES, longer, 1e-9),
    }
    repeats = math.ceil(BUDGET / longer)
    return {
        name: nanoseconds(lambda call=call: repeated(call, repeats), repeats * longer)
        for name, call in calls.items()
    }


def repeated(call: Callable[[], None], times: int) -> None:
    for _ in range(times):
        call()


def nanoseconds(call: Callable[[], object], parts: int) -> list[float]:
    """Of each of the equal parts of a call, a number a repetition."""
    call()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        call()
        times.append(1e9 * (time.perf_counter() - start) / parts)
    return times
