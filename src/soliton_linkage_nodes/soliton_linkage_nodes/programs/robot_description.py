# SPDX-License-Identifier: Apache-2.0
"""Print the chain of a parameter file as URDF, for MuJoCo, Gazebo or robot_state_publisher."""

from __future__ import annotations

from pathlib import Path

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.urdf import JointLimits, robot_description
from soliton_linkage_nodes.messages.chain_source import ParameterFile, chain_of_file
from soliton_linkage_nodes.programs.command_line import exit_on_failure


def main() -> None:
    """Print the URDF of the chain in the parameter file."""
    parser = PlainParser(prog='robot_description', description=__doc__)
    parser.add_argument('config', type=Path, help='parameter file such as config/flipper.yaml')
    with exit_on_failure('robot_description'):
        print(description_of_file(parser.parse().config))


def description_of_file(path: Path) -> str:
    """Return the URDF of the chain in a parameter file; ValueError if it has no chain."""
    named = chain_of_file(path)
    limits = ParameterFile(path).read(JointLimits, 'limits.')
    return robot_description(named.chain, named.joint_names, limits)
