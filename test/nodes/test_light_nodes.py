# SPDX-License-Identifier: Apache-2.0
"""Programs without integration start fast and use little memory: they do not import scipy."""

import subprocess
import sys

from soliton_linkage_nodes import start as programs

LIGHT = (
    'edge_actuator',
    'bag_recorder',
    'bag_player',
    'live_view',
    'visualisation',
    'foxglove_server',
    'check_bag',
    'experiment',
    'live',
    'move_soliton',
    'nudge',
    'recover_bag',
    'robot_description',
    'serial_encoders',
    'watch_soliton',
)
HEAVY = {'matplotlib', 'numba', 'scipy'}

_IMPORTED = """
import sys
from importlib import import_module

import soliton_linkage as sl

for name in sys.argv[1:]:
    import_module(f'soliton_linkage_nodes.{name}')
chain = sl.Chain(number_of_rotors=8)
sl.edge_mode(chain, chain.uniform_state(-1), sl.Edge.FIRST)
print(*{name.partition('.')[0] for name in sys.modules})
"""


def test_nodes_without_integration_import_no_scipy():
    modules = [getattr(programs, name).args[0] for name in LIGHT]
    command = [sys.executable, '-c', _IMPORTED, *modules]
    imported = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert 'numpy' in imported
    assert not HEAVY & set(imported)
