# SPDX-License-Identifier: Apache-2.0
"""Stream of frames to a browser."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Mapping
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from soliton_linkage_nodes.bags.guards import load_json
from soliton_linkage_nodes.live_view.chain_model import MOST_ANGLES
from soliton_linkage_nodes.live_view.chain_topics import ChainTopics
from soliton_linkage_nodes.live_view.frame_layout import LAYOUT, Column, pack_history
from soliton_linkage_nodes.live_view.moves import Pull
from soliton_linkage_nodes.live_view.view import ALL, View

if TYPE_CHECKING:
    from fastapi import WebSocket

_MOST_PENDING = 2
"""Largest number of sent frames that a browser has not drawn yet [1]. It exceeds 1, because one
frame is always in transit."""
_HEARTBEAT = 0.2
"""Time after which an unchanged frame is sent again, so that the page can show its age [s]."""
_MOST_TILE_ANGLES = 200
"""Largest number of rotors of a chain that are drawn one by one while the page shows all chains
[1]."""


async def carry_out(view: View, name: str, arguments: Mapping[str, Any]) -> str:
    """Carry out an action that the user requests on the drawing, and return the answer.

    Raises ValueError if the action is rejected.
    """
    namespace = str(arguments.get('chain', ''))
    if namespace not in view.chains:
        raise ValueError(f'no node publishes joint_states of the chain {namespace!r}')
    commands = view.commands(namespace)
    if name == 'move':
        position = view.chains[namespace].model.numbers.get('rotor', math.nan)
        return await commands.move_to(arguments['rotor'], arguments.get('speed', 0.0), position)
    if name == 'nudge':
        edge = str(arguments.get('edge', 'nearest'))
        return await commands.drive('kick', edge, arguments['speed'], (0.0, 0.0, 0.0))
    if name == 'pull':
        return await commands.pull(arguments['pull'], view.wait)
    if name == 'seek':
        return await view.replay.seek(float(arguments['at']))
    if name == 'pause':
        paused = bool(arguments['paused'])
        if namespace == view.replay.namespace:
            return await view.replay.pause(paused)
        return await commands.pause(paused)
    raise ValueError(f'action {name!r} is unknown')


class BrowserStream:
    """Connection to one browser. After drawing a frame, the browser receives the newest frame."""

    def __init__(self, socket: WebSocket, source: View) -> None:
        self.watched = next(iter(source.chains), '')
        self.pending = 0
        self.shows_camera = False
        self._socket = socket
        self._source = source
        self._window = (0, MOST_ANGLES)
        self._latest: dict[str, tuple[int, float]] = {}
        self._sent_stamps: dict[str, float] = {}
        self._camera_pending = False
        self._camera_latest = 0
        self._sent_status: tuple[str, list[int]] = ('', [])
        self._history_wanted = True
        self._pull = Pull(0, 0.0, 0.0, held=False)
        self._actions: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Exchange messages with the browser until the socket raises an error."""
        await self._socket.send_text(json.dumps({'layout': LAYOUT}))
        tasks = [asyncio.ensure_future(task) for task in (self._send(), self._receive())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            done.pop().result()
        finally:
            for task in (*tasks, *self._actions):
                task.cancel()

    async def _send(self) -> None:
        while True:
            await self._send_status()
            listed = enumerate(self._source.chains.values())
            shown = [(n, c) for n, c in listed if self.watched in (ALL, c.namespace)]
            if self._history_wanted:
                self._history_wanted = False
                for index, chain in shown:
                    self._sent_stamps[chain.namespace] = chain.model.stamp
                    await self._socket.send_bytes(pack_history(index, chain.model.history))
            if self.pending < _MOST_PENDING * max(len(shown), 1):
                for index, chain in shown:
                    await self._send_frame(index, chain)
            if self.shows_camera and not self._camera_pending and len(shown) == 1:
                await self._send_camera(*shown[0])
            await self._source.wait()

    async def _send_frame(self, index: int, chain: ChainTopics) -> None:
        now = time.monotonic()
        frames, sent_at = self._latest.get(chain.namespace, (-1, 0.0))
        if chain.model.frames == frames and now - sent_at < _HEARTBEAT:
            return
        self._latest[chain.namespace] = (chain.model.frames, now)
        first, last = self._window
        if self.watched == ALL:
            few = chain.model.rotors <= _MOST_TILE_ANGLES
            first, last = (0, chain.model.rotors - 1 if few else MOST_ANGLES + 1)
        self.pending += 1
        self._source.sent += 1
        packed = self._source.packed(index, chain, first, last)
        if skipped := self._skipped(chain):
            await self._socket.send_bytes(pack_history(index, skipped))
        await self._socket.send_bytes(packed)

    def _skipped(self, chain: ChainTopics) -> list[Column]:
        """Return the columns of the history since the last sent frame, without the newest column.

        The newest column is sent as a frame.
        """
        last = self._sent_stamps.get(chain.namespace, math.inf)
        self._sent_stamps[chain.namespace] = chain.model.stamp
        skipped = list(
            takewhile(lambda each: each.numbers[0] > last, reversed(chain.model.history))
        )
        return skipped[:0:-1]

    async def _send_camera(self, index: int, chain: ChainTopics) -> None:
        if chain.camera.pictures in (0, self._camera_latest):
            return
        self._camera_latest = chain.camera.pictures
        self._camera_pending = True
        await self._socket.send_bytes(chain.camera.packed(index))

    async def _send_status(self) -> None:
        status, versions = self._source.status, self._source.versions
        if versions != self._sent_status[1]:
            await self._socket.send_text(json.dumps(self._source.descriptions()))
        if status != self._sent_status[0]:
            await self._socket.send_text(status)
        self._sent_status = (status, versions)

    async def _receive(self) -> None:
        while True:
            text = await self._socket.receive_text()
            try:
                self._process(text)
            except (ValueError, TypeError, ArithmeticError) as error:
                await self._answer(f'rejected: {error}', False)

    def _process(self, text: str) -> None:
        if text == 'drawn':
            self.pending = max(self.pending - 1, 0)
            return
        if text == 'seen':
            self._camera_pending = False
            return
        message = load_json(text)
        if not isinstance(message, dict):
            raise ValueError('the message of the page must be a JSON object')
        if 'watch' in message:
            watched = message['watch']
            if watched != ALL and watched not in self._source.chains:
                raise ValueError(f'no node publishes joint_states of the chain {watched!r}')
            if watched != self.watched:
                self.watched, self._history_wanted = watched, True
                self._camera_latest = 0
        if 'camera' in message:
            self.shows_camera = message['camera'] is True
        if 'window' in message:
            first, last = message['window']
            self._window = (int(first), int(last))
            self._latest.clear()
        if 'pull' in message:
            if message['pull'] is None:
                self._pull.held = False
            else:
                self._pull.point_to(*map(float, message['pull']))
        if 'act' in message:
            task = asyncio.ensure_future(self._act(message))
            self._actions.add(task)
            task.add_done_callback(self._actions.discard)

    async def _act(self, message: Mapping[str, Any]) -> None:
        name, number = str(message['act']), message.get('id')
        arguments = {k: v for k, v in message.items() if k not in ('act', 'id')}
        try:
            if name == 'pull':
                self._pull.held = False
                target = float(arguments['x']), float(arguments['z'])
                self._pull = arguments['pull'] = Pull(int(arguments['rotor']), 0.0, 0.0)
                self._pull.point_to(*target)
            text, good = await carry_out(self._source, name, arguments), True
        except KeyError as error:
            text, good = f'action {name!r} needs the argument {error}', False
        except (ValueError, TypeError, ArithmeticError) as error:
            text, good = str(error), False
        await self._answer(text, good, number)

    async def _answer(self, text: str, good: bool, number: object = None) -> None:
        answer = {'answer': text, 'good': good, 'id': number}
        await self._socket.send_text(json.dumps(answer))
