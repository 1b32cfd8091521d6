# SPDX-License-Identifier: Apache-2.0
"""Launch an analyser, and play a recorded bag to it until the bag ends."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from soliton_linkage_nodes.bags.play.playback import full_name
from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.runtime.interfaces import DELIVERED_IMPULSES, JOINT_STATE_DEVIATIONS
from soliton_linkage_nodes.runtime.parameter_files import resolve_path

PACKAGE = 'soliton_linkage_nodes'
BAGS = Path(get_package_share_directory(PACKAGE), 'bags')
OPTIONAL = DELIVERED_IMPULSES.name, JOINT_STATE_DEVIATIONS.name
NAMED = {path.name: path for path in sorted(BAGS.iterdir()) if path.is_dir()}


def analysed_topics(bag):
    """Return the topics that the analyser needs, and the optional topics that are in the bag."""
    with open_bag(bag) as reader:
        found = [full_name(reader, name) for name in OPTIONAL]
        return ['chain', 'joint_states', *filter(None, found)]


def nodes(context):
    """Return the analyser and the player of the bag.

    When the player ends, the whole launch ends.
    """
    given, rate = (
        context.perform_substitution(LaunchConfiguration(name)) for name in ('bag', 'rate')
    )
    # Check the bag before any process starts. If an error occurs later, launch leaves the started
    # processes running.
    bag = resolve_path('bag', given, NAMED)
    player = Node(
        package=PACKAGE,
        executable='bag_player',
        output='screen',
        parameters=[{'bag': str(bag), 'rate': float(rate), 'topics': analysed_topics(bag)}],
    )
    return [
        Node(package=PACKAGE, executable='soliton_analyser', output='screen'),
        player,
        RegisterEventHandler(
            OnProcessExit(target_action=player, on_exit=[EmitEvent(event=Shutdown())])
        ),
    ]


def generate_launch_description():
    """Return the declared launch arguments, and the function that creates the nodes."""
    bag = f'bag to play: {", ".join(NAMED)}, or the path of a bag'
    rate = 'playback rate relative to the recording'
    return LaunchDescription(
        [
            DeclareLaunchArgument('bag', default_value='flipper_0', description=bag),
            DeclareLaunchArgument('rate', default_value='1.0', description=rate),
            OpaqueFunction(function=nodes),
        ]
    )
