# SPDX-License-Identifier: Apache-2.0
"""Processes that measure the rows of a sweep: on this machine, or on a Dask cluster."""

from __future__ import annotations

import importlib
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from soliton_linkage_studies.sweep.table import Tabulated
from soliton_linkage_studies.workers import Pool, local_processes

_SECONDS_A_CHUNK = 1.0
"""What a chunk of rows takes [s]: handing it over costs a thousandth, an interrupt no more."""
_GROWTH = 4
"""Times that a chunk may be larger than the last, whose rows may have been quick ones."""
_CHUNKS_A_WORKER = 2
"""Under way: one is done while the next one waits."""
_CONNECTION_TIMEOUT = 10
"""For a scheduler to answer [s]."""

Chunk = tuple[list[list[str]], list[int], float]


@dataclass(frozen=True)
class Workers:
    """Where chunks of rows are measured, and how many at a time."""

    pool: Pool
    count: int

    def measured(self, study: Tabulated, rows: Sequence[int]) -> Iterator[list[list[str]]]:
        """Yield the cells of the rows of a sweep in chunks, whichever is finished first.

        A chunk takes about a second, however long a row does.
        """
        waiting = deque(rows)
        finished = self.pool.finished()
        running = 0
        size = 1
        while waiting or running:
            while waiting and running < _CHUNKS_A_WORKER * self.count:
                fair = math.ceil(len(waiting) / self.count)
                chunk = [waiting.popleft() for _ in range(min(size, fair))]
                self.pool.submit(measure_rows, study, chunk)
                running += 1
            result: Chunk = next(finished).result()
            running -= 1
            cells, left, seconds = result
            waiting.extendleft(reversed(left))
            wanted = len(cells) * _SECONDS_A_CHUNK / max(seconds, 1e-9)
            size = max(1, min(_GROWTH * len(cells), int(wanted)))
            yield cells


def measure_rows(study: Tabulated, rows: list[int]) -> Chunk:
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
    """Processes on this machine; where the sweep fails they end at once."""
    with local_processes(count) as processes:
        yield Workers(processes, count)


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
        yield Workers(_Cluster(client, distributed.as_completed(loop=client.loop)), count)


class _Cluster:
    """Does tasks on a Dask cluster."""

    def __init__(self, client: Any, completed: Any) -> None:
        self._client = client
        self._completed = completed

    def submit(self, task: Callable[..., Any], /, *arguments: Any) -> Any:
        future = self._client.submit(task, *arguments, pure=False)
        self._completed.add(future)
        return future

    def finished(self) -> Iterator[Any]:
        return iter(self._completed)
