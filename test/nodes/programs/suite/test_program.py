# SPDX-License-Identifier: Apache-2.0
"""The nodes of the suite in one process are the nodes that they are alone."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from graphs import Graph, values
from programs import Program

from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.programs.suite import program as suite
from soliton_linkage_nodes.programs.suite.program import NODES, addressed
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

CLASSES = {
    'simulator': Simulator,
    'edge_actuator': EdgeActuator,
    'soliton_steering': SolitonSteering,
}


def test_five_nodes_in_one_process_as_in_their_own(
    graph: Graph, start: Callable[..., Program], tmp_path: Path
) -> None:
    reports = {node: graph.reports(node) for node in NODES}
    program = start(
        'suite',
        *('--ros-args', '-r', '__ns:=/left', '-p', f'output:={tmp_path / "run"}'),
        *('-p', 'publish_rate:=100.0', '-p', 'chain.number_of_rotors:=8'),
    )
    graph.until(
        lambda: all(reports.values()) and int(values(reports['simulator'][-1])['frames']) > 100,
        'a report of every node',
    )
    for node, told in reports.items():
        assert told[-1].hardware_id == f'/left/{node}'
    assert program.stop() == 0
    for node in NODES:
        assert any(f'[left.{node}]' in line for line in program.said), node
    assert program.said[-1].endswith(', 0 lost')
    assert (tmp_path / 'run_0/metadata.yaml').exists()


def test_a_parameter_goes_to_the_nodes_that_have_it() -> None:
    rules = ['-p', 'publish_rate:=100.0', '-p', 'torque_limit:=1.0']
    given = ['suite', '--ros-args', *rules, '--params-file', 'x']
    assert list(addressed(given, CLASSES)) == [
        *('suite', '--ros-args', '-p', 'simulator:publish_rate:=100.0'),
        *('-p', 'simulator:torque_limit:=1.0', '-p', 'edge_actuator:torque_limit:=1.0'),
        *('-p', 'soliton_steering:torque_limit:=1.0', '--params-file', 'x'),
    ]


@pytest.mark.parametrize(
    'rule', ['simulator:publish_rate:=1.0', 'nonsense:=1', 'use_sim_time:=true']
)
def test_a_rule_that_names_its_node_or_is_for_none_stays(rule: str) -> None:
    assert list(addressed(['--param', rule], CLASSES)) == ['--param', rule]


def test_limits_of_joints_go_to_the_actuator() -> None:
    (_, rule) = addressed(['-p', 'torque_limits.rotor_3:=0.1'], CLASSES)
    assert rule == 'edge_actuator:torque_limits.rotor_3:=0.1'


def test_a_node_that_there_is_not_is_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, 'argv', ['suite', 'encoders'])
    with pytest.raises(SystemExit):
        suite.main()
    assert "'encoders' is none of simulator, edge_actuator" in capsys.readouterr().err
