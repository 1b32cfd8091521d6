# SPDX-License-Identifier: Apache-2.0
import socket
import sys

import pytest

from soliton_linkage_nodes import live_view
from soliton_linkage_nodes.live_view.node import LiveView


def test_an_error_names_a_port_that_is_in_use(graph):
    pytest.importorskip('nicegui', reason='needs NiceGUI: pip install nicegui')
    with socket.socket() as used:
        used.bind(('127.0.0.1', 0))
        used.listen()
        port = used.getsockname()[1]
        reason = f"host = '127.0.0.1' and port = {port} of live_view: .*set another port"
        with pytest.raises(ValueError, match=reason):
            graph.start(LiveView, {'port': port})


def test_an_error_names_the_missing_package(graph, monkeypatch):
    for name in [name for name in sys.modules if name.startswith('soliton_linkage_nodes.live')]:
        if name.endswith(('page', 'controls')) or '.controls' in name:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(live_view, 'page', raising=False)
    monkeypatch.setitem(sys.modules, 'nicegui', None)
    reason = 'live_view needs the Python package nicegui, .* run: pip install nicegui'
    with pytest.raises(ValueError, match=reason):
        graph.start(LiveView, {'port': 0})
