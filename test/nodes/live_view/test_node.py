# SPDX-License-Identifier: Apache-2.0
import socket

import pytest

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
