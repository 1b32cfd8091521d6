# SPDX-License-Identifier: Apache-2.0
"""List, get, set, describe and dump the parameters of nodes."""

from __future__ import annotations

import argparse
import contextlib
from array import array
from typing import Any

import yaml
from rcl_interfaces.msg import Parameter, ParameterDescriptor, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import get_parameter_value, parameter_value_to_python

from soliton_linkage_nodes.commands.visitor import Verbs, Visitor, full_name
from soliton_linkage_nodes.runtime.parameters import LARGEST_INTEGER, rejection


def main(arguments: list[str]) -> int:
    """Run the verb of the command line and return its exit code."""
    verbs = Verbs('param', __doc__)
    for name, verb, summary in (
        ('list', _list, 'print the names of the parameters of a node'),
        ('get', _get, 'print a parameter'),
        ('set', _set, 'set a parameter'),
        ('describe', _describe, 'print the description and the range of a parameter'),
        ('dump', _dump, 'print all parameters as a parameter file'),
    ):
        parser = verbs.add(name, verb, summary)
        parser.add_argument('node')
        if name in ('get', 'set', 'describe'):
            parser.add_argument('name')
        if name == 'set':
            parser.add_argument('value', help='value in YAML')
    return verbs.run(arguments)


def _names(visitor: Visitor, node: str) -> list[str]:
    return sorted(visitor.call_node(node, ListParameters).result.names)


def _list(visitor: Visitor, options: argparse.Namespace) -> None:
    print('\n'.join(_names(visitor, options.node)))


def _values(visitor: Visitor, node: str, names: list[str]) -> list[Any]:
    found = visitor.call_node(node, GetParameters, names=names).values
    return list(map(parameter_value_to_python, found))


def _get(visitor: Visitor, options: argparse.Namespace) -> None:
    print(_value(visitor, options))


def _value(visitor: Visitor, options: argparse.Namespace) -> str:
    values = _values(visitor, options.node, [options.name])
    if not values or values[0] is None:
        raise RuntimeError(f'{options.node} has no parameter {options.name}, or it is not set')
    text: str = yaml.safe_dump(_plain(values[0]), default_flow_style=True)
    return text.removesuffix('...\n').strip()


def _set(visitor: Visitor, options: argparse.Namespace) -> None:
    node, names = options.node, [options.name]
    descriptors = visitor.call_node(node, DescribeParameters, names=names).descriptors
    descriptor = descriptors[0] if descriptors else ParameterDescriptor()
    value = _parse(options.value, descriptor)
    parameter = Parameter(name=options.name, value=value)
    answer = visitor.call_node(node, SetParameters, parameters=[parameter])
    result = answer.results[0]
    if not result.successful:
        # Nodes of other packages return a reason without a remedy. Use it only if this suite knows
        # no reason.
        reason = rejection(descriptor, parameter_value_to_python(value)) or result.reason
        raise RuntimeError(f'{node} rejected {options.name} = {options.value}: {reason}')
    print(f'Set parameter successful: {options.name} = {_value(visitor, options)}')


def _parse(text: str, descriptor: ParameterDescriptor) -> ParameterValue:
    """Return a parameter value from a YAML text.

    For a double, the text 1e-3 is a number, although YAML reads it as a string.
    """
    if descriptor.type == ParameterType.PARAMETER_DOUBLE:
        with contextlib.suppress(ValueError):
            return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(text))
    with contextlib.suppress(yaml.YAMLError, AssertionError):
        value = get_parameter_value(text)
        found = parameter_value_to_python(value)
        if all(map(_is_sendable, found if isinstance(found, (list, array)) else [found])):
            return value
    return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text)


def _is_sendable(value: Any) -> bool:
    fits = not isinstance(value, int) or abs(value) <= LARGEST_INTEGER
    return fits and isinstance(value, (bool, int, float, str))


def _describe(visitor: Visitor, options: argparse.Namespace) -> None:
    found = visitor.call_node(options.node, DescribeParameters, names=[options.name])
    for descriptor in found.descriptors:
        print(f'{descriptor.name}: {descriptor.description}')
        for bounds in (*descriptor.floating_point_range, *descriptor.integer_range):
            print(f'  from {bounds.from_value} to {bounds.to_value}')
        if descriptor.additional_constraints:
            print(f'  {descriptor.additional_constraints}')
        if descriptor.read_only:
            print('  read only')


def _dump(visitor: Visitor, options: argparse.Namespace) -> None:
    # Request the parameters one at a time, because rclpy returns no values at all if one of the
    # requested parameters is not set.
    node = options.node
    names = _names(visitor, node)
    found = {name: value for name in names for value in _values(visitor, node, [name])}
    parameters = {name: _plain(value) for name, value in found.items() if value is not None}
    document = {full_name(options.node): {'ros__parameters': parameters}}
    print(yaml.safe_dump(document, default_flow_style=None, allow_unicode=True), end='')


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, (bool, int, float, str)) else list(value)
