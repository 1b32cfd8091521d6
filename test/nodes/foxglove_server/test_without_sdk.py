# SPDX-License-Identifier: Apache-2.0
import sys

import pytest

from soliton_linkage_nodes.foxglove_server.node import FoxgloveServer


def test_an_error_in_one_line_names_the_missing_package(graph, monkeypatch):
    monkeypatch.setitem(sys.modules, 'foxglove', None)
    for name in ('serving', 'outgoing'):
        monkeypatch.delitem(sys.modules, f'soliton_linkage_nodes.foxglove_server.{name}', False)
    with pytest.raises(ValueError, match=r'package foxglove.*pip install foxglove-sdk') as raised:
        graph.start(FoxgloveServer)
    assert '\n' not in str(raised.value)
