# SPDX-License-Identifier: Apache-2.0
"""Simulated browsers, which acknowledge pictures of the live page without decoding them."""

from __future__ import annotations

import asyncio
import sys
import time

import websockets

FRAME = bytes(8)


async def crowd(port: int, browsers: int) -> None:
    """Receive a number of streams until stopped, and print their rates."""
    drawn = [0] * browsers

    async def watch(number: int) -> None:
        options = {'compression': None, 'max_size': None, 'ping_interval': None}
        async with websockets.connect(f'ws://127.0.0.1:{port}/stream', **options) as stream:
            async for message in stream:
                if isinstance(message, bytes) and message.startswith(FRAME):
                    drawn[number] += 1
                    await stream.send('drawn')

    begun, spent = time.monotonic(), time.process_time()
    try:
        await asyncio.gather(*map(watch, range(browsers)))
    finally:
        span = time.monotonic() - begun
        if browsers:
            share = 100 * (time.process_time() - spent) / span
            print(
                f'{browsers} watchers took {min(drawn) / span:.0f} to {max(drawn) / span:.0f} '
                f'pictures a second each, with {share:.1f} % of a core',
                flush=True,
            )


if __name__ == '__main__':
    try:
        asyncio.run(crowd(int(sys.argv[1]), int(sys.argv[2])))
    except KeyboardInterrupt:
        sys.exit(0)
