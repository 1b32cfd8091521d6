# SPDX-License-Identifier: Apache-2.0
import asyncio
import json
import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
from page_messages import kind_of, unpack

from soliton_linkage_nodes.live_view.chain_model import ChainModel
from soliton_linkage_nodes.live_view.frame_layout import pack_camera
from soliton_linkage_nodes.live_view.stream import BrowserStream
from soliton_linkage_nodes.messages.conversions import JointStates

NAMES = ('rotor_0', 'rotor_1', 'rotor_2')


class Socket:
    """The browser's end of the socket."""

    def __init__(self) -> None:
        self.texts: list[dict[str, Any]] = []
        self.frames: list[bytes] = []
        self.messages: asyncio.Queue[str] = asyncio.Queue()

    async def send_text(self, data: str) -> None:
        self.texts.append(json.loads(data))

    async def send_bytes(self, data: bytes) -> None:
        self.frames.append(data)

    async def receive_text(self) -> str:
        return await self.messages.get()


class Camera:
    """Camera whose pictures the test counts."""

    pictures = 0

    def packed(self, index: int) -> bytes:
        return pack_camera(index, self.pictures, 0.0, b'')


class Chains:
    """View of two chains that receive a frame with each tick."""

    sent = 0

    def __init__(self) -> None:
        self.status = '{"status": {}}'
        self.second = 0
        self.models = {name: ChainModel(lambda: self.second) for name in ('/', '/other/')}
        self.chains: Any = {
            name: SimpleNamespace(namespace=name, model=model, camera=Camera())
            for name, model in self.models.items()
        }
        self._fresh = asyncio.Event()
        self.moves: list[tuple[float, float]] = []

    async def wait(self) -> None:
        await self._fresh.wait()

    def commands(self, _namespace: str) -> Any:
        return self

    async def move_to(self, rotor: float, speed: float, _now: float) -> str:
        self.moves.append((rotor, speed))
        return 'done'

    @property
    def versions(self) -> list[int]:
        return [model.version for model in self.models.values()]

    def descriptions(self) -> dict[str, Any]:
        return {'chains': [{'name': name} for name in self.models]}

    def packed(self, index: int, chain: Any, first: int, last: int) -> bytes:
        return bytes(chain.model.packed(index, first, last))

    async def tick(self) -> None:
        self.second += 1
        for model in self.models.values():
            angles = np.full(3, 0.001 * self.second)
            model.update_joints(JointStates(self.second, 0, '', NAMES, angles, np.zeros(3)))
        fresh, self._fresh = self._fresh, asyncio.Event()
        fresh.set()
        for _ in range(10):
            await asyncio.sleep(0)


class Session:
    """A running stream with its chains and its browser."""

    def __init__(self) -> None:
        self.socket, self.chains = Socket(), Chains()
        self.stream = BrowserStream(self.socket, self.chains)

    async def send(self, message: Any) -> None:
        self.socket.messages.put_nowait(
            message if isinstance(message, str) else json.dumps(message)
        )
        for _ in range(10):
            await asyncio.sleep(0)

    @property
    def stamps(self) -> list[float]:
        return [
            unpack(frame)[0]['stamp'] for frame in self.socket.frames if kind_of(frame) == 'frame'
        ]


def run_session(play: Any) -> Session:
    """Run a stream while a function acts as the browser."""

    async def run() -> Session:
        session = Session()
        task = asyncio.ensure_future(session.stream.run())
        await asyncio.sleep(0)
        await play(session)
        assert not task.done() or task.exception() is None
        task.cancel()
        return session

    return asyncio.run(run())


def test_a_browser_that_draws_receives_each_frame_once():
    async def play(session: Session) -> None:
        for _ in range(5):
            await session.chains.tick()
            await session.send('drawn')

    stamps = run_session(play).stamps
    assert stamps[-5:] == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_a_browser_that_stops_drawing_receives_two_frames_and_later_the_newest():
    async def play(session: Session) -> None:
        for _ in range(3):
            await session.send('drawn')
        for _ in range(1000):
            await session.chains.tick()
        assert session.stream.pending == 2
        waiting = len(session.stamps)
        await session.send('drawn')
        await session.chains.tick()
        assert session.stamps[waiting:] == [1001.0]

    frames = run_session(play).socket.frames
    assert len(frames) < 10
    # The browser receives the skipped columns of the history before the newest frame.
    assert [kind_of(frame) for frame in frames[-2:]] == ['history', 'frame']
    assert struct.unpack_from('<3d', frames[-2], 8)[1] == 599


def test_a_browser_receives_the_chains_and_rotors_that_it_requests():
    async def play(session: Session) -> None:
        await session.send({'watch': '/other/'})
        await session.send('drawn')
        await session.chains.tick()
        assert unpack(session.socket.frames[-1])[0]['chain'] == 1.0
        await session.send({'watch': '*'})
        for _ in range(4):
            await session.send('drawn')
        await session.chains.tick()
        last = [unpack(frame)[0]['chain'] for frame in session.socket.frames[-2:]]
        assert last == [0.0, 1.0]
        await session.send({'watch': '/', 'window': [1, 1]})
        for _ in range(4):
            await session.send('drawn')
        await session.chains.tick()
        numbers, arrays = unpack(session.socket.frames[-1])
        assert numbers['first'] == 1.0
        assert len(arrays['angles']) == 1

    run_session(play)


def test_an_invalid_message_is_rejected_and_the_stream_continues():
    for message in [
        'no JSON',
        '[1, 2]',
        '{"watch": "/nowhere/"}',
        '{"watch": {"a": 1}}',
        '{"window": ["a", "b"]}',
        '{"window": [1e999, 2]}',
        '{"act": "impossible", "chain": "/"}',
        '{"act": "move"}',
    ]:

        async def play(session: Session, message: str = message) -> None:
            await session.send(message)
            rejected = [text for text in session.socket.texts if 'answer' in text]
            assert [text['good'] for text in rejected] == [False]
            await session.send('drawn')
            await session.chains.tick()
            assert session.stamps[-1] == 1.0

        run_session(play)


def test_an_action_is_carried_out_and_answered():
    async def play(session: Session) -> None:
        await session.send({'act': 'move', 'id': 7, 'chain': '/', 'rotor': 3.5})

    session = run_session(play)
    assert session.chains.moves == [(3.5, 0.0)]
    assert {'answer': 'done', 'good': True, 'id': 7} in session.socket.texts


def test_the_status_is_sent_only_when_it_changes():
    async def play(session: Session) -> None:
        for _ in range(20):
            await session.send('drawn')
            await session.chains.tick()
        session.chains.status = '{"status": {"new": 1}}'
        await session.chains.tick()

    texts = run_session(play).socket.texts
    assert [text['status'] for text in texts if 'status' in text] == [{}, {'new': 1}]
    assert 1 <= sum('chains' in text for text in texts) <= 3


def test_a_camera_picture_is_sent_while_it_is_shown_and_the_previous_one_was_seen():
    async def play(session: Session) -> None:
        cameras = [chain.camera for chain in session.chains.chains.values()]

        async def take(picture: int) -> None:
            for camera in cameras:
                camera.pictures = picture
            await session.chains.tick()

        def sent() -> list[tuple[float, ...]]:
            frames = [f for f in session.socket.frames if kind_of(f) == 'camera']
            return [struct.unpack_from('<2d', frame, 8) for frame in frames]

        await take(1)
        assert sent() == []
        await session.send({'camera': True})
        await take(2)
        await take(3)
        assert sent() == [(0, 2)]
        await session.send('seen')
        await take(4)
        assert sent()[1:] == [(0, 4)]
        await session.send('seen')
        await session.chains.tick()
        assert len(sent()) == 2
        await session.send({'watch': '/other/'})
        await session.chains.tick()
        assert sent()[2:] == [(1, 4)]
        for unwanted in ({'watch': '*'}, {'watch': '/', 'camera': False}):
            await session.send(unwanted)
            await session.send('seen')
            await take(5)
        assert len(sent()) == 3

    run_session(play)
