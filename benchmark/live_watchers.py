# SPDX-License-Identifier: Apache-2.0
"""Browsers as the server of the live page sees them: they take pictures and say they drew them."""

from __future__ import annotations

import asyncio
import contextlib
import sys

import websockets


async def watch(address: str) -> None:
    """Take the pictures of one stream."""
    async with websockets.connect(address, compression=None) as stream:
        async for message in stream:
            if isinstance(message, bytes) and message[7] < 128:
                await stream.send('drawn')


async def crowd(port: int, browsers: int) -> None:
    """Watch so many streams until it is told to stop."""
    watching = [watch(f'ws://127.0.0.1:{port}/stream') for _ in range(browsers)]
    await asyncio.gather(*watching, asyncio.sleep(1e9))


if __name__ == '__main__':
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(crowd(int(sys.argv[1]), int(sys.argv[2])))
