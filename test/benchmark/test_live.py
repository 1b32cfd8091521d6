# SPDX-License-Identifier: Apache-2.0
"""The benchmark of the page: its counters, and a run of its cheapest part."""

import asyncio
import os
from typing import Any

import pytest
import websockets
from live import memory
from live_watchers import crowd

from soliton_linkage_nodes.live_view.frame_layout import pack, pack_history


def test_a_watcher_reports_exactly_the_drawn_pictures():
    picture, history = pack({}, {}), pack_history(0, [])
    said: list[list[str]] = []

    async def serve(stream: Any) -> None:
        for message in ('words', history, picture, picture):
            await stream.send(message)
        said.append([await stream.recv(), await stream.recv()])

    async def watch() -> None:
        async with websockets.serve(serve, '127.0.0.1', 0) as server:
            watching = asyncio.ensure_future(crowd(server.sockets[0].getsockname()[1], 3))
            while len(said) < 3:
                await asyncio.sleep(0.01)
            watching.cancel()

    asyncio.run(asyncio.wait_for(watch(), 240))
    assert said == [['drawn', 'drawn']] * 3


def test_memory_is_the_resident_memory_of_a_process():
    before = memory(os.getpid())
    kept = bytearray(os.urandom(50_000_000))
    assert memory(os.getpid()) - before == pytest.approx(len(kept) / 1e6, abs=10)
