# SPDX-License-Identifier: Apache-2.0
"""The program live keeps its nodes running and prints an address that can be opened."""

import os
import signal
import sys
from pathlib import Path

import pytest

from soliton_linkage_nodes.live_view import session
from soliton_linkage_nodes.runtime.child_processes import ChildProcesses

ACTUATOR_AND_PAGE = """
import runpy, sys
from soliton_linkage_nodes.live_view import session

class ActuatorAndPage(session.ChildProcesses):
    def start(self, node, *given):
        if node in ('edge_actuator', 'live_view'):
            super().start(node, *given)

session.ChildProcesses = ActuatorAndPage
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name='__main__')
"""


def test_a_killed_node_is_started_again_and_named(graph, start, tmp_path):
    reports = graph.reports('edge_actuator')
    config = tmp_path / 'empty.yaml'
    config.write_text('{}')
    options = ('--output', str(tmp_path / 'out'), '--port', '0', '--no-browser')
    command = [sys.executable, '-c', ACTUATOR_AND_PAGE]
    program = start('live', str(config), *options, command=command)
    graph.until(lambda: reports, 'a report of the actuator')
    graph.until(lambda: any('http://' in line for line in program.said), 'the address')
    (address,) = [line.strip() for line in program.said if 'http://' in line]
    assert address.endswith('/')
    for node in ('simulator', 'edge_actuator', 'soliton_analyser', 'soliton_steering'):
        assert node in program.said[0]
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
    class OnlySimulator(ChildProcesses):
        def start(self, node, *given):
            if node == 'simulator':
                super().start(node, *given)

        def output(self, node):
            return super().output(node) if node == 'simulator' else ''

    wrong = tmp_path / 'wrong.yaml'
    wrong.write_text('/**/simulator: {ros__parameters: {chain.spacing: -1.0}}')
    options = ['--output', str(tmp_path / 'out'), '--port', '0', '--no-browser']
    monkeypatch.setattr(session, 'ChildProcesses', OnlySimulator)
    monkeypatch.setattr('sys.argv', ['live', str(wrong), *options])
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.domain))
    with pytest.raises(SystemExit, match='1'):
        session.main()
    assert 'simulator ended with exit code 1' in capsys.readouterr().err
