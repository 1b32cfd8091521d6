# SPDX-License-Identifier: Apache-2.0
"""The parameters of a node can be read all at once, kept in a file and given to another."""

from typing import Any

import pytest
import yaml
from graphs import Graph
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

LISTS: dict[Any, dict[str, Any]] = {
    Simulator: {
        'fixed_rotors': ['rotor_0'],
        'sensors.offsets': [0.1] * 40,
        'chain.deviations.mass': [0.5] * 40,
    },
    EdgeActuator: {'joints': ['rotor_0', 'rotor_2'], 'torque_limits.rotor_2': 0.05},
    SolitonAnalyser: {'joint_names': ['left', 'right']},
    SolitonSteering: {'actuated_joints': ['rotor_0']},
    BagRecorder: {'topics': ['chain']},
    BagPlayer: {'topics': ['/chain']},
}


def dump(graph: Graph, node: Node) -> dict[str, Any]:
    """Return what `ros2 param dump` shows, by the names of the parameters."""
    name = node.get_fully_qualified_name()
    names = graph.call(ListParameters, f'{name}/list_parameters').result.names
    answer = graph.call(GetParameters, f'{name}/get_parameters', names=names)
    assert len(answer.values) == len(names)
    return dict(zip(names, map(parameter_value_to_python, answer.values), strict=True))


@pytest.mark.parametrize('create', LISTS, ids=lambda create: create.__name__)
def test_a_dump_of_all_parameters_makes_the_same_node_again(graph, create, needed, tmp_path):
    first = graph.start(create, {**needed.get(create, {}), **LISTS[create]})
    dumped = dump(graph, first)
    assert None not in dumped.values()
    path = tmp_path / 'dump.yaml'
    path.write_text(yaml.dump({first.get_fully_qualified_name(): {'ros__parameters': dumped}}))
    graph.stop(first)
    again = graph.start(create, cli_args=['--ros-args', '--params-file', str(path)])
    assert dump(graph, again) == dumped


def test_an_empty_list_is_allowed_on_the_command_line(graph):
    arguments = ['--ros-args', '-p', 'fixed_rotors:=[]', '-p', 'sensors.offsets:=[]']
    simulator = graph.start(Simulator, cli_args=arguments)
    assert simulator.settings.fixed_rotors == ()
    assert dump(graph, simulator)['sensors.offsets'] == []
