# SPDX-License-Identifier: Apache-2.0
import asyncio
import socket
from typing import Any

import pytest

pytest.importorskip('fastapi', reason='needs NiceGUI: pip install nicegui')

from soliton_linkage_nodes.live_view.node import LiveView
from soliton_linkage_nodes.live_view.server import Gate, is_loopback, tick_period

TOKEN = 'a-token-of-this-test'


def request(
    token: str = '', kind: str = 'http', query: str = '', **headers: str
) -> tuple[list[dict[str, Any]], bool]:
    """Return the answer to a request, and whether the request reached the page."""
    sent: list[dict[str, Any]] = []
    reached = []

    async def page(_scope: Any, _receive: Any, _send: Any) -> None:
        reached.append(True)

    async def send(message: dict[str, Any]) -> None:
        sent.append(message)

    async def receive() -> None: ...

    scope = {
        'type': kind,
        'path': '/',
        'query_string': query.encode(),
        'headers': [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    asyncio.run(Gate(page, token)(scope, receive, send))
    return sent, bool(reached)


def test_requests_of_this_machine_reach_the_page():
    for host in ['127.0.0.1:8080', 'localhost:8080', '[::1]:8080']:
        for kind in ['http', 'websocket']:
            assert request(kind=kind, host=host) == ([], True)
            assert request(kind=kind, host=host, origin=f'http://{host}') == ([], True)


def test_other_hosts_and_other_pages_are_rejected():
    for headers in [
        {'host': 'evil.example:8080'},
        {'host': ''},
        {'host': '127.0.0.1:8080', 'origin': 'http://evil.example'},
        {'host': '127.0.0.1:8080', 'origin': 'http://127.0.0.1:9999'},
        {'host': '127.0.0.1:8080', 'origin': 'null'},
        {'host': '127.0.0.1.evil.example', 'origin': 'http://127.0.0.1.evil.example'},
    ]:
        for kind in ['http', 'websocket']:
            sent, reached = request(kind=kind, **headers)
            assert not reached
            if kind == 'websocket':
                assert [message['type'] for message in sent] == ['websocket.close']
                assert 'open the address' in sent[0]['reason']
            else:
                assert sent[0]['status'] == 403
                assert b'open the address that live_view printed' in sent[1]['body']


def test_requests_without_the_token_are_rejected():
    for query in ['', 'token=', 'token=wrong', f'token={TOKEN}x', 'token=%C3%A9']:
        for kind in ['http', 'websocket']:
            host = 'robot.local:8080'
            assert not request(TOKEN, kind, query, host=host)[1]
            assert not request(
                TOKEN, kind, query, host=host, cookie='soliton_linkage_live_view=no'
            )[1]


def test_the_token_moves_from_the_address_into_a_cookie():
    host = 'robot.local:8080'
    sent, reached = request(TOKEN, query=f'token={TOKEN}', host=host)
    assert not reached
    headers = dict(sent[0]['headers'])
    assert sent[0]['status'] == 303
    assert headers[b'location'] == b'/'
    cookie = headers[b'set-cookie'].decode()
    assert 'HttpOnly' in cookie
    assert 'SameSite=strict' in cookie
    kept = cookie.partition(';')[0]
    for kind in ('http', 'websocket'):
        assert request(TOKEN, kind, host=host, cookie=kept) == ([], True)
        other = {'host': host, 'cookie': kept, 'origin': 'http://evil.example'}
        assert not request(TOKEN, kind, **other)[1]


def test_only_loopback_addresses_are_loopback():
    for host, expected in [
        ('127.0.0.1', True),
        ('127.1.2.3', True),
        ('::1', True),
        ('localhost', True),
        ('0.0.0.0', False),
        ('192.168.0.4', False),
        ('robot', False),
    ]:
        assert is_loopback(host) is expected


def test_the_time_to_the_next_tick_limits_the_share_of_a_core():
    for wanted, spent, expected in [
        (0.02, 0.001, 0.02),
        (0.02, 0.01, 0.05),
        (0.02, 5.0, 0.2),
        (0.3, 5.0, 0.3),
    ]:
        assert tick_period(wanted, spent, share=0.2) == pytest.approx(expected)


def test_an_error_names_a_port_that_is_in_use(graph):
    with socket.socket() as used:
        used.bind(('127.0.0.1', 0))
        used.listen()
        port = used.getsockname()[1]
        reason = f"host = '127.0.0.1' and port = {port} of live_view: .*set another port"
        with pytest.raises(ValueError, match=reason):
            graph.start(LiveView, {'port': port})
