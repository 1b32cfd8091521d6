# SPDX-License-Identifier: Apache-2.0
"""Processes that work side by side and never outlive the one that started them."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, cast

_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
_MOST = 1000
"""Processes that may be asked for; more are a typing error."""
_INTERRUPTS = (signal.SIGINT, signal.SIGTERM)


class Pool(Protocol):
    """What does tasks side by side."""

    def submit(self, task: Callable[..., Any], /, *arguments: Any) -> Any:
        """Have a task done, after those before it; returns what will hold its `result()`."""

    def finished(self) -> Iterator[Any]:
        """Yield what `submit` returned as the tasks finish, those submitted meanwhile too."""


class Processes:
    """Processes on this machine that do tasks; made by `local_processes`.

    Neither a thread nor a lock stands between them and their parent, which may therefore be
    interrupted, and they killed, at any moment. A `ProcessPoolExecutor` then waits forever for the
    rest of a result, or for a lock that an interrupted `as_completed` has left taken.
    """

    def __init__(self) -> None:
        self._processes: dict[Connection, BaseProcess] = {}
        self._idle: list[Connection] = []
        self._busy: dict[Connection, Future[Any]] = {}
        self._waiting: deque[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = deque()

    @property
    def unfinished(self) -> int:
        """Number of tasks that `next_finished` has not returned yet."""
        return len(self._waiting) + len(self._busy)

    def start(
        self, count: int, prepare: Callable[..., None] | None, arguments: tuple[Any, ...]
    ) -> None:
        """Start processes of one thread each, which are prepared by a function."""
        context = multiprocessing.get_context('spawn')
        # Started with the first process, it would let Ctrl-C through to that one.
        resource_tracker.ensure_running()
        with interrupts_held(), _one_thread():
            for _ in range(count):
                ours, theirs = context.Pipe()
                process = context.Process(target=_work, args=(theirs, prepare, arguments))
                process.start()
                theirs.close()
                self._processes[ours] = process
        self._idle = list(self._processes)

    def submit(self, task: Callable[..., Any], /, *arguments: Any) -> Future[Any]:
        """Have a task done, after those before it; it is done when `next_finished` returns it.

        Raises ChildProcessError where a process has ended.
        """
        future: Future[Any] = Future()
        self._waiting.append((future, task, arguments))
        self._hand_out()
        return future

    def finished(self) -> Iterator[Future[Any]]:
        """Yield tasks as they finish, those submitted meanwhile too."""
        while self.unfinished:
            future = self.next_finished()
            if future:
                yield future

    def next_finished(self, timeout: float | None = None) -> Future[Any] | None:
        """Wait for a task to finish, or for a time [s]; return None where none has.

        Raises ChildProcessError where a process has ended.
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

    def end(self) -> None:
        """Wait for all tasks, and let the processes end."""
        for _ in self.finished():
            pass
        for connection, process in self._processes.items():
            connection.close()
            process.join()

    def kill(self) -> None:
        """End the processes at once."""
        for process in self._processes.values():
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
    """Number of processes that a command line says; raises ArgumentTypeError for what is none."""
    count = int(text) if text.isdecimal() and text.isascii() else 0
    if not 1 <= count <= _MOST:
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number from 1 to {_MOST}')
    return count


@contextmanager
def local_processes(
    count: int, prepare: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
) -> Iterator[Processes]:
    """Processes on this machine, each of one thread, which may be prepared by a function.

    They end at once where the body of the `with` fails, and when their parent is killed. Ctrl-C
    reaches their parent alone.
    """
    processes = Processes()
    try:
        processes.start(count, prepare, arguments)
        yield processes
        processes.end()
    except BaseException:
        with interrupts_held():
            processes.kill()
        raise


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C and SIGTERM back, and Ctrl-C forever from processes started meanwhile."""
    came: list[int] = []
    # To block signals is not enough: another thread may take one, and this one acts on it.
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
    """Have the processes that are started meanwhile use one thread each."""
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
    """Where in another process an error was raised, as text."""

    def __str__(self) -> str:
        return f'\n{self.args[0]}'


def _work(
    connection: Connection, prepare: Callable[..., None] | None, arguments: tuple[Any, ...]
) -> None:
    """Do what comes, until the parent has no more of it; end as soon as it has ended."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if prepare:
        prepare(*arguments)
    with suppress(EOFError, ConnectionError):
        while True:
            connection.send(_outcome(connection.recv_bytes()))


def _outcome(order: bytes) -> tuple[Any, Exception | None, str]:
    """Result of a task, or what it raised and where."""
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
