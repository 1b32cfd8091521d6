# SPDX-License-Identifier: Apache-2.0
"""Messages as plain numbers, texts, lists and dictionaries, and as YAML; and back."""

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
"""Of a line of YAML [characters]."""


def interface_type(name: str, kind: str) -> Any:
    """Type by its name, as 'std_msgs/msg/Float64' or 'std_msgs/Float64', of a kind as 'msg'.

    Raises ValueError where there is none.
    """
    package, _, rest = name.partition('/')
    middle, _, last = rest.rpartition('/')
    if not (package and last) or middle not in ('', kind):
        raise ValueError(f'{name!r} must be the name of a type, as PACKAGE/{kind}/NAME')
    try:
        return getattr(import_module(f'{package}.{kind}'), last)
    except ModuleNotFoundError as error:
        raise ValueError(f'{name}: the package {package} is not installed ({error})') from error
    except AttributeError as error:
        raise ValueError(f'{name}: {package}.{kind} has no {last}') from error


def plain(value: Any) -> Any:
    """A message, or a value of one of its fields, as YAML can have it."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (array.array, np.ndarray)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    return value


def as_yaml(value: Any) -> str:
    """YAML of a message or of a field, with lists of numbers in as few lines as may be."""
    text = yaml.safe_dump(
        plain(value), sort_keys=False, default_flow_style=None, width=_WIDTH, allow_unicode=True
    )
    return text.removesuffix('...\n')


def filled(message: Any, text: str) -> Any:
    """The message, with the fields that YAML as '{data: 0.25}' gives; ValueError where it cannot."""
    try:
        values = yaml.safe_load(text or '{}')
    except yaml.YAMLError as error:
        raise ValueError(f'{text!r} is not YAML: {" ".join(str(error).split())}') from error
    _fill(message, values)
    return message


def _fill(message: Any, values: Any) -> None:
    types = message.get_fields_and_field_types()
    name = _name(message)
    if not isinstance(values, Mapping):
        raise ValueError(f'{values!r} must be fields of {name}, as {{{next(iter(types), "")}: ...}}')
    for field, value in values.items():
        if field not in types:
            raise ValueError(f'{name} has no field {field!r}; it has {", ".join(types)}')
        present = getattr(message, field)
        if hasattr(present, 'get_fields_and_field_types'):
            _fill(present, value)
            continue
        try:
            setattr(message, field, _converted(present, value, types[field]))
        except (AssertionError, OverflowError, TypeError) as error:
            raise ValueError(
                f'{name}: {field} = {value!r} must be of type {types[field]}'
            ) from error


def _converted(present: Any, value: Any, type_name: str) -> Any:
    """A value in the type of the field whose present value is given."""
    sequence = _SEQUENCE.match(type_name)
    if isinstance(present, float):
        return float(value)
    if isinstance(present, array.array):
        return array.array(present.typecode, value)
    if isinstance(present, np.ndarray):
        return np.array(value, dtype=present.dtype)
    if sequence and '/' in type_name:
        item = interface_type(sequence['item'] or sequence['element'], 'msg')
        messages = [item() for _ in value]
        for message, values in zip(messages, value, strict=True):
            _fill(message, values)
        return messages
    return value


def _name(message: Any) -> str:
    package, kind = type(message).__module__.split('.')[:2]
    return f'{package}/{kind}/{type(message).__name__}'
