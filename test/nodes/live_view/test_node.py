# SPDX-License-Identifier: Apache-2.0
"""What the node says where it cannot serve its page."""

from __future__ import annotations

import socket
import sys

import pytest
from graphs import Graph

from soliton_linkage_nodes import live_view
from soliton_linkage_nodes.live_view.node import LiveView

pytest.importorskip('nicegui', reason='NiceGUI is not installed')


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
