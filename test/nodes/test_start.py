# SPDX-License-Identifier: Apache-2.0
"""A signal ends every program without a trace while it is still starting."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from importlib.metadata import distribution

import pytest
from programs import Program, signalled

from soliton_linkage_nodes import start as programs

NODES = (
    'simulator',
    'edge_actuator',
    'soliton_analyser',
    'soliton_steering',
    'chain_identifier',
    'bag_recorder',
    'bag_player',
    'live_view',
    'visualisation',
    'foxglove_server',
    'camera_encoders',
    'serial_encoders',
    'suite',
)
TOOLS = (
    'analyse_bag',
    'calibrate_camera',
    'check_bag',
    'contraction',
    'experiment',
    'film_encoders',
    'identify_chain',
    'live',
    'move_soliton',
    'nudge',
    'print_markers',
    'recover_bag',
    'robot_description',
    'simulated_controller',
    'watch_soliton',
)


def test_these_are_the_programs() -> None:
    installed = distribution('soliton_linkage_nodes').entry_points
    assert installed.select(group='console_scripts').names == {*NODES, *TOOLS}


def file_of(program: str) -> str:
    """Return the end of the path of the module that a program runs."""
    return f'/{getattr(programs, program).args[0].replace(".", "/")}.py'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_every_program_that_is_being_imported(
    start: Callable[..., Program], number: signal.Signals
) -> None:
    running = {
        name: start(name, command=signalled(f'{file_of(name)}:<module>', number))
        for name in (*NODES, *TOOLS)
    }
    for name, program in running.items():
        assert program.wait() == (130 if name in TOOLS else 0), name
        assert program.said == [], name


@pytest.mark.parametrize(
    ('node', 'moment'),
    [
        ('soliton_analyser', 'numpy/__init__.py:<module>'),
        ('soliton_analyser', 'soliton_analyser/node.py:__init__'),
        ('edge_actuator', 'runtime/process.py:stop_on_signals'),
        ('edge_actuator', 'runtime/process.py:_spin'),
    ],
)
def test_a_signal_ends_a_node_wherever_its_start_has_got_to(
    start: Callable[..., Program], node: str, moment: str
) -> None:
    program = start(node, command=signalled(moment, signal.SIGINT))
    assert program.wait() == 0
    assert all('[INFO]' in line for line in program.said), 'no trace and no complaint'


@pytest.mark.parametrize(
    ('limit', 'needed'),
    [('as=400000000', '1572864 KiB of address space'), ('nofile=40', '64 open files')],
)
def test_a_node_that_may_have_too_little_says_so_before_it_begins(
    start: Callable[..., Program], limit: str, needed: str
) -> None:
    program = start('bag_recorder', command=['prlimit', f'--{limit}'])
    assert program.wait() == 1
    (line,) = program.said
    assert line.startswith(f'bag_recorder: a node needs {needed}, more than it may have; raise ')


def test_a_node_that_may_have_too_few_threads_says_so_before_it_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, 'start', refuse)
    monkeypatch.setattr(signal, 'signal', lambda *_: None)
    with pytest.raises(SystemExit, match='a node needs 24 threads, more than it may have'):
        programs.simulator()
