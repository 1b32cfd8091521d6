# SPDX-License-Identifier: Apache-2.0
"""Simulated browsers, which acknowledge pictures of the live page without decoding them."""

from __future__ import annotations

import asyncio
import sys
import time

ASK = (
    'GET /stream HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n'
    'Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
    'Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n'
)
DRAWN = bytes([0x81, 0x80 | 5, 0, 0, 0, 0]) + b'drawn'
BINARY, CLOSE, PING, PONG = 0x82, 0x88, 0x89, 0x8A
FRAME = bytes(8)


class Watcher(asyncio.Protocol):
    """Receiver of the pictures of one stream."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._waiting = b''
        self._upgraded = False
        self.drawn = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Request the stream."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.write(ASK.format(port=self._port).encode())

    def data_received(self, data: bytes) -> None:
        """Process complete frames (RFC 6455, section 5.2)."""
        data = self._waiting + data
        begin = 0
        if not self._upgraded:
            begin = data.find(b'\r\n\r\n') + 4
            self._upgraded = begin > 3
        while self._upgraded and len(data) - begin >= 2:
            kind, size = data[begin], data[begin + 1]
            head = {126: 4, 127: 10}.get(size, 2)
            if head > 2:
                size = int.from_bytes(data[begin + 2 : begin + head], 'big')
            if len(data) - begin < head + size:
                break
            begin += head
            self._take(kind, data[begin : begin + size])
            begin += size
        self._waiting = data[begin:] if self._upgraded else data

    def _take(self, kind: int, payload: bytes) -> None:
        if kind == BINARY and payload.startswith(FRAME):
            self.drawn += 1
            self._transport.write(DRAWN)
        elif kind == CLOSE:
            self._transport.close()
        elif kind == PING:
            head = bytes([PONG, 0x80 | len(payload), 0, 0, 0, 0])
            self._transport.write(head + payload)


async def crowd(port: int, browsers: int) -> None:
    """Receive a number of streams until stopped, and print their rates."""
    loop = asyncio.get_running_loop()
    made = [
        await loop.create_connection(lambda: Watcher(port), '127.0.0.1', port)
        for _ in range(browsers)
    ]
    begun, spent = time.monotonic(), time.process_time()
    try:
        await asyncio.Event().wait()
    finally:
        span = time.monotonic() - begun
        rates = [watcher.drawn / span for _, watcher in made]
        if rates:
            share = 100 * (time.process_time() - spent) / span
            print(
                f'{browsers} watchers took {min(rates):.0f} to {max(rates):.0f} pictures a second '
                f'each, with {share:.1f} % of a core',
                flush=True,
            )


if __name__ == '__main__':
    try:
        asyncio.run(crowd(int(sys.argv[1]), int(sys.argv[2])))
    except KeyboardInterrupt:
        sys.exit(0)
