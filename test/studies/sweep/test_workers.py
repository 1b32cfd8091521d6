# SPDX-License-Identifier: Apache-2.0
"""Chunks take about a second, hold each row once, and processes end with the sweep."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any

import pytest

from soliton_linkage_studies.sweep import workers as sweep_workers
from soliton_linkage_studies.sweep.config import Axis, SweepStudy
from soliton_linkage_studies.sweep.workers import (
    Workers,
    cluster_workers,
    local_workers,
    measure_rows,
)

ANGLES = tuple(0.1 + 0.01 * number for number in range(100))
STUDY = SweepStudy(
    'mine', 'motion', {'number_of_rotors': 5}, (Axis('rest_angle', ANGLES),), (0, 1)
)


class Clock:
    """Stands in for the module time: each row takes the seconds that are given for it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, seconds: list[float]) -> None:
        self.now = 0.0

        def cells(_study: SweepStudy, row: int) -> list[str]:
            self.now += seconds[row]
            return [str(row)]

        monkeypatch.setattr(sweep_workers, 'time', self)
        monkeypatch.setattr(SweepStudy, 'cells', cells)

    def perf_counter(self) -> float:
        return self.now


class Here:
    """Runs what is submitted at once, in this thread."""

    def __init__(self) -> None:
        self.chunks: list[tuple[int, float]] = []
        self.done: list[Future[Any]] = []

    def submit(self, task: Any, /, *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        result = task(*arguments)
        self.chunks.append((len(result[0]), result[2]))
        future.set_result(result)
        self.done.append(future)
        return future

    def finished(self) -> Iterator[Future[Any]]:
        while self.done:
            yield self.done.pop()


@pytest.mark.parametrize('seconds', [0.001, 0.1, 5.0])
def test_a_chunk_takes_about_a_second_or_one_row(
    seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    Clock(monkeypatch, [seconds] * STUDY.rows)
    pool = Here()
    done = list(Workers(pool, 2).measured(STUDY, range(STUDY.rows)))
    assert sorted(int(row[0]) for cells in done for row in cells) == list(range(STUDY.rows))
    longest = max(spent for _, spent in pool.chunks)
    assert longest <= max(1.0, seconds) + seconds
    if seconds == 0.1:
        assert sum(count for count, _ in pool.chunks if count > 5) > STUDY.rows / 2


def test_rows_that_turn_out_slow_leave_their_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    Clock(monkeypatch, [0.001] * 100 + [3.0] * 100)
    pool = Here()
    done = list(Workers(pool, 2).measured(STUDY, range(STUDY.rows)))
    assert sorted(int(row[0]) for cells in done for row in cells) == list(range(STUDY.rows))
    assert max(spent for _, spent in pool.chunks) <= 1 + 3


def test_processes_measure_what_this_one_does_with_one_thread_each() -> None:
    before = dict(os.environ)
    with local_workers(2) as workers:
        done = list(workers.measured(STUDY, [5, 3, 8]))
        workers.pool.submit(os.getenv, 'OMP_NUM_THREADS')
        threads = next(workers.pool.finished()).result()
    expected = measure_rows(STUDY, [3, 5, 8])[0]
    assert sorted(row for cells in done for row in cells) == sorted(expected)
    assert threads == '1'
    assert dict(os.environ) == before
    assert not multiprocessing.active_children()


def test_ctrl_c_is_left_to_the_parent_of_the_processes() -> None:
    with local_workers(1) as workers:
        list(workers.measured(STUDY, [0]))
        workers.pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ())
        held = next(workers.pool.finished()).result()
    assert signal.SIGINT in held
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_processes_end_at_once_where_the_sweep_fails() -> None:
    def sweep() -> None:
        with local_workers(1) as workers:
            workers.pool.submit(time.sleep, 600)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        sweep()
    assert not multiprocessing.active_children()


def test_rows_measured_by_a_cluster_are_the_same() -> None:
    distributed = pytest.importorskip('distributed')
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=':0'
    )
    with cluster, cluster_workers(cluster.scheduler_address) as workers:
        assert workers.count == 2
        done = list(workers.measured(STUDY, range(10)))
    assert sorted(int(row[0]) for cells in done for row in cells) == list(range(10))
    for cells in done:
        assert cells == measure_rows(STUDY, [int(row[0]) for row in cells])[0]


def test_a_cluster_that_does_not_answer_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip('distributed')
    monkeypatch.setattr(sweep_workers, '_CONNECTION_TIMEOUT', 0.5)
    complaint = r'--scheduler tcp://127.0.0.1:9 does not answer'
    with pytest.raises(ValueError, match=complaint), cluster_workers('tcp://127.0.0.1:9'):
        pass


def test_without_the_package_a_cluster_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'distributed', None)
    complaint = 'not installed; pip install distributed, or use --workers'
    with pytest.raises(ValueError, match=complaint), cluster_workers('tcp://127.0.0.1:9'):
        pass
