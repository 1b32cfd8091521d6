# SPDX-License-Identifier: Apache-2.0
"""YAML and JSON of strangers, refused by size, depth and kind before they are made objects."""

from __future__ import annotations

import json
import re
from typing import Any

import yaml

LARGEST_TEXT = 4 * 2**20
"""Size of a text that is taken [B]: metadata.yaml of a thousand topics has a fourth of it, and
what is made of a text takes a hundred times its size."""
_DEEPEST = 30
"""Levels of lists and mappings; what rosbag2 writes has 6."""
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_OPENING = (yaml.SequenceStartEvent, yaml.MappingStartEvent)
_CLOSING = (yaml.SequenceEndEvent, yaml.MappingEndEvent)
_LONG_NUMBER = re.compile(r'[-+]?\d[\d_:.]{99,}')
"""A number whose value takes longer to work out than all the text."""
_JSON_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[\[{]|[\]}]', re.DOTALL)


def load_yaml(text: str) -> Any:
    """What a text says in plain YAML; ValueError where it is none, too large or too deep.

    Aliases, by which a few lines stand for billions, and tags of Python objects are refused.
    """
    _check_size(text)
    try:
        depth = 0
        for event in yaml.parse(text, _LOADER):
            depth += isinstance(event, _OPENING) - isinstance(event, _CLOSING)
            _check_depth(depth)
            if isinstance(event, yaml.AliasEvent):
                raise ValueError('it has an alias, which stands for another part of it')
            plain = isinstance(event, yaml.ScalarEvent) and not event.style
            if plain and _LONG_NUMBER.fullmatch(event.value):
                raise ValueError(f'it has a number of {len(event.value)} characters')
        return yaml.load(text, _LOADER)
    except (yaml.YAMLError, RecursionError, OverflowError) as error:
        raise ValueError(' '.join(str(error).split())) from error


def load_json(text: str) -> Any:
    """What a text says in JSON; ValueError where it is none, too large or too deep."""
    _check_size(text)
    depth = 0
    for token in _JSON_TOKEN.finditer(text):
        depth += {'[': 1, '{': 1, ']': -1, '}': -1}.get(token[0], 0)
        _check_depth(depth)
    return json.loads(text, parse_constant=_refuse_constant)


def count_in(value: object) -> int:
    """A count as it may stand in a text, 0 for what is none."""
    number = int(value) if isinstance(value, str) and re.fullmatch(r'\d{1,18}', value) else value
    sound = isinstance(number, int) and not isinstance(number, bool) and 0 <= number < 2**63
    return number if sound and isinstance(number, int) else 0


def _check_size(text: str) -> None:
    if len(text) > LARGEST_TEXT:
        raise ValueError(f'it has {len(text)} characters, more than {LARGEST_TEXT}')


def _check_depth(depth: int) -> None:
    if depth > _DEEPEST:
        raise ValueError(f'it is nested deeper than {_DEEPEST} levels')


def _refuse_constant(name: str) -> Any:
    raise ValueError(f'{name} is no number of JSON')
