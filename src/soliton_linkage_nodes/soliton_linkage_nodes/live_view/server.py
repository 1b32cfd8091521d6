# SPDX-License-Identifier: Apache-2.0
"""The server of the page, on a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect
from fastapi.responses import FileResponse, Response

from soliton_linkage_nodes.live_view.gate import Gate

SCRIPTS = Path(__file__).with_name('browser')
_LONGEST_START = 30.0
"""Time for the server to start [s]: NiceGUI takes seconds on a busy machine."""
_LONGEST_PERIOD = 0.2
"""Longest time between two ticks, for any number of browsers [s]."""
_MOST_SAID = 65536
"""Largest message of a browser [bytes]."""


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket bound to a host and a port, 0 for any free one."""
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_STREAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise ValueError(
            f'parameters host = {host!r} and port = {port} of live_view: {error.strerror}; '
            'give another port, or 0 for any that is free'
        ) from error
    return bound


def application(serve: Callable[[WebSocket], Awaitable[None]]) -> FastAPI:
    """Return an application with the page's own files and a stream to each browser."""
    made = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    files = {path.name: path for path in SCRIPTS.iterdir() if path.suffix in ('.js', '.css')}

    @made.get('/live/{name}', response_class=Response)
    async def own_file(name: str) -> Response:
        if name not in files:
            return Response(status_code=404)
        return FileResponse(files[name], headers={'cache-control': 'no-cache'})

    @made.websocket('/stream')
    async def stream(websocket: WebSocket) -> None:
        await websocket.accept()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            await serve(websocket)

    return made


class PageServer:
    """Server of an application on its own thread, which also calls `tick`."""

    def __init__(
        self,
        made: FastAPI,
        bound: socket.socket,
        token: str,
        tick: Callable[[], float],
        share: float,
    ) -> None:
        """Serve on a bound socket; `tick` returns the time to the next call [s].

        Ticks are less frequent if the thread would take more than a share of a core [1].
        """
        config = uvicorn.Config(
            Gate(made, token),
            log_level='error',
            lifespan='on',
            ws_per_message_deflate=False,
            ws_max_size=_MOST_SAID,
            timeout_graceful_shutdown=1,
        )
        self.failure: Exception | None = None
        self._server = uvicorn.Server(config)
        self._socket = bound
        self._tick = tick
        self._share = share
        self._fresh: asyncio.Event | None = None
        self._thread = threading.Thread(target=self._run, name='page')
        self._thread.start()
        deadline = time.monotonic() + _LONGEST_START
        while not self._server.started and time.monotonic() < deadline:
            if not self._thread.is_alive():
                raise ValueError(f'the page could not be served: {self.failure}')
            time.sleep(0.01)

    async def wait(self) -> None:
        """Wait for the end of the next tick."""
        if self._fresh is not None:
            await self._fresh.wait()

    def stop(self) -> None:
        """End the streams and the server."""
        self._server.should_exit = True
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:
            self.failure = error

    async def _serve(self) -> None:
        ticking = asyncio.ensure_future(self._tick_loop())
        try:
            await self._server.serve([self._socket])
        finally:
            ticking.cancel()

    async def _tick_loop(self) -> None:
        due, spent = time.monotonic(), time.thread_time()
        self._fresh = asyncio.Event()
        while True:
            try:
                period = self._tick()
            except Exception as error:
                self.failure = error
                return
            before, spent = spent, time.thread_time()
            due += max(period, min((spent - before) / self._share, _LONGEST_PERIOD))
            fresh, self._fresh = self._fresh, asyncio.Event()
            fresh.set()
            now = time.monotonic()
            due = max(due, now)
            await asyncio.sleep(due - now)
