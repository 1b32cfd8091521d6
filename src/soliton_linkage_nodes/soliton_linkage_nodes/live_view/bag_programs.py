# SPDX-License-Identifier: Apache-2.0
"""Start, control and stop of the recorder and of the player for the page.

A frame consists of the joint states of all rotors at one time.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from soliton_linkage_nodes.bags.services import service_type
from soliton_linkage_nodes.live_view.bag_catalogue import (
    NO_TRACK,
    BagCatalogue,
    CataloguedBag,
    track_of,
)
from soliton_linkage_nodes.live_view.chain_topics import REPORT_TIMEOUT, ChainFinder
from soliton_linkage_nodes.live_view.commands import READ_ONLY, ChainCommands
from soliton_linkage_nodes.live_view.status import REPLAY
from soliton_linkage_nodes.messages.view_conversions import NodeReport
from soliton_linkage_nodes.runtime.child_processes import ChildProcesses
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

_RECORDER = 'bag_recorder'
_PLAYER = 'bag_player'
_POLL_INTERVAL = 0.05
"""Poll interval while waiting for a recorder or an analyser [s]."""
_LONGEST_ANALYSIS = 5.0
"""Longest time for which the stop of a recording waits for the soliton_state of the newest frame
[s]."""
_MOST_STEPS = 20
"""Largest number of messages that a paused replay plays after a seek to show a frame [1]."""
_STEP_INTERVAL = 0.02
"""Pause after each message that a paused replay plays after a seek [s]. During the pause, the page
receives the message."""
_LONGEST_SEEK = 30.0
"""Longest wait for a frame and its soliton_state after a seek in a paused replay [s]. Each message
that the replay plays restarts this time."""
_RESULTS = {
    'pause': 'paused',
    'resume': 'resumed',
    'split_bagfile': 'started a new file',
    'snapshot': 'wrote the snapshot',
}
CommandsOf = Callable[[str], ChainCommands]
"""Function that returns the object for sending commands to the nodes in a namespace."""


class _BagProgram:
    """Recorder or player that the page controls by service calls.

    The page can start the program as a child process.
    """

    def __init__(self, node: str, finder: ChainFinder, commands: CommandsOf) -> None:
        self.running = False
        self._node, self._finder, self._commands = node, finder, commands
        self._processes: ChildProcesses | None = None

    def poll(self) -> str:
        """Return the error if the child process has failed since the last call, or ''."""
        if self._processes is None or not self.running:
            return ''
        try:
            self.running = not self._processes.wait(self._node, 0)
        except RuntimeError as error:
            self.close()
            self.running = False
            return str(error)
        return ''

    def close(self) -> None:
        if self._processes is not None and self.running:
            self._processes.stop()

    def _start(self, log_folder: Path, arguments: list[str]) -> None:
        self._processes = ChildProcesses(log_folder)
        self._processes.start(self._node, arguments, dict(os.environ))
        self.running = True

    async def _stop(self) -> int:
        self.running = False
        codes = await asyncio.to_thread(self._processes.stop) if self._processes else {}
        return codes.get(self._node, 0)

    async def _request(self, namespace: str, name: str, request: Any = None) -> str:
        commands = self._commands(namespace)
        commands.check_writable()
        service = service_type(name.title().replace('_', ''))
        service_name = f'{namespace}{self._node}/{name}'
        answer = await commands.call(service_name, service, request or service.Request())
        if not getattr(answer, 'success', True) or getattr(answer, 'return_code', 0) != 0:
            reason = getattr(answer, 'message', '') or getattr(answer, 'error_string', '')
            raise ValueError(reason or f'{self._node} rejected {name}')
        return _RESULTS.get(name, '')


class BagRecording(_BagProgram):
    """Recorder of one chain, started by the page or by another program.

    The commands `start`, `stop` and `request` return a text for the user. They raise ValueError if
    the command is rejected.
    """

    def __init__(self, folder: Path | None, finder: ChainFinder, commands: CommandsOf) -> None:
        super().__init__(_RECORDER, finder, commands)
        self.namespace = '/'
        self.finished = 0
        self._folder = folder

    @property
    def report(self) -> NodeReport | None:
        """Last report of the recorder, or None if the recorder has not reported for 3.5 s."""
        received_at, report = self._finder.reports.get(
            f'{self.namespace}{_RECORDER}', (-REPORT_TIMEOUT, None)
        )
        return report if time.monotonic() - received_at < REPORT_TIMEOUT else None

    def status(self) -> dict[str, Any] | None:
        """Return the status for the page, or None if no recorder reports."""
        return {'message': self.report.message} if self.report else None

    @property
    def rejection(self) -> str:
        """Reason why no recorder can be started, or ''."""
        if self._commands(self.namespace).read_only:
            return READ_ONLY
        if self._folder is None:
            return 'no folder for bags is set; start live_view with bag_folders'
        if self.report is not None and not self.running:
            return 'another program is recording this chain; stop that recorder first'
        return ''

    async def start(self, namespace: str, snapshot: float = 0.0) -> str:
        """Start a recorder like `begin`, and wait until it is connected to all publishers."""
        name = self.begin(namespace, snapshot)
        while self.running and not (self.report and self.report.message.startswith('recording')):
            await asyncio.sleep(_POLL_INTERVAL)
        if not self.running:
            raise ValueError('the recorder ended before it was connected to all publishers')
        return f'recording to {name}_0'

    def begin(self, namespace: str, snapshot: float = 0.0) -> str:
        """Start a recorder of the chain in a namespace, and return the name of the recording.

        If `snapshot` > 0, the recorder stores only the messages of the last `snapshot` [s] in
        memory. It writes them to the bag when it receives the request `snapshot`.
        """
        if self._folder is None or self.rejection:
            raise ValueError(self.rejection)
        if self.running:
            raise ValueError('a recording is already running; stop it first')
        self.namespace = namespace
        name = self._folder / time.strftime('recording_%Y_%m_%d-%H_%M_%S')
        arguments = ['-p', f'output:={name}', '-p', f'snapshot_duration:={float(snapshot)}']
        arguments += ['-r', f'__ns:={namespace.rstrip("/") or "/"}']
        self._start(self._folder / 'log', arguments)
        return name.name

    async def stop(self) -> str:
        """Stop the recorder. The recorder completes the bag before it ends."""
        self._commands(self.namespace).check_writable()
        if not self.running:
            raise ValueError('this page is not recording; press Record first')
        await self._await_states()
        code = await self._stop()
        self.finished += 1
        self._finder.reports.pop(f'{self.namespace}{_RECORDER}', None)
        if code:
            raise ValueError(f'the recorder ended with exit code {code}; see its log')
        return 'the bag is complete'

    async def request(self, name: str) -> str:
        """Send a request to the recorder: `pause`, `resume`, `split_bagfile` or `snapshot`."""
        return await self._request(self.namespace, name)

    async def _await_states(self) -> None:
        chain = self._finder.chains.get(self.namespace)
        newest = chain.newest_frame if chain else 0
        deadline = time.monotonic() + _LONGEST_ANALYSIS
        while chain and not chain.is_analysed(newest) and time.monotonic() < deadline:
            await asyncio.sleep(_POLL_INTERVAL)


class BagReplay(_BagProgram):
    """Player of one bag, in the namespace /replay.

    The commands `play`, `pause`, `seek`, `set_rate`, `set_loop` and `stop` return a text for the
    user. They raise ValueError if the command is rejected. All times count from the start of the
    bag, without the pauses of the recorder.
    """

    def __init__(
        self, catalogue: BagCatalogue, log_folder: Path, finder: ChainFinder, commands: CommandsOf
    ) -> None:
        super().__init__(_PLAYER, finder, commands)
        self.played = 0
        self.bag: CataloguedBag | None = None
        self.track = NO_TRACK
        self.paused = False
        self.rate = 1.0
        self.loop = False
        self._frames_before = 0
        self._catalogue = catalogue
        self._log_folder = log_folder
        self._changing = asyncio.Lock()

    @property
    def namespace(self) -> str:
        """Namespace of the replayed chain: /replay/, followed by the recorded namespace."""
        frames = [n for n in (self.bag.played if self.bag else []) if n.endswith('/joint_states')]
        return REPLAY + (frames[0].removesuffix('joint_states').lstrip('/') if frames else '')

    @property
    def position(self) -> float | None:
        """Time of the newest replayed frame [s], or None if it is unknown."""
        chain = self._finder.chains.get(self.namespace)
        if self.bag is None or chain is None or chain.model.frames == self._frames_before:
            return None
        at = self.track.time_of(chain.model.stamp)
        return None if math.isnan(at) else min(max(at, 0.0), self.bag.duration)

    async def play(self, name: str, start: float = 0.0) -> str:
        """Play the bag with this name from the time `start` [s]."""
        self._commands(self.namespace).check_writable()
        async with self._changing:
            return await self._play(name, start)

    async def _play(self, name: str, start: float) -> str:
        bag = await asyncio.to_thread(self._catalogue.bag, name)
        if not bag.played:
            raise ValueError(f'bag {name!r} contains no topic that the page shows')
        if self.bag != bag:
            self.track = await asyncio.to_thread(track_of, bag)
            self.played += 1
        await self._stop()
        self.bag, self.paused = bag, False
        chain = self._finder.chains.get(self.namespace)
        self._frames_before = chain.model.frames if chain else 0
        arguments = [
            *('-p', f'bag:={bag.path}', '-p', f'topics:=[{",".join(bag.played)}]'),
            *('-p', f'rate:={self.rate:.6f}', '-p', f'loop:={str(self.loop).lower()}'),
            *('-p', f'start_offset:={(bag.stamp_of(start) - bag.start) / SECOND:.6f}'),
            *('-r', f'__ns:={REPLAY.rstrip("/")}'),
        ]
        for topic in bag.played:
            arguments += ['-r', f'{topic}:={REPLAY}{topic.lstrip("/")}']
        self._start(self._log_folder, arguments)
        return f'playing {name}'

    async def pause(self, paused: bool) -> str:
        """Pause or resume the replay. If the replay has ended, resuming starts it again."""
        if self.bag is not None and not self.running and not paused:
            return await self.play(self.bag.name)
        answer = await self._request(REPLAY, 'pause' if paused else 'resume')
        self.paused = paused
        return answer

    async def seek(self, at: float) -> str:
        """Continue the replay from the time `at` [s]. A paused replay shows the frame there."""
        self._commands(self.namespace).check_writable()
        if self.bag is None:
            raise ValueError('no bag is playing')
        if not 0 <= at <= self.bag.duration:
            raise ValueError(f'{at:g} s must lie in the range 0 to {self.bag.duration:g} s')
        if not self.running:
            return await self.play(self.bag.name, at)
        request = service_type('Seek').Request(time=time_to_msg(self.bag.stamp_of(at)))
        await self._request(REPLAY, 'seek', request)
        if not self.paused:
            return f'continued at {at:.1f} s'
        await self._show_frame(at)
        return f'paused at {at:.1f} s'

    async def _show_frame(self, at: float) -> None:
        """Play messages of a paused replay until a frame and its soliton_state have arrived.

        `at` is the time of the frame [s]. A frame is ignored if it is nearer to the position
        before the seek than to `at`, because it may have been sent before the seek.
        """
        chain = self._finder.chains.get(self.namespace)
        if chain is None or self.bag is None:
            return
        before, state, first = chain.newest_frame, chain.newest_state, 0
        left = self.track.time_of(before / SECOND)
        analysed = any(topic.endswith('soliton_state') for topic in self.bag.played)
        steps, deadline = 0, time.monotonic() + _LONGEST_SEEK
        while time.monotonic() < deadline:
            # The player rejects a step while it reads the bag at the new time.
            if steps < _MOST_STEPS:
                with contextlib.suppress(ValueError):
                    await self._request(REPLAY, 'play_next')
                    steps, deadline = steps + 1, time.monotonic() + _LONGEST_SEEK
            await asyncio.sleep(_STEP_INTERVAL)
            time_of_frame = self.track.time_of(chain.newest_frame / SECOND)
            # Frames from before the seek may still be in transit.
            passed = abs(time_of_frame - left) < abs(time_of_frame - at)
            if chain.newest_frame != before and not passed:
                first = first or chain.newest_frame
                if not analysed or (chain.newest_state != state and chain.newest_state >= first):
                    return

    async def set_rate(self, rate: float) -> str:
        """Set the speed of the replay relative to the recorded speed [1]."""
        if self.running:
            request = service_type('SetRate').Request(rate=rate)
            await self._request(REPLAY, 'set_rate', request)
        self.rate = rate
        return f'playing at {rate:g} × the recorded speed'

    async def set_loop(self, loop: bool) -> str:
        """Set whether the replay repeats the bag, and restart a running player at its position."""
        self._commands(self.namespace).check_writable()
        async with self._changing:
            self.loop = loop
            if self.bag is not None and self.running:
                return await self._play(self.bag.name, self.position or 0.0)
        return 'the bag restarts at its end' if loop else 'the replay stops at the end'

    async def stop(self) -> str:
        """End the replay and remove its chain from the page."""
        async with self._changing:
            await self._stop()
            self._finder.drop(self.namespace)
            self.bag = None
        return 'ended the replay'

    def status(self) -> dict[str, Any] | None:
        """Return the status for the page, or None if no bag is open."""
        if self.bag is None:
            return None
        return {
            'bag': self.bag.name,
            'duration': self.bag.duration,
            'position': self.position,
            'paused': self.paused,
            'ended': not self.running,
            'rate': self.rate,
        }
