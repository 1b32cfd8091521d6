# SPDX-License-Identifier: Apache-2.0
"""A signal ends every program without a trace while it is still starting."""

import os
import signal
import subprocess
import sys
from functools import partial
from importlib.metadata import distribution
from itertools import cycle
from pathlib import Path

import pytest
from programs import signalled

from soliton_linkage_nodes import start as programs

PROGRAMS = [name for name, value in vars(programs).items() if isinstance(value, partial)]


def test_these_are_the_programs():
    installed = distribution('soliton_linkage_nodes').entry_points
    assert installed.select(group='console_scripts').names == set(PROGRAMS)


def test_a_closed_pipe_ends_a_program_without_a_traceback():
    reading, writing = os.pipe()
    os.close(reading)
    call = 'from soliton_linkage_nodes.start import robot_description; robot_description()'
    config = Path(__file__).parents[2] / 'config/flipper.yaml'
    ended = subprocess.run(
        [sys.executable, '-c', call, str(config)], stdout=writing, stderr=subprocess.PIPE
    )
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (programs.CLOSED_PIPE, b'')


def test_linear_algebra_has_one_thread_unless_the_user_sets_another_number():
    call = (
        'import os, sys; from soliton_linkage_nodes.start import robot_description;'
        'assert "numpy" not in sys.modules; robot_description();'
        'print(os.environ["OPENBLAS_NUM_THREADS"])'
    )
    config = Path(__file__).parents[2] / 'config/flipper.yaml'
    others = {name: value for name, value in os.environ.items() if 'NUM_THREADS' not in name}
    for given, threads in [({}, b'1'), ({'OPENBLAS_NUM_THREADS': '2'}, b'2')]:
        found = subprocess.run(
            [sys.executable, '-c', call, str(config)],
            env={**others, **given},
            capture_output=True,
            check=True,
        )
        assert found.stdout.split()[-1] == threads


def file_of(program: str) -> str:
    """Return the end of the path of the module that a program runs."""
    return f'/{getattr(programs, program).args[0].replace(".", "/")}.py'


def test_a_signal_ends_every_program_that_is_being_imported(start):
    numbers = cycle([signal.SIGINT, signal.SIGTERM])
    given = list(zip(PROGRAMS, numbers, strict=False))
    running = [start(name, command=signalled(f'{file_of(name)}:<module>', n)) for name, n in given]
    for (name, number), program in zip(given, running, strict=True):
        assert program.wait() == -number, name
        assert program.said == [], name


@pytest.mark.parametrize(
    ('node', 'moment', 'code'),
    [
        ('simulator', 'numpy/__init__.py:<module>', -signal.SIGINT),
        ('edge_actuator', 'edge_actuator/node.py:configure', 0),
        ('edge_actuator', 'runtime/process.py:_spin', 0),
    ],
)
def test_a_signal_ends_a_node_wherever_its_start_has_got_to(start, node, moment, code):
    program = start(node, command=signalled(moment, signal.SIGINT))
    assert program.wait() == code
    assert all('[INFO]' in line for line in program.said), 'no trace and no complaint'
