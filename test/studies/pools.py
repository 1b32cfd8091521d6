# SPDX-License-Identifier: Apache-2.0
"""A pool that runs tasks in this process, which replaces worker processes in tests."""

from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any


class Here:
    """Pool of two workers that run tasks immediately in this thread."""

    count = 2

    def __init__(self) -> None:
        self.results: list[Any] = []
        self.done: list[Future[Any]] = []

    def submit(self, task: Any, /, *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            self.results.append(task(*arguments))
            future.set_result(self.results[-1])
        except Exception as error:
            future.set_exception(error)
        self.done.append(future)
        return future

    def finished(self) -> Iterator[Future[Any]]:
        while self.done:
            yield self.done.pop()
