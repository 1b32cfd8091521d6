# SPDX-License-Identifier: Apache-2.0
"""Time per rotor and force of our integrator and of its loops."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from integrate_peers import Problem

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators import nystrom_loops
from soliton_linkage.dynamics.integrators.nystrom_steps import KICKS, NystromSteps, zeros_in_line
from soliton_linkage.dynamics.terms import (
    VECTOR,
    SpringTorques,
    padded_size,
    sum_terms,
    term_table,
)
from soliton_linkage.linkage.chain import Array

REPEATS = 7
BUDGET = 2e6
"""Number of rotors times number of forces in a timed call [1]; a call takes a few milliseconds."""

WHOLE = 'integrating'
STEP = 0.1


def account(sizes: list[int]) -> dict[str, dict[str, list[float]]]:
    """Return the time per rotor and force [ns], in long runs and in single loops."""
    return {str(size): {WHOLE: symplectic(size), **loops(size)} for size in sizes}


def symplectic(size: int) -> list[float]:
    motion, state = moving(size)
    steps = NystromSteps(motion)
    count = max(4, math.ceil(BUDGET / size / len(KICKS)))
    return nanoseconds(lambda: steps.advance(state, STEP, count), count * len(KICKS) * size)


def moving(size: int) -> tuple[EquationOfMotion, Array]:
    problem = Problem('flipper', size, 1.0, 0.5, 0.97, 0.1)
    return EquationOfMotion(problem.chain), np.concatenate([problem.angles, problem.rates])


def loops(size: int) -> dict[str, list[float]]:
    """Return the times of single loops on rows so long that call overhead is negligible."""
    longer = max(size, 8000)
    motion, _ = moving(longer)
    work = zeros_in_line(nystrom_loops.WORK_ROWS, padded_size(longer) + VECTOR)
    work[:] = np.random.default_rng(1).uniform(-0.1, 0.1, work.shape)
    table = term_table([SpringTorques(motion.chain)], longer)
    calls: dict[str, Callable[[], object]] = {
        'springs': lambda: sum_terms(work, longer, *table),
        'turn': lambda: nystrom_loops.turn(work, nystrom_loops.RATES, 1e-9),
    }
    repeats = math.ceil(BUDGET / longer)
    return {
        name: nanoseconds(lambda call=call: repeated(call, repeats), repeats * longer)
        for name, call in calls.items()
    }


def repeated(call: Callable[[], object], times: int) -> None:
    for _ in range(times):
        call()


def nanoseconds(call: Callable[[], object], parts: int) -> list[float]:
    """Return the time per equal part of a call [ns], one number per repetition."""
    call()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        call()
        times.append(1e9 * (time.perf_counter() - start) / parts)
    return times
