# SPDX-License-Identifier: Apache-2.0
"""What flows to a browser: the newest picture, when it has drawn the one before."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Protocol

from soliton_linkage_nodes.bags.guards.texts import load_json
from soliton_linkage_nodes.live_view.chain_model import MOST_ANGLES
from soliton_linkage_nodes.live_view.chain_topics import ChainTopics
from soliton_linkage_nodes.live_view.frame_layout import (
    ARRAYS,
    ENERGIES,
    FIELDS,
    KINDS,
    pack_history,
)

ALL = '*'
"""In place of a namespace: all chains, small, side by side."""
_MOST_ON_THE_WAY = 2
"""Pictures of a chain that a browser has not drawn yet: one that it draws and one that comes."""
_HEARTBEAT = 0.2
"""After which a picture is sent again that is no newer, but for its age [s]."""
_SMALL_ANGLES = 200
"""Rotors up to which a chain among several is drawn rotor by rotor."""

Act = Callable[[str, Mapping[str, Any]], Awaitable[str]]


class Socket(Protocol):
    """The side of a websocket that a stream needs."""

    async def send_text(self, data: str) -> None:
        """Send text, once there is room for it."""

    async def send_bytes(self, data: bytes) -> None:
        """Send bytes, once there is room for them."""

    async def receive_text(self) -> str:
        """Wait for text."""


class Pictures(Protocol):
    """Where streams take their pictures from."""

    status: str
    """As JSON."""

    @property
    def chains(self) -> Mapping[str, ChainTopics]:
        """By namespace, in the order of their numbers."""

    async def wait(self) -> None:
        """Wait until there may be something new."""

    @property
    def versions(self) -> list[int]:
        """They change when the descriptions do."""

    def descriptions(self) -> dict[str, Any]:
        """What a page has to know besides, of each chain and of the bag that is played."""

    def picture(self, number: int, chain: ChainTopics, first: int, last: int) -> bytes:
        """A frame of a chain, made once for all that look at the same rotors of it."""


class BrowserStream:
    """Sends a browser what it watches, and takes what is done there.

    Nothing waits in a queue: a browser that reads no more has two pictures on the way, and gets
    the next, which is then the newest, when it says that it has drawn one.
    """

    def __init__(self, socket: Socket, source: Pictures, act: Act) -> None:
        """`act` takes an action of the page, by name, and returns what became of it."""
        self.watched = next(iter(source.chains), '')
        self.on_the_way = 0
        """Pictures that were sent and are not drawn yet."""
        self.sent = 0
        """Pictures that were sent in all."""
        self.shows_camera = False
        """Whether the browser shows the pictures of the camera at the chain it watches."""
        self._socket = socket
        self._source = source
        self._act = act
        self._window = (0, MOST_ANGLES)
        self._latest: dict[str, tuple[int, float]] = {}
        self._camera_on_the_way = False
        self._camera_latest = 0
        self._told: tuple[str, list[int]] = ('', [])
        self._history_wanted = True
        self._answers: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Go on until the browser is gone, which raises what the socket raises then."""
        layout = {'kinds': KINDS, 'fields': FIELDS, 'arrays': ARRAYS, 'energies': ENERGIES}
        await self._socket.send_text(json.dumps({'layout': layout}))
        sending, receiving = (
            asyncio.ensure_future(task) for task in (self._send_for_ever(), self._take_for_ever())
        )
        try:
            done, _ = await asyncio.wait((sending, receiving), return_when=asyncio.FIRST_COMPLETED)
            done.pop().result()
        finally:
            for task in (sending, receiving, *self._answers):
                task.cancel()

    async def _send_for_ever(self) -> None:
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
        """Chains that are watched, with their numbers in the list."""
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
            # A window that is too long has no angles.
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
        """Send what has changed of the status and of the chains."""
        status, versions = self._source.status, self._source.versions
        if versions != self._told[1]:
            await self._socket.send_text(json.dumps(self._source.descriptions()))
        if status != self._told[0]:
            await self._socket.send_text(status)
        self._told = (status, versions)

    async def _take_for_ever(self) -> None:
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
            await self._answer(await self._act(name, arguments), True)
        except KeyError as error:
            await self._answer(f'action {name!r} lacks {error}', False)
        except (ValueError, TypeError, ArithmeticError) as error:
            await self._answer(str(error), False)

    async def _answer(self, text: str, good: bool) -> None:
        await self._socket.send_text(json.dumps({'answer': text, 'good': good}))
