# SPDX-License-Identifier: Apache-2.0
"""Run several nodes of the suite in one process, which saves memory and processor time.

Each node keeps its name, topics, services, parameters and diagnostics. bag_recorder writes a bag.
Ctrl-C stops all nodes and closes the bag. By default, all nodes of one chain run. With
-p port:=/dev/ttyACM0, serial_encoders replaces the simulator. If another program publishes
joint_states, list the nodes that shall run. For several chains, list the nodes with their
namespaces, for example left/soliton_analyser.
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
from soliton_linkage_nodes import start
from soliton_linkage_nodes.programs.command_line import parse_own_arguments
from soliton_linkage_nodes.runtime.command_line import parameter_names
from soliton_linkage_nodes.runtime.managed import ManagedNode
from soliton_linkage_nodes.runtime.process import run_together

NODES = (
    *('simulator', 'serial_encoders', 'edge_actuator', 'soliton_analyser', 'soliton_steering'),
    'bag_recorder',
)
"""Names of the nodes. Only the modules of the nodes to run are imported."""
_SERIAL = 'serial_encoders'
_PARAMETER_OPTIONS = ('-p', '--param')
_CHAIN_SOURCE = ('-p', f'{_SERIAL}:chain_from:=parameters')
"""Default arguments, with which serial_encoders publishes the chain that its parameters
describe."""
_EXPONENT = re.compile(r'[-+]?\d+(\.\d*)?[eE][-+]?\d+')
_NAMESPACE_RULE = '__ns:='
_JOINT_PREFIX = 'torque_limits.'
"""Prefix of parameters that are named after joints. The program passes -p NAME:=VALUE to the nodes
whose list of parameters contains NAME. These lists contain no name with this prefix, because only
a running node knows the joint names. The program passes every name with this prefix to the nodes
whose docstring contains the prefix."""


def main() -> None:
    """Run the nodes until a signal arrives or one of the nodes fails."""
    parser = PlainParser(
        prog='suite',
        usage='%(prog)s [NODE ...] [--ros-args ...]',
        description=__doc__,
        epilog=(
            'After --ros-args: -p NAME:=VALUE sets a parameter of all nodes that have it, '
            '-p NODE:NAME:=VALUE of one node; --params-file FILE reads parameters; -r __ns:=/NAME '
            'sets the namespace. --help of a node lists its parameters.'
        ),
    )
    # Do not use `choices`, because argparse would print a rejected choice as a list.
    known = f'{", ".join(NODES)}; default: all nodes of one chain'
    parser.add_argument('nodes', nargs='*', metavar='NODE', help=known)
    named = parse_own_arguments(parser, _known_to_ros(sys.argv[1:])).nodes
    names = named or of_one_chain(sys.argv)
    for name in names:
        if _kind(name) not in NODES:
            parser.error(f'unknown node {name!r}; choose from {", ".join(NODES)}')
    if any(each.startswith(_NAMESPACE_RULE) for each in sys.argv) and '/' in ''.join(names):
        parser.error(
            f'{_NAMESPACE_RULE} applies to all nodes, but some names have a namespace; '
            'use only one of both'
        )
    names.sort(key=lambda name: NODES.index(_kind(name)))
    classes = {name: _class_of(_kind(name)) for name in names}
    try:
        has_controller = any(_kind(name) == _SERIAL for name in names)
        defaults = _CHAIN_SOURCE if has_controller else ()
        rest, given = addressed([sys.argv[0], *defaults, *sys.argv[1:]], classes)
    except (TypeError, ValueError) as error:
        parser.error(str(error))
    constructors = [
        partial(create, parameter_overrides=given[name], **_namespace_of(name))
        for name, create in classes.items()
    ]
    # The simulator starts last and stops first, so that the other nodes receive all messages.
    run_together(constructors[::-1], rest)


def of_one_chain(arguments: Sequence[str]) -> list[str]:
    """Return the nodes of one chain; if a port is set, serial_encoders replaces the simulator."""
    port = re.compile(rf'({_SERIAL}:)?port:=.+')
    rules = [rule for each, rule in pairwise(arguments) if each in _PARAMETER_OPTIONS]
    unused = 'simulator' if any(map(port.fullmatch, rules)) else _SERIAL
    return [name for name in NODES if name != unused]


def addressed(
    arguments: Sequence[str], classes: Mapping[str, type[ManagedNode]]
) -> tuple[list[str], dict[str, list[Parameter]]]:
    """Return the arguments that set no parameter of a node, and the parameters of each node.

    The keys of `classes` and of the returned dictionary are names of nodes, which may contain a
    namespace. The function is needed because in ROS, -p NODE:NAME:=VALUE accepts no namespace and
    has no effect on a node in a namespace.
    """
    rest: list[str] = []
    given: dict[str, list[Parameter]] = {name: [] for name in classes}
    following = iter(arguments)
    for argument in following:
        rule = next(following, None) if argument in _PARAMETER_OPTIONS else None
        full_name, _, text = (rule or '').partition(':=')
        whom, _, name = full_name.rpartition(':')
        named = {each: node for each, node in classes.items() if whom in ('', each, _kind(each))}
        owners = [each for each, node in named.items() if _has(node, name)]
        for owner in owners:
            given[owner].append(Parameter(name, value=_value(text)))
        if not owners:
            rest += [argument] if rule is None else [argument, rule]
    return rest, given


def _known_to_ros(arguments: Sequence[str]) -> list[str]:
    """Remove -p NAMESPACE/NODE:NAME:=VALUE, because ROS would reject such arguments."""
    known: list[str] = []
    for argument in arguments:
        if known and known[-1] in _PARAMETER_OPTIONS and '/' in argument.partition(':=')[0]:
            known.pop()
        else:
            known.append(argument)
    return known


def _value(text: str) -> Any:
    try:
        read = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(
            f'{text!r} is not a valid value: {" ".join(str(error).split())}'
        ) from error
    if isinstance(read, list):
        return [_with_exponent(each) for each in read]
    return '' if read is None else _with_exponent(read)


def _with_exponent(read: Any) -> Any:
    return float(read) if isinstance(read, str) and _EXPONENT.fullmatch(read) else read


def _has(node: type[ManagedNode], name: str) -> bool:
    return name in parameter_names(node) or (
        name.startswith(_JOINT_PREFIX) and _JOINT_PREFIX in (node.__doc__ or '')
    )


def _kind(name: str) -> str:
    return name.rpartition('/')[2]


def _namespace_of(name: str) -> dict[str, str]:
    namespace = name.rpartition('/')[0].strip('/')
    return {'namespace': f'/{namespace}'} if namespace else {}


def _class_of(name: str) -> Any:
    module, name_of_class = getattr(start, name).args
    return getattr(import_module(f'soliton_linkage_nodes.{module}'), name_of_class)
