# SPDX-License-Identifier: Apache-2.0
"""The node as a process: where it listens, who it lets in, and how it ends."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from graphs import Graph
from live_stage import until

from soliton_linkage_nodes import live_view
from soliton_linkage_nodes.live_view.node import LiveView

pytest.importorskip('nicegui', reason='NiceGUI is not installed')

RUN = 'from soliton_linkage_nodes.start import live_view; live_view()'


class Served:
    """The page as a process."""

    def __init__(self, graph: Graph, log: Path, *parameters: str) -> None:
        self._log = log
        arguments = [part for each in parameters for part in ('-p', each)]
        with log.open('wb') as stream:
            self.process = subprocess.Popen(
                [sys.executable, '-c', RUN, '--ros-args', *arguments],
                env={**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)},
                cwd=log.parent,
                stdout=stream,
                stderr=subprocess.STDOUT,
            )

    @property
    def said(self) -> str:
        return self._log.read_text()

    @property
    def address(self) -> str:
        found = until(lambda: re.search(r'open (http://\S+)', self.said), 'the address')
        return str(found[1])


@pytest.fixture
def open_to_all(graph: Graph, tmp_path: Path) -> Iterator[Served]:
    served = Served(graph, tmp_path / 'log', 'host:=0.0.0.0', 'port:=0', 'read_only:=true')
    yield served
    served.process.kill()
    served.process.wait()


def ask(address: str, **headers: str) -> tuple[int, str]:
    request = urllib.request.Request(address, headers=headers)
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    try:
        with opener.open(request, timeout=30) as answer:
            return int(answer.status), answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def test_a_host_that_others_reach_needs_the_token_that_it_prints(open_to_all: Served) -> None:
    address = open_to_all.address
    port = int(re.search(r':(\d+)/', address)[1])
    token = re.search(r'token=(.+)', address)[1]
    assert len(token) >= 32
    here = f'http://127.0.0.1:{port}'
    status, page = ask(f'{here}/?token={token}')
    assert status == 200
    assert 'Soliton, live' in page
    for path in ('', 'live/live.js', f'?token={token[:-1]}', '_nicegui_ws/socket.io/?EIO=4'):
        status, said = ask(f'{here}/{path}')
        assert status == 403, path
        assert 'the token is missing or wrong' in said
    status, said = ask(f'{here}/?token={token}', Origin='http://evil.example')
    assert status == 403
    assert 'is not this page' in said
    assert open_to_all.said.count(token) == 1
    open_to_all.process.send_signal(signal.SIGINT)
    assert open_to_all.process.wait(20) == 0
    assert 'Traceback' not in open_to_all.said


def test_a_port_that_is_taken_is_said_in_one_line(graph: Graph) -> None:
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        said = f"host = '127.0.0.1' and port = {port} of live_view: .*give another port"
        with pytest.raises(ValueError, match=said):
            graph.start(LiveView, {'port': port})


def test_without_nicegui_it_says_what_to_install(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith('soliton_linkage_nodes.live')]:
        if name.endswith(('page', 'controls')) or '.controls' in name:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(live_view, 'page', raising=False)
    monkeypatch.setitem(sys.modules, 'nicegui', None)
    said = 'live_view needs the Python package nicegui, .* run: pip install nicegui'
    with pytest.raises(ValueError, match=said):
        graph.start(LiveView, {'port': 0})
