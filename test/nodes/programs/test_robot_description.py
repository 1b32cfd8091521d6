# SPDX-License-Identifier: Apache-2.0
"""The URDF of a parameter file equals the URDF from the visualisation node."""

import sys
from pathlib import Path

import pytest
import yaml
from urdf_parser_py.urdf import URDF

from soliton_linkage_nodes.programs import robot_description as program
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.visualisation.node import Visualisation

CONFIG = Path(__file__).parents[3] / 'config' / 'spinner.yaml'


def test_program_and_node_describe_a_chain_alike(graph, capsys, monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['robot_description', str(CONFIG)])
    program.main()
    printed = capsys.readouterr().out
    held = yaml.safe_load(CONFIG.read_text())['/**']['ros__parameters']
    values = {name: value for name, value in held.items() if name.startswith('chain.')}
    graph.start(Visualisation, {'chain_from': 'parameters', **values})
    heard = graph.hear(interfaces.ROBOT_DESCRIPTION)
    graph.until(lambda: heard, 'a description')
    assert heard[0].data == printed.removesuffix('\n')


def test_limits_of_a_file_are_those_of_the_joints(tmp_path):
    file = tmp_path / 'limited.yaml'
    file.write_text('/**: {ros__parameters: {chain.number_of_rotors: 3, limits.torque: 0.5}}')
    robot = URDF.from_xml_string(program.description_of_file(file))
    assert [(j.limit.effort, j.limit.velocity) for j in robot.joints] == 3 * [(0.5, 100.0)]


def test_an_invalid_parameter_file_is_reported_in_one_line(capsys, monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['robot_description', '/no/such.yaml'])
    with pytest.raises(SystemExit) as raised:
        program.main()
    assert '/no/such.yaml' in str(raised.value)
    assert '\n' not in str(raised.value)
