# SPDX-License-Identifier: Apache-2.0
"""The simulated chain with actuator, analyser, steering and pictures; a recorder if asked for."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitution import Substitution
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = 'soliton_linkage_nodes'
CONFIGURATIONS = Path(get_package_share_directory(PACKAGE), 'config')
NAMES = sorted(path.stem for path in CONFIGURATIONS.glob('*.yaml'))


class ConfigurationFile(Substitution):
    """Path of the file that `config:=` names, or is."""

    def perform(self, context):
        """Return the path; raises ValueError where there is none."""
        config = context.perform_substitution(LaunchConfiguration('config'))
        path = CONFIGURATIONS / f'{config}.yaml' if config in NAMES else Path(config)
        if not path.is_file():
            raise ValueError(
                f'config:={config} is no file and none of {", ".join(NAMES)}; '
                f'files are looked for from {Path.cwd()}'
            )
        return str(path)


def generate_launch_description():
    """Return the nodes, all in one namespace and with one parameter file."""
    record = LaunchConfiguration('record')
    common = {
        'package': PACKAGE,
        'namespace': LaunchConfiguration('namespace'),
        'output': 'screen',
        'ros_arguments': ['--params-file', ConfigurationFile()],
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'config',
                default_value='flipper',
                description=f'parameters: {", ".join(NAMES)}, or the path of a file like them',
            ),
            DeclareLaunchArgument('namespace', default_value='', description='of all nodes'),
            DeclareLaunchArgument(
                'record',
                default_value='',
                description='bag to record, _0 is added; empty for none',
            ),
            DeclareLaunchArgument(
                'draw',
                default_value='true',
                choices=['true', 'false'],
                description='whether to draw the chain for viewers',
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(str(Path(__file__).with_name('view.launch.py'))),
                condition=IfCondition(LaunchConfiguration('draw')),
            ),
            *(
                Node(executable=name, **common)
                for name in ('simulator', 'edge_actuator', 'soliton_analyser', 'soliton_steering')
            ),
            Node(
                executable='bag_recorder',
                parameters=[{'output': record}],
                condition=IfCondition(PythonExpression(["'", record, "' != ''"])),
                **common,
            ),
        ]
    )
