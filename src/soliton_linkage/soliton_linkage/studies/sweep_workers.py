# SPDX-License-Identifier: Apache-2.0
"""Processes that measure the rows of a sweep: on this machine, or on a Dask cluster."""

from __future__ import annotations

import importlib
import math
import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from soliton_linkage.studies.sweep_config import Study

_SECONDS_A_CHUNK = 1.0
_GROWTH = 4
_CHUNKS_A_WORKER = 2
_CONNECTION_TIMEOUT = 10
_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')

Chunk = tuple[list[list[str]], list[int], float]


@dataclass(frozen=True)
class Workers:
    """Where chunks of rows are measured, and how many at a time."""

    executor: Executor
    count: int

    def measured(self, study: Study, rows: Sequence[int]) -> Iterator[list[list[str]]]:
        """Yield the cells of the rows of a sweep in chunks, whichever is finished first.

        A chunk takes about a second, however long a row does.
        """
        waiting = deque(rows)
        running: set[Future[Chunk]] = set()
        size = 1
        while waiting or running:
            while waiting and len(running) < _CHUNKS_A_WORKER * self.count:
                fair = math.ceil(len(waiting) / self.count)
                chunk = [waiting.popleft() for _ in range(min(size, fair))]
                with _interrupts_held():
                    running.add(self.executor.submit(measure_rows, study, chunk))
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                cells, left, seconds = future.result()
                waiting.extendleft(reversed(left))
                wanted = len(cells) * _SECONDS_A_CHUNK / max(seconds, 1e-9)
                size = max(1, min(_GROWTH * len(cells), int(wanted)))
                yield cells


def measure_rows(study: Study, rows: list[int]) -> Chunk:
    """Measure rows of a sweep until about a second is over.

    Returns the cells of one row or more, the rows that are left, and the time that it took [s].
    """
    begin = time.perf_counter()
    cells: list[list[str]] = []
    for row in rows:
        cells.append(study.cells(row))
        if time.perf_counter() - begin > _SECONDS_A_CHUNK:
            break
    return cells, rows[len(cells) :], time.perf_counter() - begin


@contextmanager
def local_workers(count: int) -> Iterator[Workers]:
    """Processes on this machine, each of one thread; where the sweep fails they end at once."""
    before = {name: os.environ.get(name) for name in _THREADS}
    others = set(multiprocessing.active_children())
    os.environ.update(dict.fromkeys(_THREADS, '1'))
    executor = ProcessPoolExecutor(
        count, multiprocessing.get_context('spawn'), initializer=_end_with_parent
    )
    try:
        yield Workers(executor, count)
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - others:
            process.kill()
            process.join()
        raise
    finally:
        executor.shutdown()
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def cluster_workers(address: str) -> Iterator[Workers]:
    """Workers of a Dask cluster that runs already, at the address of its scheduler.

    Raises ValueError where `distributed` is not installed or nothing answers.
    """
    try:
        distributed: Any = importlib.import_module('distributed')
    except ImportError:
        raise ValueError(
            f'--scheduler {address} needs the package distributed, which is not installed; '
            'pip install distributed, or use --workers'
        ) from None
    try:
        client = distributed.Client(address, timeout=_CONNECTION_TIMEOUT)
    except (OSError, ValueError) as error:
        raise ValueError(
            f'--scheduler {address} does not answer ({error}); start it with dask scheduler, or '
            'use --workers'
        ) from None
    with client:
        count = sum(client.nthreads().values())
        if not count:
            raise ValueError(f'--scheduler {address} has no worker; start one with dask worker')
        yield Workers(client.get_executor(), count)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back, also from processes that are started meanwhile, whose parent gets it."""
    held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended, however it did."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_outlive, args=(parent,), daemon=True).start()


def _outlive(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
