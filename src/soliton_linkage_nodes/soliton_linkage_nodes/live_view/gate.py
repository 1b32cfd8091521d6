# SPDX-License-Identifier: Apache-2.0
"""Access control of the page, its streams and its actions."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Mapping
from http.cookies import SimpleCookie
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

_COOKIE = 'soliton_linkage_live_view'


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach a host."""
    if host == 'localhost':
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Gate:
    """Middleware that rejects requests and streams from other pages.

    A page of another origin in the same browser could otherwise act on the chain, also by a host
    name that resolves to 127.0.0.1. Therefore only names of this machine are accepted without a
    token. A token is required in the address or in the cookie that the first answer sets.
    """

    def __init__(self, application: ASGIApp, token: str = '') -> None:
        """Guard an application; an empty token is none."""
        self._application = application
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or reject it with the reason in one line."""
        if scope['type'] not in ('http', 'websocket'):
            await self._application(scope, receive, send)
            return
        headers = {
            name.decode('latin-1'): value.decode('latin-1') for name, value in scope['headers']
        }
        complaint = self._complaint(scope, headers)
        if complaint:
            await _refuse(scope, send, complaint)
        elif scope['type'] == 'http' and self._token and self._in_address(scope):
            await _keep(scope, send, self._token)
        else:
            await self._application(scope, receive, send)

    def _complaint(self, scope: Scope, headers: Mapping[str, str]) -> str | None:
        host = headers.get('host', '')
        name = urlsplit(f'//{host}').hostname or ''
        if not self._token and not is_loopback(name):
            return f'host {name!r} is not this machine; open the address that live_view printed'
        origin = headers.get('origin')
        if origin is not None and urlsplit(origin).netloc != host:
            return f'origin {origin!r} is not this page; open the address that live_view printed'
        if self._token and not (self._in_address(scope) or self._in_cookie(headers)):
            return 'the token is missing or wrong; open the address that live_view printed'
        return None

    def _in_address(self, scope: Scope) -> bool:
        given = parse_qs(scope.get('query_string', b'').decode('latin-1')).get('token', [''])
        return self._right(given[0])

    def _in_cookie(self, headers: Mapping[str, str]) -> bool:
        cookie = SimpleCookie(headers.get('cookie', '')).get(_COOKIE)
        return cookie is not None and self._right(cookie.value)

    def _right(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._token.encode())


async def _refuse(scope: Scope, send: Send, complaint: str) -> None:
    if scope['type'] == 'websocket':
        await send({'type': 'websocket.close', 'code': 1008, 'reason': complaint})
        return
    headers = [(b'content-type', b'text/plain; charset=utf-8')]
    await send({'type': 'http.response.start', 'status': 403, 'headers': headers})
    await send({'type': 'http.response.body', 'body': f'{complaint}\n'.encode()})


async def _keep(scope: Scope, send: Send, token: str) -> None:
    """Store the token in a cookie, which no other page and no history shows."""
    cookie = f'{_COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict'
    headers = [(b'location', scope['path'].encode()), (b'set-cookie', cookie.encode())]
    await send({'type': 'http.response.start', 'status': 303, 'headers': headers})
    await send({'type': 'http.response.body', 'body': b''})
