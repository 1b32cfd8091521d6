# SPDX-License-Identifier: Apache-2.0
"""Parameter files name the nodes they apply to, and a node logs which values it uses."""

import re
from pathlib import Path

import pytest
from rclpy.node import Node

from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.runtime.parameter_files import matches, notices, read_sections
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

CONFIG = Path(__file__).parents[3] / 'config'
MINE = '/**/simulator: {ros__parameters: {publish_rate: 250.0}}\n'
ALL = '/**: {ros__parameters: {chain.spacing: 0.2}}\n'


def test_which_nodes_a_section_is_for(graph, tmp_path):
    for pattern, node, named in [
        ('simulator', '/simulator', True),
        ('/simulator', '/simulator', True),
        ('/simulator', '/left/simulator', False),
        ('/left/simulator', '/left/simulator', True),
        ('/**', '/a/b/simulator', True),
        ('/**/simulator', '/simulator', True),
        ('/**/simulator', '/a/b/simulator', True),
        ('/**/simulator', '/simulator_2', False),
        ('/*/simulator', '/left/simulator', True),
        ('/*/simulator', '/simulator', False),
        ('/*', '/simulator', True),
    ]:
        assert matches(pattern, node) == named
        path = tmp_path / 'file.yaml'
        path.write_text(f'{pattern}: {{ros__parameters: {{x: 5}}}}\n')
        namespace, _, name = node.rpartition('/')
        started = graph.start(
            Node,
            node_name=name,
            namespace=namespace,
            cli_args=['--ros-args', '--params-file', str(path)],
            automatically_declare_parameters_from_overrides=True,
        )
        assert started.has_parameter('x') == named, 'ROS has it otherwise'


def test_names_are_joined(tmp_path):
    path = tmp_path / 'file.yaml'
    path.write_text('left:\n  simulator:\n    ros__parameters: {gravity: {tilt: 0.1}, x: []}\n')
    assert read_sections(path) == {'/left/simulator': {'gravity.tilt': 0.1, 'x': []}}


def test_an_invalid_parameter_file_is_rejected(tmp_path):
    for content in ['words', 'a: 1', '', '- 1', '{', 'a\nb: c', 'node: {x: 1.0}']:
        path = tmp_path / 'file.yaml'
        path.write_text(content)
        with pytest.raises(
            ValueError, match=f'{re.escape(str(path))} is no parameter file'
        ) as said:
            read_sections(path)
        assert '\n' not in str(said.value)


@pytest.mark.parametrize('namespace', ['', 'left', 'left/hand'])
def test_the_files_of_the_suite_work_in_every_namespace(graph, namespace):
    arguments = ['--ros-args', '--params-file', str(CONFIG / 'wobbler.yaml')]
    node = graph.start(Simulator, namespace=namespace, cli_args=arguments)
    assert node.settings.publish_rate == 250.0
    assert node.named.rotors == 20
    assert list(notices(node, arguments)) == []


@pytest.mark.parametrize(
    ('content', 'rules', 'rate', 'told'),
    [
        (MINE + ALL, [], 250.0, None),
        (MINE + ALL, ['publish_rate:=50'], 50.0, '-p publish_rate:=50 overrides publish_rate = '),
        (MINE + ALL, ['simulator:publish_rate:=50'], 50.0, 'overrides publish_rate = 250.0 of'),
        (MINE + ALL, ['analyser:publish_rate:=50'], 250.0, None),
        (
            ALL + MINE,
            ['publish_rate:=50'],
            250.0,
            'overrides -p publish_rate:=50; write -p simulator:publish_rate:=50 after it',
        ),
        ('other: {ros__parameters: {x: 1}}', [], 500.0, 'parameters for /other, not for /simulat'),
    ],
)
def test_overridden_values_are_logged(graph, tmp_path, content, rules, rate, told):
    path = tmp_path / 'file.yaml'
    path.write_text(content)
    given = [argument for rule in rules for argument in ('-p', rule)]
    arguments = ['--ros-args', '--params-file', str(path), *given]
    node = graph.start(Simulator, cli_args=arguments)
    assert node.settings.publish_rate == rate
    said = [text for text, _ in notices(node, arguments)]
    assert len(said) == (told is not None)
    assert all(told is not None and told in text and str(path) in text for text in said)


def test_a_file_for_a_node_of_the_same_process_is_no_mistake(graph, tmp_path):
    path = tmp_path / 'file.yaml'
    path.write_text(MINE)
    arguments = ['--ros-args', '--params-file', str(path)]
    simulator = graph.start(Simulator, cli_args=arguments)
    actuator = graph.start(EdgeActuator, cli_args=arguments)
    assert list(notices(actuator, arguments, [simulator, actuator])) == []
    assert [warning for _, warning in notices(actuator, arguments)] == [True]


@pytest.mark.parametrize('create', [Simulator, SolitonSteering])
def test_each_node_rejects_unknown_parameters_of_the_chain(graph, create):
    with pytest.raises(ValueError, match=r"unknown; did you mean 'chain\.spacing'\?"):
        graph.start(create, cli_args=['--ros-args', '-p', 'chain.spacng:=0.1'])


def test_a_recorder_takes_the_file_of_a_chain(graph, tmp_path):
    file = str(CONFIG / 'flipper.yaml')
    arguments = ['--ros-args', '--params-file', file, '-p', f'output:={tmp_path / "run"}']
    node = graph.start(BagRecorder, cli_args=arguments)
    assert list(notices(node, arguments)) == []
