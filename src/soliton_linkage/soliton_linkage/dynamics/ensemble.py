# SPDX-License-Identifier: Apache-2.0
"""Simultaneous simulation of many chains, such as many realisations of a disordered chain."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from itertools import repeat
from typing import Any

import numpy as np

from soliton_linkage.dynamics.elastic import absolute_tolerances
from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.initial_states import State
from soliton_linkage.dynamics.integrators.symplectic_nystrom import SymplecticNystrom
from soliton_linkage.dynamics.simulation import SMALLEST_RELATIVE_TOLERANCE
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.linkage.recording import Recording

Reduction = Callable[[Chain, Recording], Any]
"""Function that computes the result for a chain from a recording of this chain."""

_ROTORS_TOGETHER = 640
"""Largest number of rotors in one batch of chains [1]. One core simulates a batch, so that an
ensemble with fewer rotors in total uses only one core. Sensitivity for 256 chains of 20 rotors
with an error of 1e-5 rad: at 0.25x, 0.5x and 2x, the computation takes 1.4, 1.2 and 0.9 times as
long as at 1x. With smaller errors, these three times differ from that at 1x by less than 15 %."""
_EQUAL = ('friction_rate', 'on_site_order', 'on_site_phase')
"""Parameters of force terms that must have the same value in all chains of a batch."""
_SWITCHES = {
    'damping': 'dampings',
    'dry_friction': 'dry_frictions',
    'quadratic_damping': 'quadratic_dampings',
    'non_reciprocity': 'non_reciprocities',
    'on_site_torque': 'on_site_torques',
}
"""Chain parameters whose force term is absent if the parameter is 0. The value of each entry is
the name of the `Chain` array that contains this parameter for all rotors or springs."""
_OF_SPRINGS = {'spacings': [0.0], 'offsets': [0.0], 'rest_lengths': [1e9], 'stiffnesses': [0.0]}
"""`Chain` arrays with one value per spring. Each entry contains the value of the springs that
connect two chains in `joined`. The loop for the spring torques divides by the ratio of length l
and rest length lbar, even if the stiffness is 0. It computes l^2 / lbar^2 as 1 plus terms with the
factor 1 / lbar^2. With the huge rest length, the ratio is therefore 1, never 0."""


def joined(chains: Sequence[Chain]) -> Chain:
    """Return one chain that consists of several chains, which springs of stiffness 0 connect.

    The given chains have free ends and the same force terms.
    """
    first = chains[0]
    if len(chains) == 1:
        return first
    count = sum(chain.number_of_rotors for chain in chains)
    whole = replace(first, number_of_rotors=count, deviations=NO_DEVIATIONS)
    # The arrays of a chain are cached properties. A value in `vars(chain)` replaces the property.
    separators = {'rotor_lengths': [], 'masses': [], 'signs': [], **_OF_SPRINGS}
    for name, array in _SWITCHES.items():
        if getattr(first, name):
            separators[array] = [0.0] if name == 'non_reciprocity' else []
    for name, separator in separators.items():
        parts = [part for chain in chains for part in (getattr(chain, name), separator)]
        vars(whole)[name] = np.concatenate(parts[:-1])
    return whole


def last_state(chain: Chain, recording: Recording) -> Array:
    """Return angles [rad] and rates [rad/s] of the last frame, shape (2, N)."""
    del chain
    return np.array([recording.angles[-1], recording.rates[-1]])


def simulate_many(
    chains: Chain | Iterable[Chain],
    starts: Iterable[State],
    duration: float,
    *,
    frames: int = 1,
    reduce: Reduction = last_state,
    tolerance: float = 1e-11,
    executor: Executor | None = None,
) -> Iterator[Any]:
    """Simulate many chains for `duration` [s], and yield the result for each chain in order.

    `chains` is one chain for all initial states in `starts`, or contains one chain for each state.
    `reduce` computes the result from a recording, which contains the initial state and the states
    at `frames` equally spaced later times. Chains are simulated while the caller consumes the
    results. The work is done by threads on all cores, or by `executor`, for example
    `client.get_executor()` of Dask. In each step of the solver, the square root of the sum of the
    squared errors of all angles of a chain is at most `tolerance` [rad]. Successive chains with
    free ends and the same force terms are simulated in batches. Raises ArithmeticError if a solver
    fails, and ValueError for chains with feedback.

    >>> import soliton_linkage as sl
    >>> chains = [sl.Chain(number_of_rotors=8, stiffness=k) for k in (40.0, 50.0)]
    >>> starts = [sl.with_soliton(chain, 3.0, 0.1) for chain in chains]
    >>> [state.shape for state in sl.simulate_many(chains, starts, duration=0.5)]
    [(2, 8), (2, 8)]
    """
    if not (math.isfinite(duration) and duration > 0 and frames >= 1):
        raise ValueError(f'duration = {duration} s and frames = {frames} must be above 0')
    pairs = zip(repeat(chains) if isinstance(chains, Chain) else chains, starts, strict=False)
    work = partial(_move, duration=duration, frames=frames, reduce=reduce, tolerance=tolerance)
    SymplecticNystrom.load()
    return _streamed(work, _batches(pairs), executor)


def _batches(pairs: Iterator[tuple[Chain, State]]) -> Iterator[list[tuple[Chain, State]]]:
    batch: list[tuple[Chain, State]] = []
    room = _ROTORS_TOGETHER
    for pair in pairs:
        chain = pair[0]
        room -= chain.number_of_rotors
        if batch and (room < 0 or chain.periodic or _terms(chain) != _terms(batch[0][0])):
            yield batch
            batch, room = [], _ROTORS_TOGETHER - chain.number_of_rotors
        batch.append(pair)
    if batch:
        yield batch


def _terms(chain: Chain) -> tuple[Any, ...]:
    acting = (bool(getattr(chain, name)) for name in _SWITCHES)
    return (chain.periodic, *acting, *(getattr(chain, name) for name in _EQUAL))


def _streamed(
    work: Callable[[list[tuple[Chain, State]]], list[Any]],
    batches: Iterator[list[tuple[Chain, State]]],
    executor: Executor | None,
) -> Iterator[Any]:
    """Yield the results of batches in order, with at most two unfinished batches per core."""
    cores = os.cpu_count() or 1
    waiting: deque[Future[list[Any]]] = deque()
    with nullcontext(executor) if executor else ThreadPoolExecutor(cores) as pool:
        try:
            for batch in batches:
                waiting.append(pool.submit(work, batch))
                if len(waiting) >= 2 * cores:
                    yield from waiting.popleft().result()
            while waiting:
                yield from waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def _move(
    batch: list[tuple[Chain, State]],
    duration: float,
    frames: int,
    reduce: Reduction,
    tolerance: float,
) -> list[Any]:
    chains = [chain for chain, _ in batch]
    if any(chain.feedback.acts for chain in chains):
        raise ValueError(
            'simulate_many has no frames at which motors could measure; simulate chains with '
            'feedback by ElasticSimulation'
        )
    motion, times = EquationOfMotion(joined(chains)), np.linspace(0.0, duration, frames + 1)
    angles, rates = ([getattr(s, name) for _, s in batch] for name in ('angles', 'rates'))
    state = np.concatenate([*angles, *rates, [0.0] * motion.damped])
    rotors = motion.rotors
    solver = SymplecticNystrom(
        motion,
        0.0,
        state,
        duration,
        rtol=SMALLEST_RELATIVE_TOLERANCE,
        atol=absolute_tolerances(motion, 0.1 * tolerance),
    )
    states = np.empty((frames + 1, len(state)))
    states[0], done = state, 1
    while solver.status == 'running':
        complaint = solver.step()
        if complaint:
            raise ArithmeticError(f'a chain could not be integrated: {complaint}')
        passed = int(np.searchsorted(times[:-1], solver.t, side='right'))
        if passed > done:
            states[done:passed] = solver.dense_output()(times[done:passed]).T
            done = passed
    states[-1] = solver.y
    ends = np.cumsum([chain.number_of_rotors for chain in chains])
    return [
        reduce(
            chain, Recording(times, states[:, begin:end], states[:, rotors + begin : rotors + end])
        )
        for chain, begin, end in zip(chains, (0, *ends[:-1]), ends, strict=True)
    ]
