# SPDX-License-Identifier: Apache-2.0
"""Node that serves the ROS graph to Foxglove and Lichtblick."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown

_PERIOD = 0.02
"""Interval between two checks for requests of clients [s]."""
_SEARCH_PERIOD = 0.5
"""Interval between two searches for new topics and services in the ROS graph [s]."""
_LOOPBACK = ('127.0.0.1', '::1', 'localhost')


@dataclass(frozen=True)
class FoxgloveServerParameters:
    """Parameters of the Foxglove server."""

    host: str = quantity('127.0.0.1', 'address of the server, 0.0.0.0 for all networks')
    port: int = quantity(8765, 'port of the server, 0 for any free port', '', 0, 65535)
    read_only: bool = quantity(
        False,
        'whether clients may only read topics; they then publish nothing and call no services',
    )


class FoxgloveServer(GuardedNode):
    """Node that serves the ROS graph to Foxglove and Lichtblick, as foxglove_bridge does.

    The node subscribes to the topics that its clients select. It publishes `/diagnostics` and the
    messages that clients send.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {FoxgloveServerParameters: ''}

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('foxglove_server', **kwargs)
        self.settings = settings = declare(self, FoxgloveServerParameters)
        reject_unknown(self)
        try:
            from soliton_linkage_nodes.foxglove_server.serving import Serving
        except ImportError as error:
            raise ValueError(
                f'foxglove_server needs the Python package {error.name}, which is not installed; '
                'run: pip install foxglove-sdk'
            ) from error
        self.diagnostics = Diagnostics(self, 'serving', self._report)
        self._queued: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        address, reject = (settings.host, settings.port), self.diagnostics.reject
        self.serving = Serving(self, address, settings.read_only, self._queued.put, reject)
        self._searched = 0.0
        self._increments = Increments()
        self.create_timer(_PERIOD, self._tick)
        self.get_logger().info(f'open {self.address} in Foxglove or Lichtblick')
        if settings.host not in _LOOPBACK and not settings.read_only:
            self.get_logger().warning(
                f'every client that reaches {settings.host} can drive the chain; set read_only to '
                'prevent this'
            )

    @property
    def address(self) -> str:
        """Address to which clients connect."""
        return f'ws://{self.settings.host}:{self.serving.port}'

    def destroy_node(self) -> None:
        """Close the connections and destroy the node."""
        self.serving.close()
        super().destroy_node()

    def _tick(self) -> None:
        while not self._queued.empty():
            self._queued.get()()
        searching = time.monotonic() - self._searched >= _SEARCH_PERIOD
        if searching:
            self._searched = time.monotonic()
        self.serving.poll(searching)

    def _report(self) -> Report:
        outgoing = self.serving.outgoing
        seconds, sent = self._increments.take(outgoing.sent)
        wanted = sum(topic.subscribed for topic in outgoing.topics.values())
        figures = {
            'address': self.address,
            'topics': len(outgoing.topics),
            'topics with clients': wanted,
            'messages sent [1/s]': sent / seconds,
            'messages from clients': self.serving.published,
        }
        return Report(f'{wanted} of {len(outgoing.topics)} topics have clients', figures)
