# SPDX-License-Identifier: Apache-2.0
"""Chains that are simulated together move as each of them alone."""

from collections.abc import Iterator
from concurrent.futures import Executor, Future
from typing import Any

import numpy as np
import pytest

import soliton_linkage as sl
from soliton_linkage.dynamics.ensemble import simulate_many

DURATION = 0.6


def chain(number: int, rotors: int = 9, **parameters: Any) -> sl.Chain:
    lengths = tuple(np.random.default_rng(number).normal(0, 0.02, rotors))
    return sl.Chain(
        number_of_rotors=rotors, deviations=sl.Deviations(rotor_length=lengths), **parameters
    )


def start(of: sl.Chain) -> sl.State:
    angles = sl.leaning(of, -1).angles
    return sl.State(angles, 10 * sl.edge_mode(of, angles, sl.Edge.FIRST))


def alone(of: sl.Chain, frames: int) -> sl.Recording:
    begin = start(of)
    return sl.simulate(of, begin.angles, begin.rates, DURATION, DURATION / frames)


ACTIVE = {
    'non_reciprocity': 1e-4,
    'damping': 1e-4,
    'quadratic_damping': 1e-6,
    'on_site_torque': 1e-5,
}


@pytest.mark.parametrize('parameters', [{}, ACTIVE])
def test_chains_of_any_length_move_together_as_alone(parameters):
    chains = [chain(n, rotors, **parameters) for n, rotors in enumerate((9, 2, 30, 9, 600, 9))]
    recordings = simulate_many(
        chains, map(start, chains), DURATION, frames=5, reduce=lambda _, recording: recording
    )
    for each, recording in zip(chains, recordings, strict=True):
        expected = alone(each, 5)
        np.testing.assert_allclose(recording.times, expected.times)
        np.testing.assert_allclose(recording.angles, expected.angles, atol=1e-8)
        np.testing.assert_allclose(recording.rates, expected.rates, atol=1e-6)


def test_the_default_result_is_the_last_state_of_each_start_of_one_chain():
    one = chain(0)
    found = np.array(list(simulate_many(one, [start(one)] * 3, DURATION)))
    expected = alone(one, 1)
    assert found.shape == (3, 2, 9)
    np.testing.assert_allclose(found[1, 0], expected.angles[-1], atol=1e-8)


class Counting(Executor):
    """Executor that computes at once and counts its tasks."""

    tasks = 0

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        self.tasks += 1
        future: Future[Any] = Future()
        future.set_result(function(*arguments, **named))
        return future


def test_an_endless_stream_of_chains_is_read_as_results_are_consumed():
    read = 0

    def endless() -> Iterator[sl.Chain]:
        nonlocal read
        while True:
            read += 1
            yield chain(read, 160)

    one, pool = chain(1, 160), Counting()
    results = simulate_many(endless(), iter(lambda: start(one), None), 0.01, executor=pool)
    for _ in range(3):
        next(results)
    assert 3 <= read <= 4 * (pool.tasks + 1)
    results.close()


def test_chains_with_other_terms_or_ends_move_in_one_call():
    others = [{}, {'damping': 1e-4}, {'damping': 1e-4, 'on_site_phase': 0.1}, {}]
    chains = [chain(n, **each) for n, each in enumerate(others)]
    found = simulate_many(chains, map(start, chains), DURATION)
    for each, (angles, _) in zip(chains, found, strict=True):
        np.testing.assert_allclose(angles, alone(each, 1).angles[-1], atol=1e-8)


def test_periodic_chains_move_as_alone():
    one = sl.Chain(number_of_rotors=8, periodic=True)
    rates = np.random.default_rng(1).normal(size=8)
    begin = sl.State(one.uniform_state(-1), rates)
    (found, _) = simulate_many(one, [begin] * 2, 0.2)
    expected = sl.simulate(one, begin.angles, rates, 0.2, 0.2)
    np.testing.assert_allclose(found[0], expected.angles[-1], atol=1e-8)
