# SPDX-License-Identifier: Apache-2.0
import sys

import pytest

from soliton_linkage_nodes import live_view
from soliton_linkage_nodes.camera_encoders.node import CameraEncoders
from soliton_linkage_nodes.foxglove_server.node import FoxgloveServer
from soliton_linkage_nodes.live_view.node import LiveView
from soliton_linkage_nodes.serial_encoders.node import SerialEncoders

IMPORTERS = ('page', 'controls', 'serving', 'outgoing')


@pytest.mark.parametrize(
    ('node_type', 'package', 'words'),
    [
        (CameraEncoders, 'cv2', r'need OpenCV.*pip install opencv-python'),
        (FoxgloveServer, 'foxglove', r'package foxglove.*pip install foxglove-sdk'),
        (LiveView, 'nicegui', r'needs the Python package nicegui, .*: pip install nicegui'),
        (SerialEncoders, 'serial', r'need pyserial.*pip install pyserial'),
    ],
)
def test_an_error_in_one_line_names_the_missing_package(
    graph, monkeypatch, node_type, package, words
):
    for name in list(sys.modules):
        folder, _, module = name.removeprefix('soliton_linkage_nodes.').partition('.')
        if folder in ('live_view', 'foxglove_server') and module.split('.')[0] in IMPORTERS:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr(live_view, 'page', raising=False)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ValueError, match=words) as raised:
        graph.start(node_type)
    assert '\n' not in str(raised.value)
