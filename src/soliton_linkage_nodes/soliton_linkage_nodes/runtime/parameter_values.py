# SPDX-License-Identifier: Apache-2.0
"""Conversion of values to the types of ROS parameters, and reasons to reject a value."""

from __future__ import annotations

import math
from array import array
from types import NoneType
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter

from soliton_linkage.linkage.quantities import Quantity

LISTS = (Parameter.Type.STRING_ARRAY, Parameter.Type.DOUBLE_ARRAY)
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


def convert(kind: Parameter.Type, value: Any) -> Any:
    """Convert integers to floats, and sequences or None to lists, if the type `kind` needs it."""
    if kind in LISTS and isinstance(value, (NoneType, list, tuple, array)):
        elements = list(value or ())
        whole = all(type(element) is int for element in elements)
        if kind is Parameter.Type.DOUBLE_ARRAY and whole:
            return [float(element) for element in elements]
        return elements
    return float(value) if kind is Parameter.Type.DOUBLE and type(value) is int else value


def type_complaint(kind: Parameter.Type, value: Any) -> str:
    """Return '' if a value has the type `kind`, otherwise a text such as 'must be a text'."""
    fits = kind.check(value) and (kind is Parameter.Type.BOOL or not isinstance(value, bool))
    return '' if fits else f'must be {_EXAMPLES[kind]}'


def limits(descriptor: ParameterDescriptor) -> Quantity:
    """Return the range and choices in a parameter's descriptor; an unlimited end becomes None."""
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    ends = (ranges[0].from_value, ranges[0].to_value) if ranges else (math.inf, math.inf)
    low, high = (each if abs(each) < LARGEST_INTEGER else None for each in ends)
    text = descriptor.type == Parameter.Type.STRING.value
    choices = descriptor.additional_constraints if text else ''
    return Quantity('', '', low, high, tuple(filter(None, choices.split(', '))))


def rejection(descriptor: ParameterDescriptor, value: Any) -> str:
    """Return the reason why a parameter cannot have a value, and a remedy; '' if it can."""
    name, kind = descriptor.name, Parameter.Type(descriptor.type)
    if descriptor.read_only:
        return (
            f'parameter {name} is read-only while its node runs; start the node with '
            f'-p {name}:={value}'
        )
    if descriptor.dynamic_typing or kind is Parameter.Type.NOT_SET:
        return ''
    converted = convert(kind, value)
    complaint = type_complaint(kind, converted) or limits(descriptor).complaint(converted)
    return f'parameter {name} = {value!r} {complaint}; set another value' if complaint else ''
