# SPDX-License-Identifier: Apache-2.0
"""Launch the nodes of a simulated or real chain: actuator, analyser, steering, visualisation."""

from itertools import pairwise
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessStart
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from soliton_linkage_nodes.runtime.parameter_files import resolve_path

PACKAGE = 'soliton_linkage_nodes'
CONFIGURATIONS = Path(get_package_share_directory(PACKAGE), 'config')
NAMED = {path.stem: path for path in sorted(CONFIGURATIONS.glob('*.yaml'))}
IN_ORDER = ('bag_recorder', 'soliton_analyser', 'soliton_steering', 'edge_actuator')
"""Nodes that start one after the other, in this order. The node that publishes joint_states starts
after these nodes, because they subscribe to this topic."""
RESPAWN = {'respawn': True, 'respawn_delay': 1.0, 'respawn_max_retries': 100}
"""Arguments with which launch restarts an ended process after 1 s. It restarts a process at most
100 times, because a process that has ended so often probably cannot start."""


def nodes(context):
    """Return the first node, and handlers that start each other node after its predecessor."""
    config, namespace, record, port = (
        context.perform_substitution(LaunchConfiguration(name))
        for name in ('config', 'namespace', 'record', 'port')
    )
    path = str(resolve_path('config', config, NAMED))
    given = {
        # After a restart, the recorder continues the same bag.
        'bag_recorder': [{'output': record, 'append': True}],
        'serial_encoders': [{'port': port, 'chain_from': 'parameters'}],
    }
    subscribers = IN_ORDER if record else IN_ORDER[1:]
    publisher = 'serial_encoders' if port else 'simulator'
    actions = [
        Node(
            package=PACKAGE,
            executable=name,
            namespace=namespace,
            output='screen',
            ros_arguments=['--params-file', path],
            parameters=given.get(name, []),
            **RESPAWN,
        )
        for name in (*subscribers, publisher)
    ]
    handlers = [
        RegisterEventHandler(OnProcessStart(target_action=one, on_start=[other], handle_once=True))
        for one, other in pairwise(actions)
    ]
    return [*handlers, actions[0]]


def generate_launch_description():
    """Return the launch arguments, the visualisation, and the function that creates the nodes."""
    config = f'parameters: {", ".join(NAMED)}, or the path of a parameter file'
    arguments = [
        ('config', 'flipper', config, None),
        ('namespace', '', 'namespace of all nodes', None),
        ('record', '', 'bag to record, with _0 appended; empty for none', None),
        ('port', '', 'serial port of a controller; empty for the simulator', None),
        ('draw', 'true', 'whether to draw the chain for viewers', ['true', 'false']),
    ]
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text, choices=choices)
        for name, value, text, choices in arguments
    ]
    drawing = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(Path(__file__).with_name('view.launch.py'))),
        condition=IfCondition(LaunchConfiguration('draw')),
    )
    return LaunchDescription([*declared, drawing, OpaqueFunction(function=nodes)])
