# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages to Python's built-in types and to YAML, and back."""

from __future__ import annotations

import array
import re
from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
import yaml

_SEQUENCE = re.compile(r'^(?:sequence<(?P<item>[^,>]+)(?:, \d+)?>|(?P<element>.+)\[\d+\])$')
_WIDTH = 100
"""Length at which a line of YAML is wrapped [characters]."""


def interface_type(name: str, kind: str) -> Any:
    """Return the class of the interface `name`, for example `sensor_msgs/JointState`.

    `kind` is `msg`, `srv` or `action`. Raises ValueError if the class is unknown.
    """
    package, _, rest = name.partition('/')
    middle, _, last = rest.rpartition('/')
    if not (package and last) or middle not in ('', kind):
        raise ValueError(f'{name!r} must be a type name such as PACKAGE/{kind}/NAME')
    try:
        return getattr(import_module(f'{package}.{kind}'), last)
    except ModuleNotFoundError as error:
        raise ValueError(f'{name}: the package {package} is not installed ({error})') from error
    except AttributeError as error:
        raise ValueError(f'{name}: {package}.{kind} has no {last}') from error


def plain(value: Any) -> Any:
    """Convert a message or the value of a field to dictionaries, lists, numbers and strings."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (array.array, np.ndarray)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    return value


def to_yaml(value: Any) -> str:
    """Return a message or a field's value as YAML.

    A list of numbers or texts is in one line, which is wrapped if it is too long (see `_WIDTH`).
    """
    text: str = yaml.dump(
        plain(value), Dumper=_Dumper, sort_keys=False, width=_WIDTH, allow_unicode=True
    )
    return text.removesuffix('...\n')


def _list_in_lines(dumper: Any, values: list[Any]) -> Any:
    flat = not any(isinstance(value, (list, dict)) for value in values)
    return dumper.represent_sequence('tag:yaml.org,2002:seq', values, flow_style=flat)


_Dumper: Any = type('_Dumper', (yaml.SafeDumper,), {})
_Dumper.add_representer(list, _list_in_lines)


def read(message_type: Any, text: str) -> Any:
    """Return the message that a YAML text describes, for example '{data: 0.25}'.

    Raises ValueError if the text is invalid.
    """
    try:
        values = yaml.safe_load(text or '{}')
    except yaml.YAMLError as error:
        raise ValueError(f'{text!r} is not YAML: {" ".join(str(error).split())}') from error
    return built(message_type, values)


def built(message_type: Any, values: Any) -> Any:
    """Return a message from a mapping of field names to values. Other fields have their defaults.

    Raises ValueError if a field is unknown or a value does not fit the type of its field.
    """
    types = message_type.get_fields_and_field_types()
    name = _name(message_type)
    if not isinstance(values, Mapping):
        shape = ', '.join(f'{field}: ...' for field in types)
        raise ValueError(f'{values!r} must be a mapping of the fields of {name}: {{{shape}}}')
    # Without this check, publishing an invalid field would end the process.
    message = message_type(check_fields=True)
    for field, value in values.items():
        if field not in types:
            raise ValueError(f'{name} has no field {field!r}; it has {", ".join(types)}')
        present = getattr(message, field)
        if hasattr(present, 'get_fields_and_field_types'):
            setattr(message, field, built(type(present), value))
            continue
        if '/' in types[field] and isinstance(value, list):
            match = _SEQUENCE.match(types[field])
            assert match
            item = interface_type(match['item'] or match['element'], 'msg')
            setattr(message, field, [built(item, values) for values in value])
            continue
        try:
            setattr(message, field, _converted(present, value))
        except (AssertionError, OverflowError, TypeError, ValueError) as error:
            raise ValueError(
                f'{name}: {field} = {value!r} must be of type {types[field]}'
            ) from error
    return message


def _converted(present: Any, value: Any) -> Any:
    if isinstance(present, float):
        return float(value)
    if isinstance(present, bytes):
        return bytes(value)
    if isinstance(present, array.array):
        return array.array(present.typecode, value)
    if isinstance(present, np.ndarray):
        return np.array(value, dtype=present.dtype)
    return value


def _name(message_type: Any) -> str:
    package, kind = message_type.__module__.split('.')[:2]
    return f'{package}/{kind}/{message_type.__name__.removesuffix("_Request")}'
