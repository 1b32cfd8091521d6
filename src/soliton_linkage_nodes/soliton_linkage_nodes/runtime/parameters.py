# SPDX-License-Identifier: Apache-2.0
"""ROS parameters from dataclasses: declared with description, unit, range and read-only flag."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast, get_type_hints

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from soliton_linkage.linkage.quantities import Quantity, described_fields

Parameters = TypeVar('Parameters')

_TYPES: dict[Any, int] = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    tuple[str, ...]: ParameterType.PARAMETER_STRING_ARRAY,
    tuple[float, ...]: ParameterType.PARAMETER_DOUBLE_ARRAY,
}
_LISTS = {
    tuple[str, ...]: Parameter.Type.STRING_ARRAY,
    tuple[float, ...]: Parameter.Type.DOUBLE_ARRAY,
}
_EXAMPLES: dict[Any, str] = {
    bool: 'true or false',
    int: 'a whole number such as 20',
    float: 'a number with a decimal point such as 1.0',
    str: 'a text',
    tuple[str, ...]: 'a list of texts',
    tuple[float, ...]: 'a list of numbers with a decimal point such as [1.0, 0.5]',
}
_SHARED = 'chain.'
_LARGEST_INTEGER = 2**63 - 1
"""That a ROS parameter holds, which is an int64."""


def declare(node: Node, parameters: type[Parameters], prefix: str = '') -> Parameters:
    """Declare the described fields of a dataclass as parameters and return their values in it.

    Fields without a description keep their default. Raises ValueError, naming parameter, value,
    limit and remedy, where a value given for one is not allowed.
    """
    quantities = described_fields(parameters)
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
        name: node.get_parameter_or(prefix + name).value for name in described_fields(parameters)
    }
    kinds = get_type_hints(parameters)
    return parameters(**{name: _kept(kinds[name], value) for name, value in values.items()})


def refuse_unknown(node: Node) -> None:
    """Raise ValueError for a parameter that was given to a node and that it has not declared.

    The parameters `chain.*` may be given to every node, whether it needs them or not.
    """
    declared = set(node.get_parameters_by_prefix(''))
    knows_chain = any(name.startswith(_SHARED) for name in declared)
    for name in sorted(_given(node).keys() - declared):
        if name.startswith(_SHARED) and not knows_chain:
            continue
        near = difflib.get_close_matches(name, declared, n=1)
        meant = f'did you mean {near[0]!r}?' if near else f'known: {", ".join(sorted(declared))}'
        raise ValueError(f'parameter {name!r} of {node.get_name()} is unknown; {meant}')


def _given(node: Node) -> dict[str, Parameter]:
    """Parameters that a node was given from outside; rclpy has no public name for them."""
    given: dict[str, Parameter] = node._parameter_overrides
    return given


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


def _declare_one(node: Node, name: str, kind: Any, default: Any, described: Quantity) -> Any:
    # rclpy takes an empty list for one of bytes; a type alone leaves the parameter unset.
    value = _LISTS.get(kind, default)
    given = _given(node).get(name)
    try:
        declared = node.declare_parameter(name, value, _descriptor(kind, described)).value
    except ParameterException as error:
        raise ValueError(_complaint(node, name, kind, given, described)) from error
    complaint = described.complaint(declared)
    if complaint:
        raise ValueError(f'parameter {name} of {node.get_name()} = {declared!r} {complaint}')
    return _kept(kind, declared)


def _kept(kind: Any, value: Any) -> Any:
    """Value of a parameter as a field holds it; a list that was not given is empty."""
    return tuple(value or ()) if kind in _LISTS else value


def _descriptor(kind: Any, described: Quantity) -> ParameterDescriptor:
    unit = f' [{described.unit}]' if described.unit else ''
    descriptor = ParameterDescriptor(
        type=_TYPES[kind],
        description=described.description + unit,
        read_only=not described.adjustable,
        additional_constraints=', '.join(described.choices),
    )
    low, high = described.minimum, described.maximum
    if low is None and high is None:
        return descriptor
    if kind is int:
        low = -_LARGEST_INTEGER if low is None else int(low)
        high = _LARGEST_INTEGER if high is None else int(high)
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    else:
        low = float('-inf') if low is None else float(low)
        high = float('inf') if high is None else float(high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor


def _complaint(
    node: Node, name: str, kind: Any, given: Parameter | None, described: Quantity
) -> str:
    value = None if given is None else given.value
    complaint = described.complaint(value) if type(value) is kind else None
    complaint = complaint or f'must be {_EXAMPLES[kind]}'
    return f'parameter {name} of {node.get_name()} = {value!r} {complaint}'
