# SPDX-License-Identifier: Apache-2.0
"""The simulated chain with actuator, analyser and steering, and a recorder if asked for."""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = 'soliton_linkage_nodes'


def generate_launch_description():
    """Return the nodes, all in one namespace and with one parameter file."""
    config = LaunchConfiguration('config')
    record = LaunchConfiguration('record')
    common = {
        'package': PACKAGE,
        'namespace': LaunchConfiguration('namespace'),
        'output': 'screen',
        'ros_arguments': [
            PythonExpression(["'--params-file' if '", config, "' else '--log-level'"]),
            PythonExpression(["'", config, "' or 'info'"]),
        ],
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'config', default_value='', description='parameter file, as config/flipper.yaml'
            ),
            DeclareLaunchArgument('namespace', default_value='', description='of all nodes'),
            DeclareLaunchArgument(
                'record',
                default_value='',
                description='bag to record, _0 is added; empty for none',
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
