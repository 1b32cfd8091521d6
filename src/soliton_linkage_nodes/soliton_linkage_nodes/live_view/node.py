# SPDX-License-Identifier: Apache-2.0
"""Node that serves the live page."""

from __future__ import annotations

import secrets
import socket
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder
from soliton_linkage_nodes.live_view.stream import BrowserStream
from soliton_linkage_nodes.live_view.view import View
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown
from soliton_linkage_nodes.runtime.subscriptions import create_inbox

_IDLE_PERIOD = 0.1
"""Time between two updates while no browser is connected [s]."""


@dataclass(frozen=True)
class LiveViewParameters:
    """Parameters of the node that serves the live page."""

    host: str = quantity(
        '127.0.0.1',
        'address of the web server; if other machines can reach it, the page needs the token in '
        'the printed address',
    )
    port: int = quantity(8080, 'port of the web server, 0 for any free port', '', 0, 65535)
    frame_rate: float = quantity(60.0, 'largest rate of drawn frames', 'Hz', 1.0, 240.0)
    processor_share: float = quantity(
        0.15, 'largest fraction of a processor core for all browsers together', '', 0.01, 1.0
    )
    read_only: bool = quantity(False, 'whether the page sends no commands')
    bag_folders: tuple[str, ...] = quantity(
        (), 'folders whose bags are listed; the first one receives recordings; empty for no bags'
    )
    lesson: bool = quantity(
        False, 'whether the page begins with the guided experiments, in large type'
    )
    record: bool = quantity(False, 'whether to record from the start')


class LiveView(GuardedNode):
    """Node that serves a web page. The page shows all chains and sends commands to them.

    In each namespace with `joint_states` the node also subscribes to `soliton_state`, `chain`,
    `last_kick` and `camera_overlay`. It publishes `nudge`, `edge_command`, `tilt` and
    `joint_commands`, and it calls services and the action `move_soliton`. It subscribes to
    `/diagnostics` and publishes its own reports on this topic. On request of a user it starts a
    `bag_recorder`, and a `bag_player` in the namespace `/replay`.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {LiveViewParameters: ''}

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('live_view', **kwargs)
        self.settings = settings = declare(self, LiveViewParameters)
        reject_unknown(self)
        folders = [Path(folder) for folder in settings.bag_folders]
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
        self._inbox = create_inbox(self)
        own = self.resolve_topic_name('joint_states').removesuffix('joint_states')
        self._logs = tempfile.TemporaryDirectory(prefix='live_view_')
        finder, logs = ChainFinder(self._inbox, own), Path(self._logs.name)
        self.view = View(self, finder, folders, logs, settings.read_only)
        self.streams: set[BrowserStream] = set()
        self._busy = 0.0
        self._increments = Increments()
        self.diagnostics = Diagnostics(self, 'page', self._report)
        self._serve()
        if settings.record:
            self.get_logger().info(f'recording to {self.view.recording.begin(own)}_0')

    def _serve(self) -> None:
        try:
            from soliton_linkage_nodes.live_view import page, server
        except ImportError as error:
            raise ValueError(
                f'live_view needs the Python package {error.name}, which is not installed; '
                'run: pip install nicegui'
            ) from error
        host, share = self.settings.host, self.settings.processor_share
        token = '' if server.is_loopback(host) else secrets.token_urlsafe(24)
        bound = server.listening_socket(host, self.settings.port)
        self.port = int(bound.getsockname()[1])
        shown = socket.gethostname() if host in ('0.0.0.0', '::') else host
        shown = f'[{shown}]' if ':' in shown else shown
        self.address = f'http://{shown}:{self.port}/' + (f'?token={token}' if token else '')
        served = server.application(self._stream, self.view.shared)
        page.add(served, self.view, self.settings.lesson)
        self.server = server.PageServer(served, bound, token, self._tick, share)
        if token:
            # Print the token instead of logging it, because the log of ROS is a public topic.
            print(f'open {self.address}', flush=True)
        else:
            self.get_logger().info(f'open {self.address}')

    @property
    def failure(self) -> Exception | None:
        """Error that ended the web server, or None if no error has occurred."""
        failure = self.server.failure
        return failure and ValueError(f'the web server of the page ended: {failure}')

    def destroy_node(self) -> None:
        """Stop the web server, the recorder and the player, and destroy the node."""
        self.server.stop()
        self.view.close()
        self._logs.cleanup()
        self._inbox.destroy_node()
        super().destroy_node()

    async def _stream(self, websocket: Any) -> None:
        stream = BrowserStream(websocket, self.view)
        self.streams.add(stream)
        try:
            await stream.run()
        finally:
            self.streams.discard(stream)

    def _tick(self) -> float:
        begin = time.perf_counter()
        self.view.update({stream.watched for stream in self.streams if stream.shows_camera})
        self._busy += time.perf_counter() - begin
        return 1 / self.settings.frame_rate if self.streams else _IDLE_PERIOD

    def _report(self) -> Report:
        seconds, sent, busy = self._increments.take(self.view.sent, self._busy)
        browsers = len(self.streams)
        return Report(
            f'{browsers} browser{"" if browsers == 1 else "s"} connected',
            {
                'address': f'http://{self.settings.host}:{self.port}/',
                'browsers': browsers,
                'chains': ' '.join(self.view.chains),
                'frames sent [1/s]': sent / seconds,
                'fraction of time for messages [1]': busy / seconds,
                'frames in transit': sum(stream.pending for stream in self.streams),
            },
        )
