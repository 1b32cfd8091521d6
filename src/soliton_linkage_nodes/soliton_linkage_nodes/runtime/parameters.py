# SPDX-License-Identifier: Apache-2.0
"""Declaration of ROS parameters from dataclasses, and reasons to reject values."""

from __future__ import annotations

import dataclasses
import difflib
import math
from array import array
from collections.abc import Iterable, Mapping, Sequence
from types import NoneType
from typing import Any, TypeVar, cast, get_type_hints
from weakref import WeakSet

from rcl_interfaces import msg
from rclpy.node import Node
from rclpy.parameter import Parameter

from soliton_linkage.linkage.quantities import Quantity, described_fields

Parameters = TypeVar('Parameters')

_TYPES: dict[Any, Parameter.Type] = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
    tuple[str, ...]: Parameter.Type.STRING_ARRAY,
    tuple[float, ...]: Parameter.Type.DOUBLE_ARRAY,
}
_LISTS = (Parameter.Type.STRING_ARRAY, Parameter.Type.DOUBLE_ARRAY)
LARGEST_INTEGER = 2**63 - 1
"""Largest integer parameter, which ROS stores as int64."""
_EXAMPLES = {
    Parameter.Type.BOOL: 'true or false',
    Parameter.Type.INTEGER: 'a whole number such as 20',
    Parameter.Type.DOUBLE: 'a number such as 1.0',
    Parameter.Type.STRING: 'a text',
    Parameter.Type.BYTE_ARRAY: 'a list of bytes',
    Parameter.Type.BOOL_ARRAY: 'a list of true or false',
    Parameter.Type.INTEGER_ARRAY: 'a list of whole numbers such as [1, 2]',
    Parameter.Type.STRING_ARRAY: 'a list of texts',
    Parameter.Type.DOUBLE_ARRAY: 'a list of numbers such as [1.0, 0.5]',
}
_SHARED = 'chain.'
_CONVERTING: WeakSet[Node] = WeakSet()


def declare(node: Node, parameters: type[Parameters], prefix: str = '') -> Parameters:
    """Declare the fields of a dataclass as parameters, and return an instance with their values.

    Only fields are declared that the dataclass defines with the function `quantity` of
    `soliton_linkage.linkage.quantities`, which states their meaning, unit and range. Raises
    ValueError if a value is not allowed.
    """
    quantities = described_fields(parameters)
    if quantities and all(node.has_parameter(prefix + name) for name in quantities):
        return current(node, parameters, prefix)
    _convert_changes(node)
    types = get_type_hints(parameters)
    for field in dataclasses.fields(cast(Any, parameters)):
        name = field.name
        if name in quantities:
            _declare_one(node, prefix + name, types[name], field.default, quantities[name])
    adjustable = {prefix + name: each for name, each in quantities.items() if each.adjustable}
    if adjustable:
        node.add_on_set_parameters_callback(lambda changes: _check(adjustable, changes))
    return current(node, parameters, prefix)


def current(node: Node, parameters: type[Parameters], prefix: str = '') -> Parameters:
    """Return an instance of a dataclass with the current values of its declared parameters."""
    types = get_type_hints(parameters)
    values = {
        name: node.get_parameter(prefix + name).value for name in described_fields(parameters)
    }
    return parameters(
        **{n: tuple(v) if _TYPES[types[n]] in _LISTS else v for n, v in values.items()}
    )


def make_adjustable(node: Node, name: str) -> None:
    """Allow a declared parameter to be changed at run time."""
    descriptor = node.describe_parameter(name)
    descriptor.read_only = False
    node.set_descriptor(name, descriptor)


def reject_unknown(node: Node) -> None:
    """Raise ValueError if the user has set a parameter that the node has not declared.

    A node that has no parameters of the chain ignores `chain.*`, because parameter files set these
    parameters for all nodes.
    """
    declared = set(node.get_parameters_by_prefix(''))
    knows_chain = any(name.startswith(_SHARED) for name in declared)
    for name in sorted(overrides(node).keys() - declared):
        if knows_chain or not name.startswith(_SHARED):
            raise ValueError(unknown_parameter(node, name, declared))


def overrides(node: Node) -> Mapping[str, Parameter]:
    """Return the parameters that the user has set. They are in a private field of rclpy."""
    given: dict[str, Parameter] = node._parameter_overrides
    return given


def unknown_parameter(node: Node, name: str, known: Iterable[str]) -> str:
    """Return the error message for a parameter `name` that is not among the `known` ones."""
    near = difflib.get_close_matches(name, list(known), n=1)
    remedy = f'did you mean {near[0]!r}?' if near else f'known: {", ".join(sorted(known))}'
    return f'parameter {name!r} of {node.get_name()} is unknown; {remedy}'


def _convert(kind: Parameter.Type, value: Any) -> Any:
    """Convert integers to floats, and sequences or None to lists, if the type `kind` needs it."""
    if kind in _LISTS and isinstance(value, (NoneType, list, tuple, array)):
        elements = list(value or ())
        whole = all(type(element) is int for element in elements)
        if kind is Parameter.Type.DOUBLE_ARRAY and whole:
            return [float(element) for element in elements]
        return elements
    return float(value) if kind is Parameter.Type.DOUBLE and type(value) is int else value


def type_complaint(kind: Parameter.Type, value: Any) -> str:
    """Return a text such as 'must be a number' if a value has the wrong type, otherwise ''."""
    fits = kind.check(value) and (kind is Parameter.Type.BOOL or not isinstance(value, bool))
    return '' if fits else f'must be {_EXAMPLES[kind]}'


def limits(descriptor: msg.ParameterDescriptor) -> Quantity:
    """Return the range and the choices in a parameter's descriptor; None is a missing limit."""
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    ends = (ranges[0].from_value, ranges[0].to_value) if ranges else (math.inf, math.inf)
    low, high = (each if abs(each) < LARGEST_INTEGER else None for each in ends)
    text = descriptor.type == Parameter.Type.STRING.value
    choices = descriptor.additional_constraints if text else ''
    return Quantity('', '', low, high, tuple(filter(None, choices.split(', '))))


def rejection(descriptor: msg.ParameterDescriptor, value: Any) -> str:
    """Return the reason why a parameter rejects a value, with a remedy, or '' if it accepts it."""
    name, kind = descriptor.name, Parameter.Type(descriptor.type)
    if descriptor.read_only:
        return (
            f'parameter {name} is read-only while its node runs; start the node with '
            f'-p {name}:={value}'
        )
    if descriptor.dynamic_typing or kind is Parameter.Type.NOT_SET:
        return ''
    converted = _convert(kind, value)
    complaint = type_complaint(kind, converted) or limits(descriptor).complaint(converted)
    return f'parameter {name} = {value!r} {complaint}; set another value' if complaint else ''


def type_name(kind: Any) -> str:
    """Return the name of the ROS parameter type of a Python type."""
    return _TYPES[kind].name.lower()


def description_with_unit(described: Quantity) -> str:
    """Return the description of a quantity, followed by its unit in brackets."""
    return described.description + (f' [{described.unit}]' if described.unit else '')


def describe_range(described: Quantity) -> str:
    """Describe the allowed values of a parameter, '' if all values are allowed."""
    low, high = described.minimum, described.maximum
    if described.choices:
        return f'one of {", ".join(described.choices)}'
    if low is None:
        return '' if high is None else f'{high:g} or less'
    return f'{low:g} or more' if high is None else f'{low:g} to {high:g}'


def _check(known: Mapping[str, Quantity], changes: Sequence[Parameter]) -> msg.SetParametersResult:
    for change in changes:
        complaint = change.name in known and known[change.name].complaint(change.value)
        if complaint:
            reason = f'parameter {change.name} = {change.value!r} {complaint}'
            return msg.SetParametersResult(successful=False, reason=reason)
    return msg.SetParametersResult(successful=True)


def _convert_changes(node: Node) -> None:
    """Add one callback to a node that converts values set at run time to the declared types."""
    # Only one such callback is possible, because rclpy concatenates the results of several.
    if node not in _CONVERTING:
        _CONVERTING.add(node)
        node.add_pre_set_parameters_callback(
            lambda changes: [_convert_change(node, change) for change in changes]
        )


def _convert_change(node: Node, change: Parameter) -> Parameter:
    if not node.has_parameter(change.name) or change.type_ is Parameter.Type.NOT_SET:
        return change
    kind = Parameter.Type(node.describe_parameter(change.name).type)
    value = _convert(kind, change.value)
    return Parameter(change.name, kind, value) if kind.check(value) else change


def _declare_one(node: Node, name: str, kind: Any, default: Any, described: Quantity) -> None:
    type_, override = _TYPES[kind], overrides(node).get(name)
    value = default if override is None else _convert(type_, override.value)
    complaint = type_complaint(type_, value) or described.complaint(value)
    if complaint:
        raise ValueError(f'parameter {name} of {node.get_name()} = {value!r} {complaint}')
    descriptor = _descriptor(type_, described)
    if type_ in _LISTS:
        # rclpy infers the type of a list from the elements. For an empty list, this fails.
        node.declare_parameter(name, type_, ignore_override=True)
        node.set_parameters([Parameter(name, type_, list(value))])
        node.set_descriptor(name, descriptor)
    else:
        node.declare_parameter(name, value, descriptor, ignore_override=True)


def _descriptor(type_: Parameter.Type, described: Quantity) -> msg.ParameterDescriptor:
    descriptor = msg.ParameterDescriptor(
        type=type_.value,
        description=description_with_unit(described),
        read_only=not described.adjustable,
        additional_constraints=', '.join(described.choices),
    )
    low, high = described.minimum, described.maximum
    if low is None and high is None:
        return descriptor
    if type_ is Parameter.Type.INTEGER:
        low = -LARGEST_INTEGER if low is None else int(low)
        high = LARGEST_INTEGER if high is None else int(high)
        descriptor.integer_range = [msg.IntegerRange(from_value=low, to_value=high, step=1)]
    else:
        low = float('-inf') if low is None else float(low)
        high = float('inf') if high is None else float(high)
        descriptor.floating_point_range = [msg.FloatingPointRange(from_value=low, to_value=high)]
    return descriptor
