# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from dataclasses: declared with description, unit, range and read-only flag."""

from __future__ import annotations

import dataclasses
from array import array
from collections.abc import Mapping, Sequence
from types import NoneType
from typing import Any, TypeVar, cast, get_type_hints
from weakref import WeakSet

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from soliton_linkage.linkage.quantities import Quantity, described_fields
from soliton_linkage_nodes.runtime.guarded import unknown

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
_EXAMPLES = {
    Parameter.Type.BOOL: 'true or false',
    Parameter.Type.INTEGER: 'a whole number such as 20',
    Parameter.Type.DOUBLE: 'a number such as 1.0',
    Parameter.Type.STRING: 'a text',
    Parameter.Type.STRING_ARRAY: 'a list of texts',
    Parameter.Type.DOUBLE_ARRAY: 'a list of numbers such as [1.0, 0.5]',
}
_SHARED = 'chain.'
_TAKING: WeakSet[Node] = WeakSet()
"""Nodes that take whole numbers where numbers with a point are meant."""
_LARGEST_INTEGER = 2**63 - 1
"""That a ROS parameter holds, which is an int64."""


def declare(node: Node, parameters: type[Parameters], prefix: str = '') -> Parameters:
    """Declare the described fields of a dataclass as parameters and return their values in it.

    Fields without a description keep their default. What is declared already keeps its value.
    Raises ValueError, naming parameter, value, limit and remedy, where one is not allowed.
    """
    quantities = described_fields(parameters)
    if quantities and all(node.has_parameter(prefix + name) for name in quantities):
        return current(node, parameters, prefix)
    _take_whole_numbers(node)
    kinds = get_type_hints(parameters)
    values = {
        field.name: _declare_one(
            node, prefix + field.name, kinds[field.name], field.default, quantities[field.name]
        )
        for field in dataclasses.fields(cast(Any, parameters))
        if field.name in quantities
    }
    adjustable = {
        prefix + name: described for name, described in quantities.items() if described.adjustable
    }
    if adjustable:
        node.add_on_set_parameters_callback(lambda changes: _judge(adjustable, changes))
    return parameters(**values)


def current(node: Node, parameters: type[Parameters], prefix: str = '') -> Parameters:
    """Return the values that the declared fields of a dataclass have now."""
    values = {
        name: node.get_parameter(prefix + name).value for name in described_fields(parameters)
    }
    kinds = get_type_hints(parameters)
    return parameters(**{name: _kept(_TYPES[kinds[name]], values[name]) for name in values})


def reject_unknown(node: Node) -> None:
    """Raise ValueError for a parameter that was given to a node and that it has not declared.

    The parameters `chain.*` may be given to every node, whether it needs them or not.
    """
    declared = set(node.get_parameters_by_prefix(''))
    knows_chain = any(name.startswith(_SHARED) for name in declared)
    for name in sorted(given(node).keys() - declared):
        if name.startswith(_SHARED) and not knows_chain:
            continue
        raise ValueError(unknown(node, name, declared))


def given(node: Node) -> Mapping[str, Parameter]:
    """Parameters that a node was given from outside; rclpy has no public name for them."""
    overrides: dict[str, Parameter] = node._parameter_overrides
    return overrides


def type_name(kind: Any) -> str:
    """Name that ROS has for the type of a field."""
    return _TYPES[kind].name.lower()


def description_with_unit(described: Quantity) -> str:
    """What a parameter means, and its unit in brackets."""
    return described.description + (f' [{described.unit}]' if described.unit else '')


def describe_range(described: Quantity) -> str:
    """Values that a parameter may have, empty for any."""
    low, high = described.minimum, described.maximum
    if described.choices:
        return f'one of {", ".join(described.choices)}'
    if low is None and high is None:
        return ''
    if high is None:
        return f'{low:g} or more'
    return f'{high:g} or less' if low is None else f'{low:g} to {high:g}'


def _judge(
    adjustable: Mapping[str, Quantity], changes: Sequence[Parameter]
) -> SetParametersResult:
    """Refuse a change at run time that rclpy, which knows no choices, would let pass."""
    for change in changes:
        complaint = change.name in adjustable and adjustable[change.name].complaint(change.value)
        if complaint:
            reason = f'parameter {change.name} = {change.value!r} {complaint}'
            return SetParametersResult(successful=False, reason=reason)
    return SetParametersResult(successful=True)


def _take_whole_numbers(node: Node) -> None:
    """Have a node take changes at run time in the types that are meant, as it takes files."""
    # rclpy joins what such callbacks return, so that there must be one.
    if node not in _TAKING:
        _TAKING.add(node)
        node.add_pre_set_parameters_callback(
            lambda changes: [_meant(node, change) for change in changes]
        )


def _meant(node: Node, change: Parameter) -> Parameter:
    """Return a change at run time in the type that its parameter has, where it can be meant."""
    if not node.has_parameter(change.name) or change.type_ is Parameter.Type.NOT_SET:
        return change
    kind = Parameter.Type(node.describe_parameter(change.name).type)
    value = _taken(kind, change.value)
    return Parameter(change.name, kind, value) if kind.check(value) else change


def _taken(kind: Parameter.Type, value: Any) -> Any:
    """Whole numbers as those with a point where these are meant, and nothing as an empty list.

    An empty list comes without a value from files and as one of bytes or bools from elsewhere.
    """
    if kind in _LISTS and isinstance(value, (NoneType, list, tuple, array)):
        elements = list(value or ())
        whole = all(type(element) is int for element in elements)
        if kind is Parameter.Type.DOUBLE_ARRAY and whole:
            return [float(element) for element in elements]
        return elements
    return float(value) if kind is Parameter.Type.DOUBLE and type(value) is int else value


def _declare_one(node: Node, name: str, kind: Any, default: Any, described: Quantity) -> Any:
    type_, outside = _TYPES[kind], given(node).get(name)
    value = default if outside is None else _taken(type_, outside.value)
    right = type_.check(value) and (type_ is Parameter.Type.BOOL or not isinstance(value, bool))
    complaint = described.complaint(value) if right else f'must be {_EXAMPLES[type_]}'
    if complaint:
        raise ValueError(f'parameter {name} of {node.get_name()} = {value!r} {complaint}')
    descriptor = _descriptor(type_, described)
    if type_ in _LISTS:
        _declare_list(node, Parameter(name, type_, list(value)), descriptor)
    else:
        node.declare_parameter(name, value, descriptor, ignore_override=True)
    return _kept(type_, value)


def _declare_list(node: Node, parameter: Parameter, descriptor: ParameterDescriptor) -> None:
    """Declare a list that may be empty: rclpy infers the type from what is in it."""
    node.declare_parameter(parameter.name, parameter.type_, ignore_override=True)
    node.set_parameters([parameter])
    node.set_descriptor(parameter.name, descriptor)


def _kept(type_: Parameter.Type, value: Any) -> Any:
    """Value of a parameter as a field holds it."""
    return tuple(value) if type_ in _LISTS else value


def _descriptor(type_: Parameter.Type, described: Quantity) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        type=type_.value,
        description=description_with_unit(described),
        read_only=not described.adjustable,
        additional_constraints=', '.join(described.choices),
    )
    low, high = described.minimum, described.maximum
    if low is None and high is None:
        return descriptor
    if type_ is Parameter.Type.INTEGER:
        low = -_LARGEST_INTEGER if low is None else int(low)
        high = _LARGEST_INTEGER if high is None else int(high)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    else:
        low = float('-inf') if low is None else float(low)
        high = float('inf') if high is None else float(high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor
