# SPDX-License-Identifier: Apache-2.0
"""Web server of the page with access control, on a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import ipaddress
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect, responses
from fastapi.staticfiles import StaticFiles
from starlette.requests import HTTPConnection

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

_SCRIPTS = Path(__file__).with_name('browser')
_PICTURES = Path(__file__).parent / 'docs' / 'pictures'
_START_TIMEOUT = 30.0
"""Time limit for the start of the server [s]. NiceGUI needs several seconds on a busy machine."""
_LONGEST_PERIOD = 0.2
"""Longest time between two calls of `tick` by `PageServer` under high load [s]."""
_LARGEST_MESSAGE = 65536
"""Largest accepted message from a browser [bytes]."""
_COOKIE = 'soliton_linkage_live_view'
_PUNCTUATION = '.,;:)\'"'
"""Characters that are removed from the end of the address that a user opens. The user may have
copied them together with the address."""
_REMEDY = 'open the address that live_view printed'


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that is bound to a host and a port. The port 0 selects any free port.

    Raises ValueError if the port cannot be opened.
    """
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_STREAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise ValueError(
            f'parameters host = {host!r} and port = {port} of live_view: {error.strerror}; '
            'set another port, or 0 for any free port'
        ) from error
    return bound


def application(
    serve: Callable[[WebSocket], Awaitable[None]], share: Callable[[str], str]
) -> FastAPI:
    """Return the web application of the page.

    `serve` handles the stream to one browser. `share` takes the namespace of a chain and returns
    an HTML page with the last minute of this chain.
    """
    created = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    files = {path.name: path for path in _SCRIPTS.iterdir() if path.suffix in ('.js', '.css')}

    created.mount('/docs/pictures', StaticFiles(directory=_PICTURES, check_dir=False))

    @created.get('/live/{name}', response_class=responses.Response)
    async def own_file(name: str) -> responses.Response:
        if name not in files:
            return responses.Response(status_code=404)
        return responses.FileResponse(files[name], headers={'cache-control': 'no-cache'})

    @created.get('/share', response_class=responses.Response)
    async def shared(chain: str) -> responses.Response:
        try:
            text = share(chain)
        except ValueError as error:
            return responses.PlainTextResponse(f'{error}\n', 409)
        name = time.strftime('soliton_%Y_%m_%d-%H_%M_%S.html')
        headers = {'content-disposition': f'attachment; filename="{name}"'}
        return responses.HTMLResponse(text, headers=headers)

    @created.websocket('/stream')
    async def stream(websocket: WebSocket) -> None:
        await websocket.accept()
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            await serve(websocket)

    return created


class PageServer:
    """Web server in a thread of its own.

    The thread also calls the function `tick` periodically, which processes new messages.
    """

    def __init__(
        self,
        served: FastAPI,
        bound: socket.socket,
        token: str,
        tick: Callable[[], float],
        share: float,
    ) -> None:
        """Start the server on a bound socket.

        `tick` returns the time until its next call [s]. If the thread would use more than the
        fraction `share` of a processor core [1], the server increases this time, but to at most
        0.2 s. Requests must contain the `token`, unless it is ''.
        """
        config = uvicorn.Config(
            Gate(served, token),
            log_level='error',
            lifespan='on',
            ws_per_message_deflate=False,
            ws_max_size=_LARGEST_MESSAGE,
            timeout_graceful_shutdown=1,
        )
        self.failure: Exception | None = None
        self._server = uvicorn.Server(config)
        self._socket = bound
        self._tick = tick
        self._share = share
        self._thread = threading.Thread(target=self._run, name='page')
        self._thread.start()
        deadline = time.monotonic() + _START_TIMEOUT
        while not self._server.started and time.monotonic() < deadline:
            if not self._thread.is_alive():
                raise ValueError(f'live_view could not serve its page: {self.failure}')
            time.sleep(0.01)

    def stop(self) -> None:
        """Stop the streams and the server."""
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
        while True:
            try:
                period = self._tick()
            except Exception as error:
                self.failure = error
                return
            before, spent = spent, time.thread_time()
            due = max(time.monotonic(), due + tick_period(period, spent - before, self._share))
            await asyncio.sleep(due - time.monotonic())


def tick_period(wanted: float, spent: float, share: float) -> float:
    """Return the time until the next tick [s].

    The time is `wanted` [s]. If the thread would use more than the fraction `share` of a processor
    core [1], the time is increased, but to at most 0.2 s. `spent` is the processor time of the
    thread since the last tick [s].
    """
    return max(wanted, min(spent / share, _LONGEST_PERIOD))


def is_loopback(host: str) -> bool:
    """Return whether a host name or address denotes this machine (a loopback address)."""
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Gate:
    """Middleware that rejects requests and streams that do not come from the live page.

    Without this check, another web page in the same browser could send commands to the chain (DNS
    rebinding). If a token is set, a request must contain the token. Without a token, the host name
    in the request must be a name of this machine. If a request states an origin, the origin must
    be this server.
    """

    def __init__(self, guarded: ASGIApp, token: str = '') -> None:
        self._application = guarded
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request, or reject it and state the reason."""
        answer: ASGIApp = self._application
        if scope['type'] in ('http', 'websocket'):
            connection = HTTPConnection(scope)
            in_address = self._is_token(
                connection.query_params.get('token', '').rstrip(_PUNCTUATION)
            )
            reason = self._rejection(connection, in_address)
            if reason and scope['type'] == 'websocket':
                await send({'type': 'websocket.close', 'code': 1008, 'reason': reason})
                return
            if reason:
                answer = responses.PlainTextResponse(f'{reason}\n', 403)
            elif scope['type'] == 'http' and self._token and in_address:
                # Redirect to the address without the token to keep the token out of the history.
                answer = redirection = responses.RedirectResponse(scope['path'], 303)
                redirection.set_cookie(_COOKIE, self._token, httponly=True, samesite='strict')
            elif scope['type'] == 'http' and not scope['path'].strip('/' + _PUNCTUATION):
                scope = {**scope, 'path': '/', 'raw_path': b'/'}
        await answer(scope, receive, send)

    def _rejection(self, connection: HTTPConnection, in_address: bool) -> str:
        host = connection.headers.get('host', '')
        name = urlsplit(f'//{host}').hostname or ''
        origin = connection.headers.get('origin')
        if not self._token and not is_loopback(name):
            return f'host {name!r} is not this machine; {_REMEDY}'
        if origin is not None and urlsplit(origin).netloc != host:
            return f'origin {origin!r} is not this page; {_REMEDY}'
        if self._token and not (in_address or self._is_token(connection.cookies.get(_COOKIE, ''))):
            return f'the token is missing or wrong; {_REMEDY}'
        return ''

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._token.encode())
