# SPDX-License-Identifier: Apache-2.0
"""Run several nodes of the suite in one process, which takes less memory and time than five.

Each node has the name, topics, services, parameters and diagnostics that it has alone. Ctrl-C
ends all and closes the bag. With real encoders in place of the simulator, name the others.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any

from soliton_linkage_nodes.programs.command_line import ProgramParser
from soliton_linkage_nodes.runtime.command_line import parameter_names
from soliton_linkage_nodes.runtime.managed import ManagedNode
from soliton_linkage_nodes.runtime.process import SWITCH_INTERVAL, Component, run_together

NODES = {
    'simulator': 'simulator.node:Simulator',
    'edge_actuator': 'edge_actuator.node:EdgeActuator',
    'soliton_analyser': 'soliton_analyser.node:SolitonAnalyser',
    'soliton_steering': 'soliton_steering.node:SolitonSteering',
    'bag_recorder': 'bags.recorder:BagRecorder',
}
"""Where the class of each node is; a node that is not asked for is not imported."""
_PARAMETER_OPTIONS = ('-p', '--param')
_OF_JOINTS = 'torque_limits.'
"""Beginning of parameters whose names are given by others."""


def main() -> None:
    """Run the nodes until they are told to stop, or one of them cannot go on."""
    parser = ProgramParser(
        prog='suite',
        usage='%(prog)s [NODE ...] [--ros-args ...]',
        description=__doc__,
        epilog=(
            'After --ros-args: --params-file FILE, -p NAME:=VALUE for each node that has such a '
            'parameter, -p NODE:NAME:=VALUE for one, -r __ns:=/NAME. Each node tells with --help '
            'which parameters it has.'
        ),
    )
    # What choices refuse of a list, argparse prints as a list.
    parser.add_argument(
        'nodes', nargs='*', metavar='NODE', help=f'{", ".join(NODES)}; without any, all of them'
    )
    names = parser.parse_beside_ros().nodes or list(NODES)
    for name in names:
        if name not in NODES:
            parser.error(f'{name!r} is none of {", ".join(NODES)}')
    classes = {name: _class_of(name) for name in NODES if name in names}
    sys.setswitchinterval(SWITCH_INTERVAL)
    # The simulator is the last to begin and the first to end: the others miss nothing of it.
    components = [Component(create, _cannot_go_on) for create in reversed(classes.values())]
    run_together(components, list(addressed(sys.argv, classes)))


def addressed(arguments: Sequence[str], classes: Mapping[str, type[ManagedNode]]) -> Iterator[str]:
    """Arguments of ROS with each parameter given to those nodes only that have it.

    What none of them has is left as it is, and is refused.
    """
    rest = iter(arguments)
    for argument in rest:
        rule = next(rest, None) if argument in _PARAMETER_OPTIONS else None
        if rule is None:
            yield argument
            continue
        owners = [name for name, node in classes.items() if _has(node, rule.partition(':=')[0])]
        for given in [f'{owner}:{rule}' for owner in owners] or [rule]:
            yield from (argument, given)


def _has(node: type[ManagedNode], name: str) -> bool:
    return name in parameter_names(node) or (
        name.startswith(_OF_JOINTS) and _OF_JOINTS in (node.__doc__ or '')
    )


def _class_of(name: str) -> Any:
    module, _, name_of_class = NODES[name].partition(':')
    return getattr(import_module(f'soliton_linkage_nodes.{module}'), name_of_class)


def _cannot_go_on(node: Any) -> bool:
    failure = getattr(node, 'failure', None)
    if failure is not None:
        raise failure
    return False
