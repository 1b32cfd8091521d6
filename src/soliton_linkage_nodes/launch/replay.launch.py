# SPDX-License-Identifier: Apache-2.0
"""A recorded chain, played into a fresh analyser until the bag is at its end."""

from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

PACKAGE = 'soliton_linkage_nodes'


def generate_launch_description():
    """Return the player, which ends the launch when it ends, and the analyser."""
    player = Node(
        package=PACKAGE,
        executable='bag_player',
        output='screen',
        parameters=[
            {
                'bag': LaunchConfiguration('bag'),
                'rate': ParameterValue(LaunchConfiguration('rate'), value_type=float),
                'topics': ['chain', 'joint_states'],
            }
        ],
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument('bag', description='directory of the bag to play'),
            DeclareLaunchArgument(
                'rate', default_value='1.0', description='how much faster than recorded'
            ),
            Node(package=PACKAGE, executable='soliton_analyser', output='screen'),
            player,
            RegisterEventHandler(
                OnProcessExit(target_action=player, on_exit=[EmitEvent(event=Shutdown())])
            ),
        ]
    )
