# SPDX-License-Identifier: Apache-2.0
"""A replay that never runs ahead of the analyser."""

from __future__ import annotations

import struct
import threading
import time
from collections import deque
from collections.abc import Callable

from rclpy.node import Node

from soliton_linkage_nodes.runtime import interfaces

_POLL_INTERVAL = 0.05
"""How soon a replay that waits for an answer stops when it is told to [s]."""


class Lockstep:
    """Knows which frames the analyser has answered, by the stamp of its `soliton_state`.

    An answer to a frame is one to all frames before it, which the analyser may have refused.
    """

    def __init__(self, node: Node, frames: str, window: int, limit: float) -> None:
        """Listen to the states beside a topic of frames, of which `window` may be unanswered.

        Where none is answered for `limit` [s], those that were sent are given up.
        """
        self.given_up = 0
        self.frames = frames
        self.states = f'{frames.rpartition("/")[0]}/{interfaces.SOLITON_STATE.name}'
        self._window = window
        self._limit = limit
        self._changed = threading.Condition()
        self._unanswered: deque[bytes] = deque()
        self._subscription = node.create_subscription(
            interfaces.SOLITON_STATE.type,
            self.states,
            self._answer,
            interfaces.stream_qos(),
            raw=True,
        )

    def wait_for_the_analyser(self, limit: float, stopping: threading.Event) -> None:
        """Wait until somebody publishes states; ValueError where nobody has after a time [s]."""
        deadline = time.monotonic() + limit
        while not self._subscription.get_publisher_count():
            if stopping.wait(_POLL_INTERVAL):
                return
            if time.monotonic() > deadline:
                raise ValueError(
                    f'nothing publishes {interfaces.SOLITON_STATE.name} after {limit:g} s; '
                    'start soliton_analyser, or set lockstep to false'
                )

    def wait_for_turn(self, topic: str, message: bytes, stopped: Callable[[], bool]) -> None:
        """Wait until one more frame may be sent, or, for another topic, until all are answered."""
        if topic != self.frames:
            self.settle(stopped)
            return
        self._wait(self._window - 1, stopped)
        with self._changed:
            self._unanswered.append(_stamp(message))

    def forget(self) -> None:
        """Expect no answer to what was sent so far."""
        with self._changed:
            self._unanswered.clear()

    def settle(self, stopped: Callable[[], bool]) -> None:
        """Wait until every frame is answered."""
        self._wait(0, stopped)

    def _wait(self, most: int, stopped: Callable[[], bool]) -> None:
        with self._changed:
            left, since = len(self._unanswered), time.monotonic()
            while len(self._unanswered) > most and not stopped():
                self._changed.wait(_POLL_INTERVAL)
                if len(self._unanswered) != left:
                    left, since = len(self._unanswered), time.monotonic()
                elif time.monotonic() - since > self._limit:
                    self.given_up += left
                    self._unanswered.clear()

    def _answer(self, state: bytes) -> None:
        stamp = _stamp(state)
        with self._changed:
            if stamp in self._unanswered:
                while self._unanswered.popleft() != stamp:
                    pass
                self._changed.notify_all()


def _stamp(message: bytes) -> bytes:
    """The stamp in the header that a serialized message begins with, in one byte order."""
    order = '<' if message[1] & 1 else '>'
    return struct.pack('<iI', *struct.unpack_from(f'{order}iI', message, 4))
