# SPDX-License-Identifier: Apache-2.0
"""The recorder and the player that a page starts, commands and stops."""

from __future__ import annotations

import asyncio
import os
import time
from pathlib import Path
from typing import Any

from soliton_linkage_nodes.bags.services import service_type
from soliton_linkage_nodes.live_view.bag_catalogue import (
    BagCatalogue,
    BagTrack,
    CataloguedBag,
    track_of,
)
from soliton_linkage_nodes.live_view.chain_topics import REPORTS_LAST, ChainFinder
from soliton_linkage_nodes.live_view.commands import READ_ONLY, ChainCommands
from soliton_linkage_nodes.live_view.status import REPLAY
from soliton_linkage_nodes.messages.view_conversions import NodeReport
from soliton_linkage_nodes.runtime.child_processes import ChildProcesses
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

_RECORDER = 'bag_recorder'
_PLAYER = 'bag_player'
_DONE = {
    'pause': 'paused',
    'resume': 'going on',
    'split_bagfile': 'a new file is begun',
    'snapshot': 'the snapshot is written',
}
"""Result of a request in words."""


class BagRecording:
    """The recorder of one chain: a child process, or one that was started elsewhere."""

    def __init__(self, folder: Path | None, finder: ChainFinder, read_only: bool) -> None:
        """Record into a folder, None for no recording."""
        self._read_only = read_only
        self.namespace = '/'
        self._folder = folder
        self._finder = finder
        self._processes: ChildProcesses | None = None
        self.running = False
        """Whether this page has started a recorder that has not ended."""

    @property
    def report(self) -> NodeReport | None:
        """Last report of the recorder, None if it is silent."""
        told = self._finder.reports.get(f'{self.namespace}{_RECORDER}')
        fresh = told is not None and time.monotonic() - told[0] < REPORTS_LAST
        return told[1] if told and fresh else None

    def status(self) -> dict[str, Any] | None:
        """Return the status for the page."""
        report = self.report
        if report is None:
            return None
        figures = report.figures
        return {
            'bag': figures.get('bag', ''),
            'messages': figures.get('messages', ''),
            'lost': figures.get('lost messages', ''),
            'message': report.message,
            'own': self.running,
        }

    @property
    def refusal(self) -> str:
        """Reason why no recorder can be started."""
        if self._read_only:
            return READ_ONLY
        if self._folder is None:
            return 'no folder for bags was named: start live_view with bag_folders'
        if self.report is not None and not self.running:
            return 'a recorder runs already that was started elsewhere'
        return ''

    def start(self, namespace: str, snapshot: float = 0.0, paused: bool = False) -> str:
        """Record the chain of a namespace, or keep its last `snapshot` [s] for a snapshot."""
        if self._folder is None or self.refusal:
            raise ValueError(self.refusal)
        if self.running:
            raise ValueError('it is recording already')
        self.namespace = namespace
        name = self._folder / time.strftime('recording_%Y_%m_%d-%H_%M_%S')
        self._processes = ChildProcesses(self._folder / 'log')
        arguments = ['-p', f'output:={name}', '-p', f'snapshot_duration:={float(snapshot)}']
        arguments += ['-p', f'start_paused:={str(paused).lower()}']
        arguments += ['-r', f'__ns:={namespace.rstrip("/") or "/"}']
        self._processes.start(_RECORDER, arguments, dict(os.environ))
        self.running = True
        return f'{"ready to record" if paused else "recording"} to {name.name}_0'

    async def stop(self) -> str:
        """Finish the bag."""
        if self._read_only:
            raise ValueError(READ_ONLY)
        if self._processes is None or not self.running:
            raise ValueError('nothing is recorded by this page')
        processes = self._processes
        self.running = False
        codes = await asyncio.to_thread(processes.stop)
        self._finder.reports.pop(f'{self.namespace}{_RECORDER}', None)
        if any(codes.values()):
            raise ValueError(f'the recorder ended with exit code {codes[_RECORDER]}')
        return 'the bag is finished'

    async def ask(self, commands: ChainCommands, what: str) -> str:
        """Request a pause, resume, split or snapshot."""
        kind = what.title().replace('_', '')
        return await _request(commands, f'{commands.namespace}{_RECORDER}', what, kind)

    def poll(self) -> str:
        """Return the new failure of the recorder, empty for none."""
        if self._processes is None or not self.running:
            return ''
        try:
            if self._processes.wait(_RECORDER, 0):
                self.running = False
        except RuntimeError as error:
            self._processes.stop()
            self.running = False
            return str(error)
        return ''

    def close(self) -> None:
        """End the child process."""
        if self._processes is not None and self.running:
            self._processes.stop()


class BagReplay:
    """The player of one bag, in a namespace of its own."""

    def __init__(
        self, catalogue: BagCatalogue, log_folder: Path, finder: ChainFinder, read_only: bool
    ) -> None:
        """Play bags of a catalogue."""
        self.played = 0
        """Number of bags played."""
        self.bag: CataloguedBag | None = None
        self.track = BagTrack((), 0.0)
        self.paused = False
        self.rate = 1.0
        self.loop = False
        self.ended = True
        self._catalogue = catalogue
        self._finder = finder
        self._read_only = read_only
        self._log_folder = log_folder
        self._changing = asyncio.Lock()
        self._processes: ChildProcesses | None = None

    @property
    def namespace(self) -> str:
        """Namespace of the replayed chain, which may include namespaces of the bag."""
        frames = [n for n in (self.bag.played if self.bag else []) if n.endswith('/joint_states')]
        return (
            f'{REPLAY}{frames[0].removesuffix("joint_states").lstrip("/")}' if frames else REPLAY
        )

    @property
    def position(self) -> float | None:
        """Time in the bag [s], None if unknown."""
        chain = self._finder.chains.get(self.namespace)
        if self.bag is None or chain is None or not chain.model.stamp > 0:
            return None
        at = chain.model.stamp + self.track.delay - self.bag.start / SECOND
        return min(max(at, 0.0), self.bag.duration)

    async def play(self, name: str, start: float = 0.0) -> str:
        """Play a bag from a time on [s]."""
        if self._read_only:
            raise ValueError(READ_ONLY)
        async with self._changing:
            return await self._play(name, start)

    async def _play(self, name: str, start: float) -> str:
        bag = await asyncio.to_thread(self._catalogue.bag, name)
        if not bag.played:
            raise ValueError(f'bag {name!r} holds none of the topics that a page shows')
        if self.bag != bag:
            self.track = await asyncio.to_thread(track_of, bag)
            self.played += 1
        await self._end()
        self.bag, self.paused, self.ended = bag, False, False
        self._processes = ChildProcesses(self._log_folder)
        quoted = ','.join(bag.played)
        arguments = [
            *('-p', f'bag:={bag.path}', '-p', f'topics:=[{quoted}]'),
            *('-p', f'rate:={self.rate:.6f}', '-p', f'loop:={str(self.loop).lower()}'),
            *('-p', f'start_offset:={max(start, 0.0):.6f}'),
            *('-r', f'__ns:={REPLAY.rstrip("/")}'),
        ]
        for topic in bag.played:
            arguments += ['-r', f'{topic}:={REPLAY}{topic.lstrip("/")}']
        self._processes.start(_PLAYER, arguments, dict(os.environ))
        return f'playing {name}'

    async def pause(self, commands: ChainCommands, paused: bool) -> str:
        """Pause or resume; at the end of the bag, restart it."""
        if self.bag is not None and self.ended and not paused:
            return await self.play(self.bag.name)
        what = 'pause' if paused else 'resume'
        answer = await _request(commands, f'{REPLAY}{_PLAYER}', what, what.title())
        self.paused = paused
        return answer

    async def seek(self, commands: ChainCommands, at: float) -> str:
        """Continue at a time of the bag [s]."""
        if self.bag is None:
            raise ValueError('no bag is played')
        if not 0 <= at <= self.bag.duration:
            raise ValueError(f'{at:g} s must lie in the range 0 to {self.bag.duration:g} s')
        if self.ended:
            return await self.play(self.bag.name, at)
        request = service_type('Seek').Request(time=time_to_msg(self.bag.start + int(at * SECOND)))
        await _request(commands, f'{REPLAY}{_PLAYER}', 'seek', 'Seek', request)
        return f'at {at:.1f} s'

    async def set_rate(self, commands: ChainCommands, rate: float) -> str:
        """Play faster or slower."""
        if not self.ended:
            request = service_type('SetRate').Request(rate=rate)
            await _request(commands, f'{REPLAY}{_PLAYER}', 'set_rate', 'SetRate', request)
        self.rate = rate
        return f'{rate:g} times as fast as recorded'

    async def set_loop(self, loop: bool) -> str:
        """Set whether the bag repeats; restart a running player for that."""
        if self._read_only:
            raise ValueError(READ_ONLY)
        async with self._changing:
            self.loop = loop
            if self.bag is not None and not self.ended:
                return await self._play(self.bag.name, self.position or 0.0)
        return 'begins again at the end' if loop else 'ends at the end'

    async def stop(self) -> str:
        """End the replay and drop its chain."""
        async with self._changing:
            await self._end()
            self._finder.forget(self.namespace)
            self.bag = None
        return 'the replay is over'

    def poll(self) -> str:
        """Check for the end; return the new failure of the player, empty for none."""
        if self._processes is None or self.ended:
            return ''
        try:
            self.ended = self._processes.wait(_PLAYER, 0)
        except RuntimeError as error:
            self.ended = True
            self._processes.stop()
            return str(error)
        return ''

    def status(self) -> dict[str, Any] | None:
        """Return the status for the page."""
        if self.bag is None:
            return None
        return {
            'bag': self.bag.name,
            'namespace': self.namespace,
            'duration': self.bag.duration,
            'position': self.position,
            'paused': self.paused,
            'ended': self.ended,
            'rate': self.rate,
            'loop': self.loop,
        }

    def close(self) -> None:
        """End the child process."""
        if self._processes is not None:
            self._processes.stop()

    async def _end(self) -> None:
        if self._processes is not None and not self.ended:
            self.ended = True
            await asyncio.to_thread(self._processes.stop)


async def _request(
    commands: ChainCommands, node: str, what: str, kind: str, request: Any = None
) -> str:
    commands.check_writable()
    service = service_type(kind)
    answer = await commands.call(f'{node}/{what}', service, request or service.Request())
    if not getattr(answer, 'success', True) or getattr(answer, 'return_code', 0) != 0:
        said = getattr(answer, 'message', '') or getattr(answer, 'error_string', '')
        raise ValueError(said or f'{what} was refused')
    return _DONE.get(what, '')
