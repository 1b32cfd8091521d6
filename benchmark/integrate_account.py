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

COLUMNS = ('all [ns]', 'spring and turn [ns]', 'turn [ns]')


def account(sizes: list[int]) -> dict[str, list[float]]:
    """Time of a rotor and force in long runs, and of each of its loops called on its own."""
    return {str(size): [whole(size), *parts(size)] for size in sizes}


def whole(size: int) -> float:
    problem = Problem('flipper', size, 1.0, 0.5, 0.97, 0.1)
    steps = CompiledSteps(ChainMotion(problem.chain))
    state = np.concatenate([problem.angles, problem.rates])
    count = max(4, math.ceil(BUDGET / size / len(KICKS)))
    seconds = fastest(lambda: steps.advance(state, 0.1, count))
    return 1e9 * seconds / (count * len(KICKS) * size)


def parts(size: int) -> list[float]:
    """Loops over rows long enough to drown the call, as many times as there is a budget."""
    longer = max(size, 2000)
    work = np.random.default_rng(1).uniform(-0.1, 0.1, (4, longer + 1))
    coefficients = (1.1, 0.2, 0.3, 0.4, 0.5)
    calls: list[Callable[[], None]] = [
        lambda: kernels.kick_and_turn(*work, longer, coefficients, (1e-9, 1e-9)),
        lambda: kernels.turn(work, kernels.RATES, longer, 1e-9),
    ]
    repeats = math.ceil(BUDGET / longer)
    return [
        1e9 * fastest(lambda call=call: repeated(call, repeats)) / (repeats * longer)
        for call in calls
    ]


def repeated(call: Callable[[], None], times: int) -> None:
    for _ in range(times):
        call()


def fastest(call: Callable[[], object]) -> float:
    call()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)
