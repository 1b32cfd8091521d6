# SPDX-License-Identifier: Apache-2.0
"""Processes that work side by side, on this machine or on a Dask cluster."""

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

_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
_MOST = 1000
"""Processes that may be asked for; more are a typing error."""
_INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
_SECONDS_A_CHUNK = 1.0
"""Duration of a chunk of rows [s]: sending it takes a thousandth, an interrupt loses no more."""
_GROWTH = 4
"""Largest ratio of the sizes of successive chunks, because the first rows may be fast ones [1]."""
_CHUNKS_A_WORKER = 2
"""Chunks in progress for each worker: one is measured while the next one waits [1]."""
_CONNECTION_TIMEOUT = 10
"""Longest wait for the answer of a scheduler [s]."""

Chunk = tuple[list[list[str]], list[int], float]


class Rows(Protocol):
    """A table whose rows are measured one by one."""

    def cells(self, row: int) -> list[str]:
        """Measure a row."""


class Pool(Protocol):
    """Workers that do tasks side by side."""

    @property
    def count(self) -> int:
        """Number of workers."""

    def submit(self, task: Callable[..., Any], /, *arguments: Any) -> Any:
        """Queue a task; returns the future of its result."""

    def finished(self) -> Iterator[Any]:
        """Yield futures as their tasks finish, including tasks that are submitted meanwhile."""


class Processes:
    """Processes on this machine, made by `local_processes`.

    Each has a pipe of its own, and neither a thread nor a lock stands between it and its parent,
    so that the parent may be interrupted, and a process killed, at any moment.
    `concurrent.futures.ProcessPoolExecutor` and `loky` 3.7 had not ended 60 s after an interrupt
    while results of 200 kB were sent.
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

    @property
    def unfinished(self) -> int:
        """Number of tasks that `next_finished` has not returned yet."""
        return len(self._waiting) + len(self._busy)

    def start(
        self, count: int, prepare: Callable[..., None] | None, arguments: tuple[Any, ...]
    ) -> None:
        """Start processes of one thread each, which call a function first."""
        context = multiprocessing.get_context('spawn')
        # Started with the first process, it would let Ctrl-C through to that one.
        resource_tracker.ensure_running()
        with defer_interrupts(), _one_thread():
            for _ in range(count):
                ours, theirs = context.Pipe()
                process = context.Process(target=_work, args=(theirs, prepare, arguments))
                process.start()
                theirs.close()
                self._processes[ours] = process
        self._idle = list(self._processes)

    def submit(self, task: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        """Queue a task; raises ChildProcessError if a process has ended."""
        future: Future[Any] = Future()
        self._waiting.append((future, task, arguments))
        self._hand_out()
        return future

    def finished(self) -> Iterator[Future[Any]]:
        """Yield futures as their tasks finish, including tasks that are submitted meanwhile."""
        while self.unfinished:
            future = self.next_finished()
            if future:
                yield future

    def next_finished(self, timeout: float | None = None) -> Future[Any] | None:
        """Return the next finished task, or None after a timeout [s].

        Raises ChildProcessError if a process has ended.
        """
        ready = wait(list(self._busy), timeout)
        if not ready:
            return None
        connection = cast(Connection, ready[0])
        try:
            result, error, trace = connection.recv()
        except (EOFError, OSError):
            raise self._loss(connection) from None
        future = self._busy.pop(connection)
        self._idle.append(connection)
        self._hand_out()
        if error:
            error.__cause__ = _RemoteError(trace)
            future.set_exception(error)
        else:
            future.set_result(result)
        return future

    def end(self, kill: bool = False) -> None:
        """End the processes: after their tasks, or at once."""
        for process in self._processes.values() if kill else ():
            process.kill()
        for connection, process in self._processes.items():
            connection.close()
            process.join()

    def _hand_out(self) -> None:
        while self._waiting and self._idle:
            future, task, arguments = self._waiting.popleft()
            connection = self._idle.pop()
            self._busy[connection] = future
            try:
                connection.send((task, arguments))
            except OSError:
                raise self._loss(connection) from None

    def _loss(self, connection: Connection) -> ChildProcessError:
        process = self._processes[connection]
        process.join()
        code = process.exitcode or 0
        how = f'ended with {code}' if code >= 0 else f'was ended: {signal.strsignal(-code)},'
        remark = '; where memory ran out, use fewer --workers' if code == -signal.SIGKILL else ''
        return ChildProcessError(f'process {process.pid} {how} before its task was done{remark}')


def process_count(text: str) -> int:
    """Parse a number of processes; raises ArgumentTypeError for any other text."""
    count = int(text) if text.isdecimal() and text.isascii() else 0
    if not 1 <= count <= _MOST:
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number from 1 to {_MOST}')
    return count


@contextmanager
def local_processes(
    count: int, prepare: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
) -> Iterator[Processes]:
    """Start processes of one thread each, which may call a function first.

    They end when the body of the `with` ends, after all tasks; at once when it fails or their
    parent is killed. Ctrl-C reaches their parent alone.
    """
    processes = Processes()
    try:
        processes.start(count, prepare, arguments)
        yield processes
        for _ in processes.finished():
            pass
        processes.end()
    except BaseException:
        with defer_interrupts():
            processes.end(kill=True)
        raise


@contextmanager
def cluster(address: str) -> Iterator[Pool]:
    """Connect to the workers of a running Dask cluster, by the address of its scheduler.

    Raises ValueError if `distributed` is not installed or nothing answers.
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


def measure_rows(pool: Pool, table: Rows, rows: Sequence[int]) -> Iterator[list[list[str]]]:
    """Yield the cells of rows of a table in chunks of about a second, as they are finished."""
    waiting = deque(rows)
    finished = pool.finished()
    running, size = 0, 1
    while waiting or running:
        while waiting and running < _CHUNKS_A_WORKER * pool.count:
            fair = math.ceil(len(waiting) / pool.count)
            chunk = [waiting.popleft() for _ in range(min(size, fair))]
            pool.submit(measure_chunk, table, chunk)
            running += 1
        result: Chunk = next(finished).result()
        running -= 1
        cells, left, seconds = result
        waiting.extendleft(reversed(left))
        wanted = len(cells) * _SECONDS_A_CHUNK / max(seconds, 1e-9)
        size = max(1, min(_GROWTH * len(cells), int(wanted)))
        yield cells


def measure_chunk(table: Rows, rows: list[int]) -> Chunk:
    """Measure at least one row, and more for about a second.

    Returns the cells of the measured rows, the rows that remain, and the duration [s].
    """
    begin = time.perf_counter()
    cells: list[list[str]] = []
    for row in rows:
        cells.append(table.cells(row))
        if time.perf_counter() - begin > _SECONDS_A_CHUNK:
            break
    return cells, rows[len(cells) :], time.perf_counter() - begin


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Delay Ctrl-C and SIGTERM, and block Ctrl-C for good in processes started meanwhile."""
    came: list[int] = []
    # A mask is not enough, because another thread may receive a signal for this one.
    handlers = [
        signal.signal(number, lambda *call: came.append(call[0])) for number in _INTERRUPTS
    ]
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in zip(_INTERRUPTS, handlers, strict=True):
            signal.signal(number, handler)
        for each in came:
            signal.raise_signal(each)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit the processes that are started meanwhile to one thread each."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, '1'))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class _RemoteError(Exception):
    """Traceback of another process, as text."""

    def __str__(self) -> str:
        return f'\n{self.args[0]}'


def _work(
    connection: Connection, prepare: Callable[..., None] | None, arguments: tuple[Any, ...]
) -> None:
    """Do tasks until the parent closes the pipe; end as soon as the parent has ended."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if prepare:
        prepare(*arguments)
    with suppress(EOFError, ConnectionError):
        while True:
            connection.send(_outcome(connection.recv_bytes()))


def _outcome(order: bytes) -> tuple[Any, Exception | None, str]:
    """Return the result of a task, or its error and traceback."""
    try:
        task, arguments = pickle.loads(order)
        return task(*arguments), None, ''
    except Exception as error:
        return None, error, traceback.format_exc()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
