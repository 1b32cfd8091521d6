# SPDX-License-Identifier: Apache-2.0
"""Child processes are started with a log, missed when they end, and never outlive their parent."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix
from programs import LONGEST_WAIT, until

from soliton_linkage_nodes.runtime.child_processes import ChildProcesses


@pytest.fixture
def children(graph, tmp_path):
    children = ChildProcesses(tmp_path / 'log')
    yield children
    children.stop()


@pytest.fixture
def environment(graph):
    return {**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)}


def test_one_process_stops_while_others_continue(children, environment, tmp_path):
    children.start('bag_recorder', ['-p', f'output:={tmp_path / "run"}'], environment)
    children.start('edge_actuator', [], environment)
    until(lambda: 'recording to' in children.output('bag_recorder'), 'the first words')
    children.check()
    assert not children.wait('bag_recorder', 0)
    assert children.stop(['bag_recorder']) == {'bag_recorder': 0}
    assert (tmp_path / 'run_0' / 'metadata.yaml').is_file()
    children.check()
    assert children.stop().keys() == {'edge_actuator'}


def test_one_that_ends_by_itself_is_missed_with_its_last_words(children, environment):
    children.start('bag_player', ['-p', 'bag:=nowhere'], environment)
    with pytest.raises(RuntimeError, match='bag_player ended with exit code 1') as failure:
        until(lambda: bool(children.check()), 'its end')
    assert "bag 'nowhere' does not exist" in str(failure.value)
    for end in (children.ended, lambda: children.wait('bag_player', LONGEST_WAIT)):
        with pytest.raises(RuntimeError, match='bag_player ended with exit code 1'):
            end()


def test_one_that_does_not_heed_the_interrupt_is_killed(children, environment, tmp_path):
    output = f'output:={tmp_path / "run"}'
    children.start('bag_recorder', ['-p', output], environment)
    until(lambda: 'recording to' in children.output('bag_recorder'), 'the first words')
    os.kill(process_with(output), signal.SIGSTOP)
    assert children.stop() == {'bag_recorder': -signal.SIGKILL}


def test_none_outlives_a_parent_that_was_killed(graph, tmp_path):
    parent = """
import os, signal, sys
from pathlib import Path
from soliton_linkage_nodes.runtime.child_processes import ChildProcesses
children = ChildProcesses(Path(sys.argv[1]))
children.start('edge_actuator', [], dict(os.environ))
print('started', flush=True)
signal.pause()
"""
    process = subprocess.Popen(
        [sys.executable, '-c', parent, str(tmp_path)],
        env={**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == 'started\n'
    number = Path(f'/proc/{process.pid}/task/{process.pid}/children').read_text(encoding='ascii')
    child = Path('/proc', number.strip())
    executable = Path(get_package_prefix('soliton_linkage_nodes'), 'lib', 'soliton_linkage_nodes')
    name = str(executable / 'edge_actuator').encode()
    until(lambda: name in (child / 'cmdline').read_bytes(), 'the child')
    process.kill()
    process.communicate()
    until(lambda: gone(child), 'the end of the child')


def process_with(argument: str) -> int:
    """Return the number of the process that has an argument in its command line."""
    own = (path for path in Path('/proc').glob('[0-9]*') if int(path.name) != os.getpid())
    (found,) = [path for path in own if argument.encode() in command_line(path)]
    return int(found.name)


def command_line(process: Path) -> bytes:
    try:
        return (process / 'cmdline').read_bytes()
    except OSError:
        return b''


def gone(process: Path) -> bool:
    """Whether a process is no more, or only waits to be reaped."""
    try:
        return (process / 'stat').read_text(encoding='ascii').rpartition(')')[2].split()[0] == 'Z'
    except OSError:
        return True
