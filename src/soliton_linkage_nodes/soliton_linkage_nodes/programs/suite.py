# SPDX-License-Identifier: Apache-2.0
"""Run several nodes of the suite in one process, which takes less memory and time than five.

Each node has the name, topics, services, parameters and diagnostics that it has alone. Ctrl-C
ends all and closes the bag. With -p port:=/dev/ttyACM0 serial_encoders takes the place of the
simulator, for a controller there; with other encoders name the others. Nodes of several chains are
named with their namespaces, as left/soliton_analyser.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import import_module
from itertools import pairwise
from typing import Any

import yaml
from rclpy.parameter import Parameter

from soliton_linkage.command_line import PlainParser
from soliton_linkage_nodes.programs.command_line import parse_own_arguments
from soliton_linkage_nodes.runtime.command_line import parameter_names
from soliton_linkage_nodes.runtime.managed import ManagedNode
from soliton_linkage_nodes.runtime.process import Component, run_together

NODES = {
    'simulator': 'simulator.node:Simulator',
    'serial_encoders': 'serial_encoders.node:SerialEncoders',
    'edge_actuator': 'edge_actuator.node:EdgeActuator',
    'soliton_analyser': 'soliton_analyser.node:SolitonAnalyser',
    'soliton_steering': 'soliton_steering.node:SolitonSteering',
    'bag_recorder': 'bags.recorder:BagRecorder',
}
"""Where the class of each node is; a node that is not asked for is not imported."""
_OF_CONTROLLERS = 'serial_encoders'
"""The node that takes the simulator's place where a port is told."""
_PARAMETER_OPTIONS = ('-p', '--param')
_TELLS_THE_CHAIN = ('-p', f'{_OF_CONTROLLERS}:chain_from:=parameters')
"""As a simulator does; what is given for all nodes or for this comes after it, and counts."""
_EXPONENT = re.compile(r'[-+]?\d+(\.\d*)?[eE][-+]?\d+')
_NAMESPACE_RULE = '__ns:='
_OF_JOINTS = 'torque_limits.'
"""Beginning of parameters whose names are given by others."""


def main() -> None:
    """Run the nodes until they are told to stop, or one of them cannot go on."""
    parser = PlainParser(
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
        'nodes',
        nargs='*',
        metavar='NODE',
        help=f'{", ".join(NODES)}; without any, all of one chain',
    )
    names = parse_own_arguments(parser, _known_to_ros(sys.argv[1:])).nodes or of_one_chain(
        sys.argv
    )
    for name in names:
        if _kind(name) not in NODES:
            parser.error(f'{name!r} is none of {", ".join(NODES)}')
    if any(each.startswith(_NAMESPACE_RULE) for each in sys.argv) and '/' in ''.join(names):
        parser.error(f'{_NAMESPACE_RULE} is for all nodes, and some are named with theirs')
    names.sort(key=lambda name: list(NODES).index(_kind(name)))
    classes = {name: _class_of(_kind(name)) for name in names}
    try:
        of_controllers = any(_kind(name) == _OF_CONTROLLERS for name in names)
        told = _TELLS_THE_CHAIN if of_controllers else ()
        rest, given = addressed([sys.argv[0], *told, *sys.argv[1:]], classes)
    except (TypeError, ValueError) as error:
        parser.error(str(error))
    components = [
        Component(partial(create, parameter_overrides=given[name], **_placed(name)), _cannot_go_on)
        for name, create in classes.items()
    ]
    # The simulator is the last to begin and the first to end: the others miss nothing of it.
    run_together(components[::-1], rest)


def of_one_chain(arguments: Sequence[str]) -> list[str]:
    """All nodes of a chain: a simulated one, or where arguments of ROS tell a port that there."""
    port = re.compile(rf'({_OF_CONTROLLERS}:)?port:=.+')
    rules = [rule for each, rule in pairwise(arguments) if each in _PARAMETER_OPTIONS]
    unused = 'simulator' if any(map(port.fullmatch, rules)) else _OF_CONTROLLERS
    return [name for name in NODES if name != unused]


def addressed(
    arguments: Sequence[str], classes: Mapping[str, type[ManagedNode]]
) -> tuple[list[str], dict[str, list[Parameter]]]:
    """Arguments of ROS without the parameters that nodes have, and these by the nodes' names.

    For ROS a parameter is for all nodes, or for one that is in no namespace. What no node has is
    left as it is, and is refused.
    """
    rest: list[str] = []
    given: dict[str, list[Parameter]] = {name: [] for name in classes}
    following = iter(arguments)
    for argument in following:
        rule = next(following, None) if argument in _PARAMETER_OPTIONS else None
        full_name, _, text = (rule or '').partition(':=')
        whom, _, name = full_name.rpartition(':')
        owners = [
            each
            for each, node in classes.items()
            if whom in ('', each, _kind(each)) and _has(node, name)
        ]
        for owner in owners:
            given[owner].append(Parameter(name, value=_value(text)))
        if not owners:
            rest += [argument] if rule is None else [argument, rule]
    return rest, given


def _known_to_ros(arguments: Sequence[str]) -> list[str]:
    """Arguments without parameters for a node in a namespace, which ROS has none for."""
    known: list[str] = []
    for argument in arguments:
        if known and known[-1] in _PARAMETER_OPTIONS and '/' in argument.partition(':=')[0]:
            known.pop()
        else:
            known.append(argument)
    return known


def _value(text: str) -> Any:
    """Value as ROS reads it: as YAML, in which 1e-3 is a number as well."""
    try:
        read = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(f'{text!r} is no value: {" ".join(str(error).split())}') from error
    if isinstance(read, list):
        return [_with_exponent(each) for each in read]
    return '' if read is None else _with_exponent(read)


def _with_exponent(read: Any) -> Any:
    return float(read) if isinstance(read, str) and _EXPONENT.fullmatch(read) else read


def _has(node: type[ManagedNode], name: str) -> bool:
    return name in parameter_names(node) or (
        name.startswith(_OF_JOINTS) and _OF_JOINTS in (node.__doc__ or '')
    )


def _kind(name: str) -> str:
    return name.rpartition('/')[2]


def _placed(name: str) -> dict[str, str]:
    """Namespace that a name tells, if any."""
    namespace = name.rpartition('/')[0].strip('/')
    return {'namespace': f'/{namespace}'} if namespace else {}


def _class_of(name: str) -> Any:
    module, _, name_of_class = NODES[name].partition(':')
    return getattr(import_module(f'soliton_linkage_nodes.{module}'), name_of_class)


def _cannot_go_on(node: Any) -> bool:
    failure = getattr(node, 'failure', None)
    if failure is not None:
        raise failure
    return False
