# SPDX-License-Identifier: Apache-2.0
"""The live view: a page in a browser that shows moving chains and sends commands to them."""

from __future__ import annotations

import secrets
import socket
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import rclpy

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.live_view.bag_catalogue import BagCatalogue
from soliton_linkage_nodes.live_view.bag_programs import BagRecording, BagReplay
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder, ChainTopics
from soliton_linkage_nodes.live_view.commands import ChainCommands
from soliton_linkage_nodes.live_view.gate import is_loopback
from soliton_linkage_nodes.live_view.status import reasons, status
from soliton_linkage_nodes.live_view.stream import BrowserStream
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown
from soliton_linkage_nodes.runtime.process import run

_STATUS_PERIOD = 0.25
"""Time between two updates of the status [s]; nodes report once a second."""
_IDLE_PERIOD = 0.1
"""Time between two ticks without browsers [s]."""


@dataclass(frozen=True)
class LiveViewParameters:
    """Parameters of the page."""

    host: str = quantity(
        '127.0.0.1', 'address to serve at; one that others can reach has a token, which is printed'
    )
    port: int = quantity(8080, 'port to serve at, 0 for any that is free', '', 0, 65535)
    frame_rate: float = quantity(60.0, 'most pictures a second', 'Hz', 1.0, 240.0)
    processor_share: float = quantity(
        0.15, 'most of a core that pictures take: of more browsers each gets fewer', '', 0.01, 1.0
    )
    read_only: bool = quantity(False, 'whether the page only shows, and changes nothing')
    bag_folders: tuple[str, ...] = quantity(
        (), 'folders whose bags are listed; recordings go to the first; empty for no bags'
    )
    record: str = quantity(
        'no',
        'whether to record from the start on, or to have a recorder stand by',
        choices=('no', 'yes', 'paused'),
    )


class LiveView(GuardedNode):
    """Serves a page that shows chains and sends commands to them.

    Subscribes in every namespace that has `joint_states` to them, `soliton_state` and `chain`,
    to `camera_overlay` while a browser shows it, and to `/diagnostics`. Publishes `nudge`,
    `edge_command` and `tilt` there, calls the services of the suite's nodes and the action
    `move_soliton`, and publishes `/diagnostics`. Starts a `bag_recorder`, and a `bag_player` that
    plays into the namespace `/replay`.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {LiveViewParameters: ''}

    def __init__(self, **kwargs: Any) -> None:
        """Serve the page."""
        super().__init__('live_view', **kwargs)
        self.settings = settings = declare(self, LiveViewParameters)
        reject_unknown(self)
        folders = [Path(folder) for folder in settings.bag_folders]
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
        self._inbox = rclpy.create_node(
            '_live_view_inbox',
            namespace=self.get_namespace(),
            context=self.context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        own = self.resolve_topic_name('joint_states').removesuffix('joint_states')
        self.finder = ChainFinder(self._inbox, own)
        self.catalogue = BagCatalogue(folders)
        self.recording = BagRecording(
            folders[0] if folders else None, self.finder, settings.read_only
        )
        self._logs = tempfile.TemporaryDirectory(prefix='live_view_')
        self.replay = BagReplay(
            self.catalogue, Path(self._logs.name), self.finder, settings.read_only
        )
        self.status = ''
        self.reasons: dict[str, dict[str, str]] = {}
        """Reason why each control of each chain is inactive, empty if it is active."""
        self.complaints: list[str] = []
        """Last failures of the recorder and the player."""
        self.streams: set[BrowserStream] = set()
        self._pictures: dict[tuple[int, int, int], bytes] = {}
        self._commands: dict[str, ChainCommands] = {}
        self._updated_at = 0.0
        self._busy = 0.0
        self._reported = (time.monotonic(), 0, 0.0)
        self._sent_before = 0
        self.diagnostics = Diagnostics(self, 'page', self._report)
        self.token = '' if is_loopback(settings.host) else secrets.token_urlsafe(24)
        self._serve()
        if settings.record != 'no':
            paused = settings.record == 'paused'
            self.get_logger().info(self.recording.start(own, paused=paused))

    def _serve(self) -> None:
        try:
            from soliton_linkage_nodes.live_view import page, server
        except ImportError as error:
            raise ValueError(
                f'live_view needs the Python package {error.name}, which is not installed; '
                'run: pip install nicegui'
            ) from error
        bound = server.listening_socket(self.settings.host, self.settings.port)
        self.port = int(bound.getsockname()[1])
        made = server.application(self._stream)
        page.add(made, self)
        share = self.settings.processor_share
        self.server = server.PageServer(made, bound, self.token, self._tick, share)
        if self.token:
            # The log of ROS is a public topic.
            print(f'open {self.address}', flush=True)
        else:
            self.get_logger().info(f'open {self.address}')

    @property
    def address(self) -> str:
        """Address of the page."""
        host = self.settings.host
        if host in ('0.0.0.0', '::'):
            host = socket.gethostname()
        host = f'[{host}]' if ':' in host else host
        token = f'?token={self.token}' if self.token else ''
        return f'http://{host}:{self.port}/{token}'

    @property
    def failure(self) -> Exception | None:
        """Error that has ended the server."""
        return self.server.failure

    @property
    def read_only(self) -> bool:
        """Whether the page only shows."""
        return self.settings.read_only

    @property
    def chains(self) -> Mapping[str, ChainTopics]:
        """Chains by namespace."""
        return self.finder.chains

    def commands(self, namespace: str) -> ChainCommands:
        """Return the commands to the nodes of a namespace."""
        if namespace not in self._commands:
            self._commands[namespace] = ChainCommands(self, namespace, self.settings.read_only)
        return self._commands[namespace]

    @property
    def versions(self) -> list[int]:
        """Numbers that change with the descriptions."""
        return [self.replay.played, *(c.model.version for c in self.finder.chains.values())]

    def descriptions(self) -> dict[str, Any]:
        """Return the constants of each chain and the track of the played bag."""
        chains = [
            {'name': namespace, **chain.model.description()}
            for namespace, chain in self.finder.chains.items()
        ]
        return {'chains': chains, 'track': self.replay.track.points}

    def picture(self, number: int, chain: ChainTopics, first: int, last: int) -> bytes:
        """Return a frame of a chain, packed once for all browsers with the same window."""
        shown = number, first, last
        if shown not in self._pictures:
            self._pictures[shown] = chain.model.picture(*shown)
        return self._pictures[shown]

    async def wait(self) -> None:
        """Wait for the next tick."""
        await self.server.wait()

    def destroy_node(self) -> None:
        """End the streams, the recorder and the player too."""
        self.server.stop()
        self.recording.close()
        self.replay.close()
        self._logs.cleanup()
        for commands in self._commands.values():
            commands.close()
        self._inbox.destroy_node()
        super().destroy_node()

    async def _stream(self, websocket: Any) -> None:
        stream = BrowserStream(websocket, self)
        self.streams.add(stream)
        try:
            await stream.run()
        finally:
            self.streams.discard(stream)
            self._sent_before += stream.sent

    def _tick(self) -> float:
        """Take the newest messages and update the status; return the time to the next tick [s]."""
        begin = time.perf_counter()
        self._pictures.clear()
        self.finder.take()
        shown = {stream.watched for stream in self.streams if stream.shows_camera}
        for namespace, chain in self.finder.chains.items():
            chain.camera.want(namespace in shown)
            commands = self.commands(namespace)
            report = self.finder.reports.get(f'{namespace}soliton_steering')
            if report is not None:
                commands.follow(report[0], report[1].figures)
            move = commands.move
            if move.elsewhere:
                move.rotor = chain.model.numbers.get('rotor', float('nan'))
            chain.model.goal = move.goal if move.under_way else float('nan')
        now = time.monotonic()
        if now - self._updated_at >= _STATUS_PERIOD:
            self._updated_at = now
            self.complaints += filter(None, (self.recording.poll(), self.replay.poll()))
            del self.complaints[:-3]
            self._update_status()
        self._busy += time.perf_counter() - begin
        return 1 / self.settings.frame_rate if self.streams else _IDLE_PERIOD

    def _update_status(self) -> None:
        more = {
            'read_only': self.settings.read_only,
            'replay': self.replay.status(),
            'recorder': self.recording.status(),
            'complaints': self.complaints,
        }
        commands = {name: self.commands(name) for name in self.finder.chains}
        self.reasons = {
            name: reasons(chain, commands[name]) for name, chain in self.finder.chains.items()
        }
        self.status = status(self.finder, commands, self.reasons, more)

    def _report(self) -> Report:
        now = time.monotonic()
        before, sent_before, busy_before = self._reported
        sent = self._sent_before + sum(stream.sent for stream in self.streams)
        self._reported = (now, sent, self._busy)
        watching = len(self.streams)
        message = f'{watching} browsers watch' if watching != 1 else '1 browser watches'
        return Report(
            message,
            {
                'address': f'http://{self.settings.host}:{self.port}/',
                'browsers': watching,
                'chains': ' '.join(self.finder.chains),
                'pictures sent [1/s]': (sent - sent_before) / (now - before),
                'share of time taking messages': (self._busy - busy_before) / (now - before),
                'pictures on the way': sum(stream.on_the_way for stream in self.streams),
            },
        )


def _finished(view: LiveView) -> bool:
    if view.failure is not None:
        raise ValueError(f'the page cannot go on: {view.failure}') from view.failure
    return False


def main() -> None:
    """Run the live view."""
    run(LiveView, _finished)
