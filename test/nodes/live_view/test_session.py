# SPDX-License-Identifier: Apache-2.0
"""The program live keeps its nodes running and prints an address that can be opened."""

import os
import signal
from pathlib import Path

import pytest

from soliton_linkage_nodes.live_view import session
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.child_processes import ChildProcesses

SLOW = """
/**: {ros__parameters: {chain.number_of_rotors: 8}}
/**/simulator: {ros__parameters: {publish_rate: 10.0}}
"""


def test_a_killed_node_is_started_again_and_named(graph, start, tmp_path):
    states, reports = graph.hear(interfaces.SOLITON_STATE), graph.reports('edge_actuator')
    config = tmp_path / 'slow.yaml'
    config.write_text(SLOW)
    options = ('--output', str(tmp_path / 'out'), '--port', '0', '--no-browser')
    program = start('live', str(config), *options)
    graph.until(lambda: states, 'the first state')
    graph.until(lambda: any('http://' in line for line in program.said), 'the address')
    (address,) = [line.strip() for line in program.said if 'http://' in line]
    assert address.endswith('/')
    folder = f'/proc/{program.process.pid}/task/{program.process.pid}'
    children = [int(pid) for pid in Path(folder, 'children').read_text().split()]
    (actuator,) = [
        pid for pid in children if b'edge_actuator' in Path(f'/proc/{pid}/cmdline').read_bytes()
    ]
    os.kill(actuator, signal.SIGKILL)
    graph.until(
        lambda: 'edge_actuator ended with exit code -9; restarting it.' in program.said,
        'the restart',
    )
    reports.clear()
    graph.until(lambda: reports, 'a report of the new actuator')
    assert program.stop() == 130


def test_a_node_that_cannot_start_ends_the_program(graph, tmp_path, monkeypatch, capsys):
    class SimulatorAndPage(ChildProcesses):
        def start(self, node, *given):
            if node in ('simulator', 'live_view'):
                super().start(node, *given)

    wrong = tmp_path / 'wrong.yaml'
    wrong.write_text('/**/simulator: {ros__parameters: {chain.spacing: -1.0}}')
    options = ['--output', str(tmp_path / 'out'), '--port', '0', '--no-browser']
    monkeypatch.setattr(session, 'ChildProcesses', SimulatorAndPage)
    monkeypatch.setattr('sys.argv', ['live', str(wrong), *options])
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.domain))
    with pytest.raises(SystemExit, match='1'):
        session.main()
    assert 'simulator ended with exit code 1' in capsys.readouterr().err
