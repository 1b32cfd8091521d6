# SPDX-License-Identifier: Apache-2.0
"""Launch the visualisation and a viewer, and robot_state_publisher if it is installed."""

import re
import shutil
import tempfile
from importlib.util import find_spec
from pathlib import Path

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from soliton_linkage_nodes.programs.robot_description import description_of_file
from soliton_linkage_nodes.runtime.interfaces import DISPLAY_TOPICS, SUITE_TOPICS
from soliton_linkage_nodes.runtime.parameter_files import resolve_path

PACKAGE = 'soliton_linkage_nodes'
CONFIGURATIONS = Path(get_package_share_directory(PACKAGE), 'config')
NAMED = {path.stem: path for path in sorted(CONFIGURATIONS.glob('*.yaml'))}
LAYOUTS = {
    'rviz': 'linkage.rviz',
    'foxglove': 'foxglove.json',
    'plotjuggler': 'plotjuggler.xml',
    'rqt': 'rqt.perspective',
    'none': '',
}
TOPICS = '|'.join(
    re.escape(t.name) for t in (*SUITE_TOPICS, *DISPLAY_TOPICS) if not t.name.startswith('/')
)
# Each chain has its own tree of coordinate frames, on topics in its namespace.
FRAMES = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
ADDRESS, PORT = '127.0.0.1', 8765


def installed(package):
    """Return whether a ROS package is installed."""
    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        return False
    return True


def layout_in(namespace, view):
    """Return the path of a layout for a viewer, with all topics in the `namespace`."""
    path = CONFIGURATIONS / 'views' / LAYOUTS[view]
    prefix = namespace.strip('/')
    if not prefix:
        return str(path)
    text = path.read_text(encoding='utf-8')
    text = re.sub(rf'(?<![\w/])/(?=({TOPICS})\b)', f'/{prefix}/', text)
    folder = Path(tempfile.mkdtemp(prefix=f'{prefix.replace("/", "_")}_view_'))
    (folder / path.name).write_text(text, encoding='utf-8')
    return str(folder / path.name)


def frames(namespace, config):
    """Return a list with the node that publishes the coordinate frames of the links.

    The list is empty if robot_state_publisher is not installed.
    """
    if not installed('robot_state_publisher'):
        return []
    return [
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            namespace=namespace,
            parameters=[{'robot_description': description_of_file(config)}],
            # Rename this topic, because the visualisation publishes the description of the
            # current chain on robot_description.
            remappings=[*FRAMES, ('robot_description', '~/robot_description')],
        )
    ]


def rviz(namespace, layout):
    """Return RViz or, if it is not installed, a message that explains how to install it."""
    if not installed('rviz2'):
        return [LogInfo(msg='view:=rviz needs RViz; run: sudo apt install ros-jazzy-rviz2')]
    given = {'namespace': namespace, 'arguments': ['-d', layout], 'remappings': FRAMES}
    return [Node(package='rviz2', executable='rviz2', **given)]


def foxglove(namespace, layout):
    """Return foxglove_bridge or, if it is not installed, the Foxglove server of this suite.

    If neither can run, a message explains how to install one of them.
    """
    if installed('foxglove_bridge'):
        served = {'package': 'foxglove_bridge', 'executable': 'foxglove_bridge'}
        served['parameters'] = [{'address': ADDRESS, 'port': PORT}]
    elif find_spec('foxglove'):
        served = {'package': PACKAGE, 'executable': 'foxglove_server', 'namespace': namespace}
        served['parameters'] = [{'host': ADDRESS, 'port': PORT}]
    else:
        run = 'sudo apt install ros-jazzy-foxglove-bridge, or: pip install foxglove-sdk'
        return [LogInfo(msg=f'view:=foxglove needs a server; run: {run}')]
    hint = f'open ws://{ADDRESS}:{PORT} in Foxglove or Lichtblick, with the layout {layout}'
    return [Node(output='screen', **served), LogInfo(msg=hint)]


def plotjuggler(namespace, layout):
    """Return PlotJuggler, in version 4 if it is installed.

    If PlotJuggler is not installed, a message explains how to install it.
    """
    arguments = ['--layout', layout]
    if shutil.which('plotjuggler4'):
        return [ExecuteProcess(cmd=['plotjuggler4', *arguments])]
    if installed('plotjuggler'):
        return [Node(package='plotjuggler', executable='plotjuggler', arguments=arguments)]
    run = 'sudo apt install ros-jazzy-plotjuggler-ros'
    remedy = f'install version 4 from its releases, or run: {run}'
    return [LogInfo(msg=f'view:=plotjuggler needs PlotJuggler; {remedy}')]


def rqt(namespace, layout):
    """Return rqt or, if it is not installed, a message that explains how to install it."""
    if not installed('rqt_gui'):
        packages = 'ros-jazzy-rqt ros-jazzy-rqt-common-plugins ros-jazzy-rqt-robot-monitor'
        return [LogInfo(msg=f'view:=rqt needs rqt; run: sudo apt install {packages}')]
    # The monitor of rqt expects the topic of an aggregator. The remapping connects the monitor to
    # the nodes directly.
    given = {'remappings': [('/diagnostics_agg', '/diagnostics')]}
    given['arguments'] = ['--perspective-file', layout]
    return [Node(package='rqt_gui', executable='rqt_gui', **given)]


VIEWERS = {'rviz': rviz, 'foxglove': foxglove, 'plotjuggler': plotjuggler, 'rqt': rqt}


def view_of(context):
    """Return the visualisation, the publisher of coordinate frames, and the selected viewer."""
    config, namespace, view = (
        context.perform_substitution(LaunchConfiguration(name))
        for name in ('config', 'namespace', 'view')
    )
    path = resolve_path('config', config, NAMED)
    drawing = Node(
        package=PACKAGE,
        executable='visualisation',
        namespace=namespace,
        output='screen',
        ros_arguments=['--params-file', str(path)],
    )
    shown = VIEWERS[view](namespace, layout_in(namespace, view)) if view in VIEWERS else []
    return [drawing, *frames(namespace, path), *shown]


def generate_launch_description():
    """Return the declared launch arguments, and the function that creates the nodes."""
    config = f'parameters: {", ".join(NAMED)}, or the path of a parameter file'
    arguments = [
        ('config', 'flipper', config, None),
        ('namespace', '', 'namespace of the chain', None),
        ('view', 'none', 'viewer to open', list(LAYOUTS)),
    ]
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text, choices=choices)
        for name, value, text, choices in arguments
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=view_of)])
