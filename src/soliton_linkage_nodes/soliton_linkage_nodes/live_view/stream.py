# SPDX-License-Identifier: Apache-2.0
"""The stream to a browser: the newest picture, after it has drawn the previous one."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from soliton_linkage_nodes.bags.guards import load_json
from soliton_linkage_nodes.live_view.bag_catalogue import BagCatalogue
from soliton_linkage_nodes.live_view.bag_programs import BagRecording, BagReplay
from soliton_linkage_nodes.live_view.chain_model import MOST_ANGLES
from soliton_linkage_nodes.live_view.chain_topics import ChainFinder, ChainTopics
from soliton_linkage_nodes.live_view.commands import READ_ONLY, ChainCommands
from soliton_linkage_nodes.live_view.frame_layout import (
    ARRAYS,
    ENERGIES,
    FIELDS,
    KINDS,
    pack_history,
)

if TYPE_CHECKING:
    from fastapi import WebSocket

ALL = '*'
"""All chains side by side, in place of a namespace."""
_MOST_ON_THE_WAY = 2
"""Pictures of a chain that a browser has not drawn yet: one being drawn and one in transit."""
_HEARTBEAT = 0.2
"""Time after which a picture is sent again with its new age [s]."""
_SMALL_ANGLES = 200
"""Largest number of rotors of a chain that is drawn rotor by rotor beside others."""


class View(Protocol):
    """The node behind a page."""

    finder: ChainFinder
    catalogue: BagCatalogue
    recording: BagRecording
    replay: BagReplay
    reasons: dict[str, dict[str, str]]
    """Reason why each control of each chain is inactive, empty if it is active."""
    status: str
    """Status of all chains as JSON."""

    @property
    def chains(self) -> Mapping[str, ChainTopics]:
        """Chains by namespace, in the order of their numbers."""

    @property
    def read_only(self) -> bool:
        """Whether the page accepts no action."""

    @property
    def versions(self) -> list[int]:
        """Numbers that change with the descriptions."""

    def commands(self, namespace: str) -> ChainCommands:
        """Return the commands to the nodes of a namespace."""

    def descriptions(self) -> dict[str, Any]:
        """Return the constants of each chain and the track of the played bag."""

    def picture(self, number: int, chain: ChainTopics, first: int, last: int) -> bytes:
        """Return a frame of a chain, packed once for all browsers with the same window."""

    async def wait(self) -> None:
        """Wait for the next tick."""


async def carry_out(view: View, name: str, arguments: Mapping[str, Any]) -> str:
    """Carry out an action on the canvas (move, nudge, seek, pause) and return its result.

    Raises ValueError for an action that is rejected.
    """
    if view.read_only:
        raise ValueError(READ_ONLY)
    namespace = str(arguments.get('chain', ''))
    if namespace not in view.chains:
        raise ValueError(f'chain {namespace!r} is not there')
    commands = view.commands(namespace)
    if name == 'move':
        now = view.chains[namespace].model.numbers.get('rotor', math.nan)
        return await commands.carry(arguments['rotor'], arguments.get('speed', 0.0), now)
    if name == 'nudge':
        edge = str(arguments.get('edge', 'nearest'))
        return commands.drive('kick', edge, arguments['speed'], (0.0, 0.0, 0.0))
    if name == 'seek':
        return await view.replay.seek(commands, float(arguments['at']))
    if name == 'pause':
        paused = bool(arguments['paused'])
        if namespace == view.replay.namespace:
            return await view.replay.pause(commands, paused)
        return await commands.pause(paused)
    raise ValueError(f'action {name!r} is not known')


class BrowserStream:
    """Stream of pictures to a browser, and of actions from it.

    No queue grows: a browser that does not read has two pictures in transit. It gets the next,
    which is the newest, when it reports that it has drawn one.
    """

    def __init__(self, socket: WebSocket, source: View) -> None:
        """Watch the first chain."""
        self.watched = next(iter(source.chains), '')
        self.on_the_way = 0
        """Pictures sent and not drawn yet."""
        self.sent = 0
        """Pictures sent in all."""
        self.shows_camera = False
        """Whether the browser shows the camera of its chain."""
        self._socket = socket
        self._source = source
        self._window = (0, MOST_ANGLES)
        self._latest: dict[str, tuple[int, float]] = {}
        self._camera_on_the_way = False
        self._camera_latest = 0
        self._told: tuple[str, list[int]] = ('', [])
        self._history_wanted = True
        self._answers: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Serve the browser until the socket raises an error."""
        layout = {'kinds': KINDS, 'fields': FIELDS, 'arrays': ARRAYS, 'energies': ENERGIES}
        await self._socket.send_text(json.dumps({'layout': layout}))
        sending, receiving = (
            asyncio.ensure_future(task) for task in (self._send(), self._receive())
        )
        try:
            done, _ = await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
            done.pop().result()
        finally:
            for task in (sending, receiving, *self._answers):
                task.cancel()

    async def _send(self) -> None:
        while True:
            await self._tell()
            if self._history_wanted:
                self._history_wanted = False
                await self._send_history()
            shown = self._shown()
            if self.on_the_way < _MOST_ON_THE_WAY * max(len(shown), 1):
                for number, chain in shown:
                    await self._show(number, chain)
            if self.shows_camera and not self._camera_on_the_way and len(shown) == 1:
                await self._show_camera(*shown[0])
            await self._source.wait()

    def _shown(self) -> list[tuple[int, ChainTopics]]:
        """Return the watched chains with their numbers in the list."""
        listed = enumerate(self._source.chains.values())
        return [(n, c) for n, c in listed if self.watched in (ALL, c.namespace)]

    async def _show(self, number: int, chain: ChainTopics) -> None:
        now = time.monotonic()
        frames, sent_at = self._latest.get(chain.namespace, (-1, 0.0))
        if chain.model.frames == frames and now - sent_at < _HEARTBEAT:
            return
        self._latest[chain.namespace] = (chain.model.frames, now)
        first, last = self._window
        if self.watched == ALL:
            few = chain.model.rotors <= _SMALL_ANGLES
            first, last = (0, chain.model.rotors - 1 if few else MOST_ANGLES + 1)
        self.on_the_way += 1
        self.sent += 1
        await self._socket.send_bytes(self._source.picture(number, chain, first, last))

    async def _show_camera(self, number: int, chain: ChainTopics) -> None:
        if chain.camera.pictures in (0, self._camera_latest):
            return
        self._camera_latest = chain.camera.pictures
        self._camera_on_the_way = True
        await self._socket.send_bytes(chain.camera.picture(number))

    async def _send_history(self) -> None:
        for number, chain in self._shown():
            await self._socket.send_bytes(pack_history(number, chain.model.history))

    async def _tell(self) -> None:
        """Send the status and the constants of chains if they have changed."""
        status, versions = self._source.status, self._source.versions
        if versions != self._told[1]:
            await self._socket.send_text(json.dumps(self._source.descriptions()))
        if status != self._told[0]:
            await self._socket.send_text(status)
        self._told = (status, versions)

    async def _receive(self) -> None:
        while True:
            said = await self._socket.receive_text()
            try:
                self._take(said)
            except (ValueError, TypeError, ArithmeticError) as error:
                await self._answer(f'refused: {error}', False)

    def _take(self, said: str) -> None:
        if said == 'drawn':
            self.on_the_way = max(self.on_the_way - 1, 0)
            return
        if said == 'seen':
            self._camera_on_the_way = False
            return
        message = load_json(said)
        if not isinstance(message, dict):
            raise ValueError('what a page says is an object')
        if 'watch' in message:
            watched = message['watch']
            if watched != ALL and watched not in self._source.chains:
                raise ValueError(f'chain {watched!r} is not there')
            if watched != self.watched:
                self.watched, self._history_wanted = watched, True
                self._camera_latest = 0
        if 'camera' in message:
            self.shows_camera = message['camera'] is True
        if 'window' in message:
            first, last = message['window']
            self._window = (int(first), int(last))
            self._latest.clear()
        if 'act' in message:
            arguments = {k: v for k, v in message.items() if k != 'act'}
            task = asyncio.ensure_future(self._carry_out(str(message['act']), arguments))
            self._answers.add(task)
            task.add_done_callback(self._answers.discard)

    async def _carry_out(self, name: str, arguments: Mapping[str, Any]) -> None:
        try:
            await self._answer(await carry_out(self._source, name, arguments), True)
        except KeyError as error:
            await self._answer(f'action {name!r} lacks {error}', False)
        except (ValueError, TypeError, ArithmeticError) as error:
            await self._answer(str(error), False)

    async def _answer(self, text: str, good: bool) -> None:
        await self._socket.send_text(json.dumps({'answer': text, 'good': good}))
