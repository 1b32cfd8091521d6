# SPDX-License-Identifier: Apache-2.0
"""Nodes in one process behave as in separate processes."""

import sys
from typing import Any

import pytest
from graphs import values

from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.programs import suite
from soliton_linkage_nodes.programs.suite import NODES, addressed, of_one_chain
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

CLASSES = {
    'simulator': Simulator,
    'edge_actuator': EdgeActuator,
    'soliton_steering': SolitonSteering,
}


def test_five_nodes_in_one_process_as_in_their_own(graph, start, tmp_path):
    nodes = of_one_chain([])
    reports = {node: graph.reports(node) for node in nodes}
    program = start(
        'suite',
        *('--ros-args', '-r', '__ns:=/left', '-p', f'output:={tmp_path / "run"}'),
        *('-p', 'publish_rate:=100.0', '-p', 'chain.number_of_rotors:=8'),
    )
    graph.until(
        lambda: all(reports.values()) and int(values(reports['simulator'][-1])['frames']) > 10,
        'a report of every node',
    )
    for node, told in reports.items():
        assert told[-1].hardware_id == f'/left/{node}'
    assert program.stop() == 0
    for node in nodes:
        assert any(f'[left.{node}]' in line for line in program.said), node
    assert program.said[-1].endswith(', 0 lost')
    assert (tmp_path / 'run_0/metadata.yaml').exists()


def given_to(*rules: str) -> tuple[list[str], dict[str, dict[str, Any]]]:
    """Return the remaining rules and the parameters of each node."""
    arguments = [part for rule in rules for part in ('-p', rule)]
    rest, given = addressed(['suite', '--ros-args', *arguments], CLASSES)
    return rest[2:], {
        node: {parameter.name: parameter.value for parameter in parameters}
        for node, parameters in given.items()
        if parameters
    }


def test_a_parameter_goes_to_the_nodes_that_have_it():
    rest, given = given_to('publish_rate:=100.0', 'torque_limit:=1e-3', 'joints:=[a, b]')
    assert rest == []
    assert given == {
        'simulator': {'publish_rate': 100.0, 'torque_limit': 1e-3},
        'edge_actuator': {'torque_limit': 1e-3, 'joints': ['a', 'b']},
        'soliton_steering': {'torque_limit': 1e-3},
    }


def test_a_parameter_may_be_for_one_node_in_any_namespace():
    _, given = given_to('edge_actuator:torque_limit:=2', 'torque_limits.rotor_3:=0.1')
    assert given == {'edge_actuator': {'torque_limit': 2, 'torque_limits.rotor_3': 0.1}}


def test_nodes_of_several_chains_are_in_their_namespaces(graph, monkeypatch):
    names = ['right/soliton_analyser', 'left/soliton_analyser', 'left/edge_actuator']
    constructors: list[Any] = []
    monkeypatch.setattr(suite, 'run_together', lambda those, _: constructors.extend(those))
    rule = ['--ros-args', '-p', 'left/edge_actuator:torque_limit:=2.0']
    monkeypatch.setattr(sys, 'argv', ['suite', *names, *rule])
    suite.main()
    nodes = [graph.start(create) for create in constructors]
    assert {node.get_fully_qualified_name() for node in nodes} == {f'/{name}' for name in names}
    given = [each.keywords['parameter_overrides'] for each in constructors]
    assert [[(own.name, own.value) for own in each] for each in given if each] == [
        [('torque_limit', 2.0)]
    ]


def test_a_parameter_may_be_for_a_node_of_one_chain_or_of_all():
    classes = {f'{chain}/edge_actuator': EdgeActuator for chain in ('left', 'right')}
    rules = ['-p', 'left/edge_actuator:torque_limit:=2.0', '-p', 'edge_actuator:joints:=[a]']
    rest, given = addressed(rules, classes)
    told = {name: {each.name: each.value for each in all_} for name, all_ in given.items()}
    assert (rest, told['left/edge_actuator']) == ([], {'torque_limit': 2.0, 'joints': ['a']})
    assert told['right/edge_actuator'] == {'joints': ['a']}


def test_a_port_puts_a_controller_in_the_place_of_the_simulator():
    for rule, without in [
        ('port:=/dev/ttyACM0', 'simulator'),
        ('serial_encoders:port:=/dev/ttyACM0', 'simulator'),
        ('serial_encoders:port:=', 'serial_encoders'),
        ('export:=/dev/ttyACM0', 'serial_encoders'),
    ]:
        assert of_one_chain(['suite', '--ros-args', '-p', rule]) == [
            name for name in NODES if name != without
        ]


def test_serial_encoders_publishes_the_chain_unless_configured_otherwise(graph, monkeypatch):
    constructors: list[Any] = []
    monkeypatch.setattr(suite, 'run_together', lambda those, _: constructors.extend(those))
    for rules, source in (
        (['-p', 'port:=/dev/ttyACM0'], ['parameters']),
        (['-p', 'port:=/dev/ttyACM0', '-p', 'chain_from:=topic'], ['parameters', 'topic']),
    ):
        constructors.clear()
        monkeypatch.setattr(sys, 'argv', ['suite', '--ros-args', *rules])
        suite.main()
        given = constructors[-1].keywords['parameter_overrides']
        assert [each.value for each in given if each.name == 'chain_from'] == source


def test_a_rule_for_no_node_is_passed_to_ros():
    for rule in ['nonsense:=1', 'use_sim_time:=true', 'other:publish_rate:=1.0']:
        assert given_to(rule) == (['-p', rule], {})


def test_an_invalid_node_list_is_rejected_on_one_line(monkeypatch, capsys):
    for arguments, complaint in [
        (['encoders'], "unknown node 'encoders'; choose from simulator, serial_encoders"),
        (['left/simulator', '--ros-args', '-r', '__ns:=/lab'], '__ns:= applies to all nodes'),
    ]:
        monkeypatch.setattr(sys, 'argv', ['suite', *arguments])
        with pytest.raises(SystemExit):
            suite.main()
        assert complaint in capsys.readouterr().err
