# SPDX-License-Identifier: Apache-2.0
"""A recorded chain, played into a fresh analyser until the bag is at its end."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitution import Substitution
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from soliton_linkage_nodes.runtime.parameter_files import path_of

PACKAGE = 'soliton_linkage_nodes'
BAGS = Path(get_package_share_directory(PACKAGE), 'bags')
NAMED = {path.name: path for path in sorted(BAGS.iterdir()) if path.is_dir()}


class BagFolder(Substitution):
    """Directory of the bag that `bag:=` names, or is."""

    def perform(self, context):
        """Return the path; raises ValueError where there is none."""
        given = context.perform_substitution(LaunchConfiguration('bag'))
        return str(path_of('bag', given, NAMED))


def generate_launch_description():
    """Return the player, which ends the launch when it ends, and the analyser."""
    player = Node(
        package=PACKAGE,
        executable='bag_player',
        output='screen',
        parameters=[
            {
                'bag': ParameterValue(BagFolder(), value_type=str),
                'rate': ParameterValue(LaunchConfiguration('rate'), value_type=float),
                'topics': ['chain', 'joint_states'],
            }
        ],
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'bag',
                default_value='flipper_0',
                description=f'bag to play: {", ".join(NAMED)}, or the path of one',
            ),
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
