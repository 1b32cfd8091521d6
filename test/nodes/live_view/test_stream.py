# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import asyncio
import json
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soliton_linkage_nodes.live_view.chain_model import ChainModel
from soliton_linkage_nodes.live_view.frame_layout import kind_of, pack_camera, unpack
from soliton_linkage_nodes.live_view.stream import BrowserStream
from soliton_linkage_nodes.messages.conversions import JointStates

NAMES = ('rotor_0', 'rotor_1', 'rotor_2')


class Socket:
    """The browser's side, which the test plays."""

    def __init__(self) -> None:
        self.texts: list[dict[str, Any]] = []
        self.frames: list[bytes] = []
        self.said: asyncio.Queue[str] = asyncio.Queue()

    async def send_text(self, data: str) -> None:
        self.texts.append(json.loads(data))

    async def send_bytes(self, data: bytes) -> None:
        self.frames.append(data)

    async def receive_text(self) -> str:
        return await self.said.get()


class Camera:
    """Pictures that the test takes."""

    pictures = 0

    def picture(self, number: int) -> bytes:
        return pack_camera(number, self.pictures, 0.0, b'')


class Chains:
    """Two chains of which a frame comes whenever the test says so."""

    read_only = False

    def __init__(self) -> None:
        self.status = '{"status": {}}'
        self.models = {'/': ChainModel(), '/other/': ChainModel()}
        self.chains: Any = {
            name: SimpleNamespace(namespace=name, model=model, camera=Camera())
            for name, model in self.models.items()
        }
        self._fresh = asyncio.Event()
        self.second = 0
        self.moves: list[tuple[float, float]] = []

    async def wait(self) -> None:
        await self._fresh.wait()

    def commands(self, _namespace: str) -> Chains:
        return self

    async def carry(self, rotor: float, speed: float, _now: float) -> str:
        self.moves.append((rotor, speed))
        return 'done'

    @property
    def versions(self) -> list[int]:
        return [model.version for model in self.models.values()]

    def descriptions(self) -> dict[str, Any]:
        return {'chains': [{'name': name} for name in self.models]}

    def picture(self, number: int, chain: Any, first: int, last: int) -> bytes:
        return bytes(chain.model.picture(number, first, last))

    async def tick(self) -> None:
        self.second += 1
        for model in self.models.values():
            angles = np.full(3, 0.001 * self.second)
            model.take_joints(JointStates(self.second, 0, '', NAMES, angles, np.zeros(3)))
        fresh, self._fresh = self._fresh, asyncio.Event()
        fresh.set()
        for _ in range(10):
            await asyncio.sleep(0)


class Meeting:
    """A stream that runs, its chains and its browser."""

    def __init__(self) -> None:
        self.socket, self.chains = Socket(), Chains()
        self.stream = BrowserStream(self.socket, self.chains)

    async def say(self, message: Any) -> None:
        self.socket.said.put_nowait(message if isinstance(message, str) else json.dumps(message))
        for _ in range(10):
            await asyncio.sleep(0)

    @property
    def stamps(self) -> list[float]:
        return [
            unpack(frame)[0]['stamp'] for frame in self.socket.frames if kind_of(frame) == 'frame'
        ]


def meet(play: Any) -> Meeting:
    """Let a stream run while a function plays the browser."""

    async def run() -> Meeting:
        meeting = Meeting()
        task = asyncio.ensure_future(meeting.stream.run())
        await asyncio.sleep(0)
        await play(meeting)
        assert not task.done() or task.exception() is None
        task.cancel()
        return meeting

    return asyncio.run(run())


def test_a_browser_that_draws_gets_each_frame_once() -> None:
    async def play(meeting: Meeting) -> None:
        for _ in range(5):
            await meeting.chains.tick()
            await meeting.say('drawn')

    stamps = meet(play).stamps
    assert stamps[-5:] == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_a_browser_that_reads_no_more_gets_two_frames_and_then_the_newest() -> None:
    async def play(meeting: Meeting) -> None:
        for _ in range(3):
            await meeting.say('drawn')
        for _ in range(1000):
            await meeting.chains.tick()
        assert meeting.stream.on_the_way == 2
        waiting = len(meeting.stamps)
        await meeting.say('drawn')
        await meeting.chains.tick()
        assert meeting.stamps[waiting:] == [1001.0]

    assert len(meet(play).socket.frames) < 10


def test_it_watches_what_it_asks_for() -> None:
    async def play(meeting: Meeting) -> None:
        await meeting.say({'watch': '/other/'})
        await meeting.say('drawn')
        await meeting.chains.tick()
        assert unpack(meeting.socket.frames[-1])[0]['chain'] == 1.0
        await meeting.say({'watch': '*'})
        for _ in range(4):
            await meeting.say('drawn')
        await meeting.chains.tick()
        last = [unpack(frame)[0]['chain'] for frame in meeting.socket.frames[-2:]]
        assert last == [0.0, 1.0]
        await meeting.say({'watch': '/', 'window': [1, 1]})
        for _ in range(4):
            await meeting.say('drawn')
        await meeting.chains.tick()
        numbers, arrays = unpack(meeting.socket.frames[-1])
        assert numbers['first'] == 1.0
        assert len(arrays['angles']) == 1

    meet(play)


@pytest.mark.parametrize(
    'said',
    [
        'no JSON',
        '[1, 2]',
        '7',
        'null',
        '{"watch": "/nowhere/"}',
        '{"watch": {"a": 1}}',
        '{"window": [1]}',
        '{"window": ["a", "b"]}',
        '{"window": [1e999, 2]}',
        '{"window": null}',
        '{"act": "impossible", "chain": "/"}',
        '{"act": "move"}',
    ],
)
def test_what_cannot_be_is_refused_in_words_and_the_stream_goes_on(said: str) -> None:
    async def play(meeting: Meeting) -> None:
        await meeting.say(said)
        refused = [text for text in meeting.socket.texts if 'answer' in text]
        assert [text['good'] for text in refused] == [False]
        await meeting.say('drawn')
        await meeting.chains.tick()
        assert meeting.stamps[-1] == 1.0

    meet(play)


def test_an_action_is_carried_out_and_answered() -> None:
    async def play(meeting: Meeting) -> None:
        await meeting.say({'act': 'move', 'chain': '/', 'rotor': 3.5})

    meeting = meet(play)
    assert meeting.chains.moves == [(3.5, 0.0)]
    assert {'answer': 'done', 'good': True} in meeting.socket.texts


def test_words_are_sent_when_they_change_only() -> None:
    async def play(meeting: Meeting) -> None:
        for _ in range(20):
            await meeting.say('drawn')
            await meeting.chains.tick()
        meeting.chains.status = '{"status": {"new": 1}}'
        await meeting.chains.tick()

    texts = meet(play).socket.texts
    assert [text['status'] for text in texts if 'status' in text] == [{}, {'new': 1}]
    assert 1 <= sum('chains' in text for text in texts) <= 3


def test_a_picture_of_the_camera_is_sent_where_it_is_shown_and_the_one_before_is_seen() -> None:
    async def play(meeting: Meeting) -> None:
        cameras = [chain.camera for chain in meeting.chains.chains.values()]

        async def take(picture: int) -> None:
            for camera in cameras:
                camera.pictures = picture
            await meeting.chains.tick()

        def sent() -> list[tuple[float, ...]]:
            frames = [f for f in meeting.socket.frames if kind_of(f) == 'camera']
            return [struct.unpack_from('<2d', frame, 8) for frame in frames]

        await take(1)
        assert sent() == []
        await meeting.say({'camera': True})
        await take(2)
        await take(3)
        assert sent() == [(0, 2)]
        await meeting.say('seen')
        await take(4)
        assert sent()[1:] == [(0, 4)]
        await meeting.say('seen')
        await meeting.chains.tick()
        assert len(sent()) == 2
        await meeting.say({'watch': '/other/'})
        await meeting.chains.tick()
        assert sent()[2:] == [(1, 4)]
        for unwanted in ({'watch': '*'}, {'watch': '/', 'camera': False}):
            await meeting.say(unwanted)
            await meeting.say('seen')
            await take(5)
        assert len(sent()) == 3

    meet(play)
