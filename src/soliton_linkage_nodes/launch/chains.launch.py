# SPDX-License-Identifier: Apache-2.0
"""Launch several chains, each in its own namespace, optionally with recorders.

By default, the chains are distributed over as many processes as there are cores.
"""

import os
from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from soliton_linkage_nodes.runtime.parameter_files import resolve_path

PACKAGE = 'soliton_linkage_nodes'
EXAMPLES = Path(get_package_share_directory(PACKAGE), 'config', 'chains')
NAMED = {path.stem: path for path in sorted(EXAMPLES.glob('*.yaml'))}
BAGS = ('each', 'one')
SUITE = ('simulator', 'edge_actuator', 'soliton_analyser', 'soliton_steering')
RESPAWN = {'respawn': True, 'respawn_delay': 1.0, 'respawn_max_retries': 100}
"""Arguments with which launch restarts an ended process after 1 s. It restarts a process at most
100 times, because a process that has ended so often probably cannot start."""


def chains_of(path):
    """Return the namespaces of the chains in a parameter file.

    Raises ValueError if the file has none.
    """
    sections = yaml.safe_load(path.read_text(encoding='utf-8'))
    firsts = [section.strip('/').split('/')[0] for section in sections]
    chains = [name for name in dict.fromkeys(firsts) if not name.startswith('*')]
    if not chains:
        raise ValueError(f'{path} names no chain; begin sections with /NAME/**: or /NAME/NODE:')
    return chains


def recorder(record, chains, path):
    """Return a recorder that writes all topics of these chains to the bag `record`."""
    pattern = f'^/({"|".join(chains)})/'
    return Node(
        package=PACKAGE,
        executable='bag_recorder',
        output='screen',
        ros_arguments=['--params-file', path],
        parameters=[{'output': record, 'regex': pattern, 'append': True}],
        **RESPAWN,
    )


def suite(chains, record, path):
    """Return one process that runs the nodes of these chains.

    If `record` is not empty, this process also runs a recorder for each chain.
    """
    nodes = [*SUITE, *(['bag_recorder'] if record else [])]
    rules = [
        f'{chain}/bag_recorder:{rule}'
        for chain in (chains if record else [])
        for rule in (f'output:={record}_{chain}', 'append:=true')
    ]
    return Node(
        package=PACKAGE,
        executable='suite',
        output='screen',
        arguments=[f'{chain}/{node}' for chain in chains for node in nodes],
        ros_arguments=['--params-file', path, *(word for rule in rules for word in ('-p', rule))],
        **RESPAWN,
    )


def shared(chains, processes):
    """Distribute the chains over processes; return the list of chains of each process.

    Raises ValueError if the number of processes is invalid.
    """
    if not (processes.isdecimal() and int(processes)):
        raise ValueError(f'processes:={processes} must be a whole number above 0')
    return [chains[first :: int(processes)] for first in range(min(int(processes), len(chains)))]


def processes(context):
    """Return the processes that run the chains.

    If one bag for all chains was requested, the recorder of this bag is included.
    """
    given, record, bags, number = (
        context.perform_substitution(LaunchConfiguration(name))
        for name in ('chains', 'record', 'bags', 'processes')
    )
    path = resolve_path('chains', given, NAMED)
    if bags not in BAGS:
        raise ValueError(f'bags:={bags} must be one of {", ".join(BAGS)}')
    chains = chains_of(path)
    together = [recorder(record, chains, str(path))] if record and bags == 'one' else []
    own = record if bags == 'each' else ''
    return [*together, *(suite(some, own, str(path)) for some in shared(chains, number))]


def generate_launch_description():
    """Return the declared launch arguments, and the function that creates the processes."""
    chains = f'parameters: {", ".join(NAMED)}, or the path of a parameter file'
    cores = str(len(os.sched_getaffinity(0)))
    arguments = [
        ('chains', 'three_motions', chains),
        ('record', '', 'bag to record; empty for none'),
        ('bags', 'each', 'each: one bag for each chain; one: one bag for all chains'),
        ('processes', cores, 'number of processes; more processes than cores are slower'),
    ]
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text)
        for name, value, text in arguments
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=processes)])
