# SPDX-License-Identifier: Apache-2.0
"""Processes that work side by side and never outlive the one that started them."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
_MOST = 1000


def process_count(text: str) -> int:
    """Number of processes that a command line says; raises ArgumentTypeError for what is none."""
    count = int(text) if text.isdecimal() and text.isascii() else 0
    if not 1 <= count <= _MOST:
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number from 1 to {_MOST}')
    return count


@contextmanager
def local_processes(
    count: int, prepare: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
) -> Iterator[Executor]:
    """Processes on this machine, each of one thread, which may be prepared by a function.

    They end at once where the body of the `with` fails, and when their parent is killed. Submit
    to them within `interrupts_held`.
    """
    before = {name: os.environ.get(name) for name in _THREADS}
    others = set(multiprocessing.active_children())
    os.environ.update(dict.fromkeys(_THREADS, '1'))
    executor = ProcessPoolExecutor(
        count,
        multiprocessing.get_context('spawn'),
        initializer=_begin,
        initargs=(prepare, arguments),
    )
    try:
        yield executor
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
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back, also from processes that are started meanwhile, whose parent gets it."""
    held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def _begin(prepare: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    """Prepare this process, and end it as soon as its parent has ended, however it did."""
    if prepare:
        prepare(*arguments)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_outlive, args=(parent,), daemon=True).start()


def _outlive(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
