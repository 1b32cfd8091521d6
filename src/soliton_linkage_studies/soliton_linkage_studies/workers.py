# SPDX-License-Identifier: Apache-2.0
"""Parallel tasks in processes on this machine or on the workers of a Dask cluster."""

from __future__ import annotations

import argparse
import importlib
import math
import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, cast

_ONE_THREAD = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), '1')
_MAXIMUM_COUNT = 1000
"""Largest number of processes [1]; a larger number is probably a typing error."""
_INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
_CHUNK_DURATION = 1.0
"""Approximate duration of a task [s], short because a task that fails loses all its rows."""
_CHUNK_GROWTH = 4
"""Largest growth of the number of rows per task [1], because the first rows may be unusually
fast."""
_CHUNKS_PER_WORKER = 2
"""Number of submitted tasks per worker [1]: one task runs while the next one waits."""

Chunk = tuple[list[list[str]], list[int], float]


class Rows(Protocol):
    """A table whose rows are measured one by one."""

    def cells(self, row: int) -> list[str]:
        """Measure a row and return its cells."""


class Processes:
    """Worker processes on this machine, which `local_processes` creates.

    Each process has its own pipe and shares no thread and no lock with the parent. Therefore the
    parent can be interrupted, and a process killed, at any time. The alternatives are slower.
    `ProcessPoolExecutor` and loky 3.7 had not ended 60 s after Ctrl-C. `distributed.LocalCluster`
    2026.8 takes 3.2 s to start and 13 s to end; this class starts in 0.25 s.
    """

    def __init__(self) -> None:
        self._processes: dict[Connection, BaseProcess] = {}
        self._idle: list[Connection] = []
        self._busy: dict[Connection, Future[Any]] = {}
        self._waiting: deque[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = deque()

    @property
    def count(self) -> int:
        """Number of processes."""
        return len(self._processes)

    def start(self, count: int) -> None:
        """Start single-threaded processes."""
        context = multiprocessing.get_context('spawn')
        # Start the resource tracker of multiprocessing before SIGINT is blocked. Otherwise it
        # would start with the first process and unblock SIGINT, so that the processes would
        # receive Ctrl-C.
        resource_tracker.ensure_running()
        with defer_interrupts(), _environment(_ONE_THREAD):
            for _ in range(count):
                ours, theirs = context.Pipe()
                process = context.Process(target=_work, args=(theirs,))
                process.start()
                theirs.close()
                self._processes[ours] = process
        self._idle = list(self._processes)

    def submit(self, task: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        """Queue a task. Raises ChildProcessError if a process has ended unexpectedly."""
        future: Future[Any] = Future()
        self._waiting.append((future, task, arguments))
        self._assign()
        return future

    def finished(self) -> Iterator[Future[Any]]:
        """Yield the future of each task as soon as the task has ended.

        Raises ChildProcessError if a process has ended unexpectedly.
        """
        while self._busy:
            connection = cast(Connection, wait(list(self._busy))[0])
            try:
                result, error, trace = connection.recv()
            except (EOFError, OSError):
                raise self._failure(connection) from None
            future = self._busy.pop(connection)
            self._idle.append(connection)
            self._assign()
            if error:
                error.__cause__ = _RemoteError(trace)
                future.set_exception(error)
            else:
                future.set_result(result)
            yield future

    def end(self, kill: bool = False) -> None:
        """End the processes after their current tasks, or at once if `kill` is true."""
        for process in self._processes.values() if kill else ():
            process.kill()
        for connection, process in self._processes.items():
            connection.close()
            process.join()

    def _assign(self) -> None:
        while self._waiting and self._idle:
            future, task, arguments = self._waiting.popleft()
            connection = self._idle.pop()
            self._busy[connection] = future
            try:
                connection.send((task, arguments))
            except OSError:
                raise self._failure(connection) from None

    def _failure(self, connection: Connection) -> ChildProcessError:
        process = self._processes[connection]
        process.join()
        code, how = process.exitcode or 0, f'ended with {process.exitcode}'
        if code < 0:
            how = f'was ended by a signal ({signal.strsignal(-code)})'
        advice = '; if memory ran out, use fewer --workers' if code == -signal.SIGKILL else ''
        return ChildProcessError(f'process {process.pid} {how} before its task was done{advice}')


def process_count(text: str) -> int:
    """Parse a number of processes from 1 to 1000. Raises ArgumentTypeError for another text."""
    count = int(text) if text.isdecimal() and text.isascii() else 0
    if not 1 <= count <= _MAXIMUM_COUNT:
        raise argparse.ArgumentTypeError(
            f'{text!r} must be a whole number from 1 to {_MAXIMUM_COUNT}'
        )
    return count


@contextmanager
def local_processes(count: int) -> Iterator[Processes]:
    """Start single-threaded processes for the duration of a `with` block.

    At the end of the block, the processes finish all tasks and end. If the block raises or the
    parent is killed, they end at once. Only the parent receives Ctrl-C.
    """
    processes = Processes()
    try:
        processes.start(count)
        yield processes
        for _ in processes.finished():
            pass
        processes.end()
    except BaseException:
        with defer_interrupts():
            processes.end(kill=True)
        raise


@contextmanager
def cluster(address: str, timeout: float = 10.0) -> Iterator[Pool]:
    """Connect to a running Dask cluster whose scheduler has the given address.

    Raises ValueError if the package `distributed` is not installed, if the scheduler does not
    answer within the timeout [s], or if the cluster has no worker.
    """
    try:
        distributed: Any = importlib.import_module('distributed')
    except ImportError:
        raise ValueError(
            f'--scheduler {address} needs the package distributed, which is not installed; run '
            'pip install distributed, or use --workers'
        ) from None
    try:
        client = distributed.Client(address, timeout=timeout)
    except (OSError, ValueError) as error:
        raise ValueError(
            f'--scheduler {address} does not answer ({error}); start it with dask scheduler, or '
            'use --workers'
        ) from None
    with client:
        count = sum(client.nthreads().values())
        if not count:
            raise ValueError(f'--scheduler {address} has no worker; start one with dask worker')
        yield _Cluster(client, distributed.as_completed(loop=client.loop), count)


@dataclass(frozen=True)
class _Cluster:
    client: Any
    completed: Any
    count: int

    def submit(self, task: Callable[..., Any], /, *arguments: Any) -> Any:
        future = self.client.submit(task, *arguments, pure=False)
        self.completed.add(future)
        return future

    def finished(self) -> Iterator[Any]:
        return iter(self.completed)


Pool = Processes | _Cluster
"""Workers that run tasks in parallel."""


def measure_rows(pool: Pool, table: Rows, rows: Sequence[int]) -> Iterator[list[list[str]]]:
    """Measure rows in parallel; whenever a task ends, yield the cells of its rows."""
    waiting = deque(rows)
    finished = pool.finished()
    running, size = 0, 1
    while waiting or running:
        while waiting and running < _CHUNKS_PER_WORKER * pool.count:
            equal_share = math.ceil(len(waiting) / pool.count)
            chunk = [waiting.popleft() for _ in range(min(size, equal_share))]
            pool.submit(measure_chunk, table, chunk)
            running += 1
        result: Chunk = next(finished).result()
        running -= 1
        cells, remaining, seconds = result
        waiting.extendleft(reversed(remaining))
        best = int(len(cells) * _CHUNK_DURATION / max(seconds, 1e-9))
        size = max(1, min(_CHUNK_GROWTH * len(cells), best))
        yield cells


def measure_chunk(table: Rows, rows: list[int]) -> Chunk:
    """Measure `rows` one by one, and stop after about a second.

    Returns the cells of the measured rows, the rows that were not measured, and the duration [s].
    """
    begin, cells = time.perf_counter(), list[list[str]]()
    for row in rows:
        cells.append(table.cells(row))
        if time.perf_counter() - begin > _CHUNK_DURATION:
            break
    return cells, rows[len(cells) :], time.perf_counter() - begin


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Defer SIGINT and SIGTERM to the end of a `with` block.

    In processes that start in the block, SIGINT stays blocked.
    """
    received: list[int] = []
    # It is not sufficient to block the signals in this thread, because another thread can receive
    # them.
    handlers = [
        signal.signal(each, lambda *call: received.append(call[0])) for each in _INTERRUPTS
    ]
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in zip(_INTERRUPTS, handlers, strict=True):
            signal.signal(number, handler)
        for each in received:
            signal.raise_signal(each)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        for name in values.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


class _RemoteError(Exception):
    def __str__(self) -> str:
        return f'\n{self.args[0]}'


def _work(connection: Connection) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, ConnectionError):
        while True:
            connection.send(_run(connection.recv_bytes()))


def _run(order: bytes) -> tuple[Any, Exception | None, str]:
    try:
        task, arguments = pickle.loads(order)
        return task(*arguments), None, ''
    except Exception as error:
        return None, error, traceback.format_exc()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    signal.raise_signal(signal.SIGKILL)
