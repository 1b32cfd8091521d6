# SPDX-License-Identifier: Apache-2.0
"""Files of parameters, and what a node that was started with some should say about them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from rclpy.node import Node

from soliton_linkage_nodes.runtime.parameters import given

_PARAMETERS = 'ros__parameters'
_WILDCARDS = {'**': r'(/\w+)*', '*': r'/\w+'}


class Notice(NamedTuple):
    """Something to be said in one line, and whether it is a warning."""

    text: str
    warning: bool


def resolve_path(argument: str, given: str, known: Mapping[str, Path]) -> Path:
    """Return the path that a known name means, or that is given itself, to a launch file.

    Raises ValueError, which names the argument, where nothing is there.
    """
    path = known.get(given, Path(given))
    if not path.exists():
        raise ValueError(
            f'{argument}:={given} is not there and none of {", ".join(sorted(known))}; '
            f'paths are looked for from {Path.cwd()}'
        )
    return path


def read_sections(path: Path) -> dict[str, dict[str, Any]]:
    """Parameters of a file by the pattern of the nodes that they are for, and by their name.

    Raises OSError, or ValueError where it is no file of parameters.
    """
    try:
        sections = dict(_sections(yaml.safe_load(path.read_text(encoding='utf-8')), ''))
    except (UnicodeDecodeError, yaml.YAMLError, AttributeError) as error:
        reason = ' '.join(str(error).split())
        raise ValueError(f'{path} is no file of parameters: {reason}') from error
    if not sections:
        raise ValueError(f'{path} is no file of parameters: it has no {_PARAMETERS}')
    return sections


def concerns(pattern: str, node: str) -> bool:
    """Whether the pattern of a section names a node, given by its full name."""
    tokens = pattern.strip('/').split('/')
    expression = ''.join(_WILDCARDS.get(token, '/' + re.escape(token)) for token in tokens)
    return re.fullmatch(expression, node) is not None


def notices(node: Node, arguments: Sequence[str], beside: Sequence[Node] = ()) -> Iterator[Notice]:
    """What is to be said of the files and the `-p` that a node was started with.

    Files may be for the nodes beside it alone, which have been started with the same arguments.
    """
    name = node.get_fully_qualified_name()
    started = [name, *(other.get_fully_qualified_name() for other in beside)]
    by_hand = dict(_rules(arguments, node.get_name()))
    for path in map(Path, _values_of(arguments, '--params-file')):
        try:
            sections = read_sections(path)
        except (OSError, ValueError):
            continue
        named = [held for pattern, held in sections.items() if concerns(pattern, name)]
        if not any(concerns(pattern, one) for pattern in sections for one in started):
            others = ', '.join(sections)
            remedy = f'begin its section with /**/{node.get_name()}:'
            yield Notice(f'{path} has parameters for {others}, not for {name}; {remedy}', True)
        held = {key: value for section in named for key, value in section.items()}
        for parameter in sorted(held.keys() & by_hand.keys()):
            yield from _conflict(node, parameter, held[parameter], by_hand[parameter], path)


def _conflict(node: Node, name: str, held: Any, rule: str, path: Path) -> Iterator[Notice]:
    """Say which of two values of a parameter counts, where they differ."""
    if name not in given(node):
        return
    taken, typed = given(node)[name].value, rule.partition(':=')[2]
    if _number(held) == _number(typed):
        return
    if _number(taken) == _number(held):
        alone = node.get_namespace() == '/'
        remedy = f'write -p {node.get_name()}:{name}:={typed} after it' if alone else 'change it'
        yield Notice(f'{name} = {held} of {path} overrides -p {rule}; {remedy}', True)
    else:
        yield Notice(f'-p {rule} overrides {name} = {held} of {path}', False)


def _sections(content: Mapping[str, Any], above: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for key, value in content.items():
        if key == _PARAMETERS:
            yield above, dict(_flattened(value, ''))
        else:
            yield from _sections(value, f'{above}/{key.strip("/")}')


def _flattened(values: Mapping[str, Any], above: str) -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flattened(value, f'{above}{name}.')
        else:
            yield f'{above}{name}', value


def _rules(arguments: Sequence[str], node: str) -> Iterator[tuple[str, str]]:
    """Rule of each parameter that is given by `-p` to all nodes or to this one, by its name."""
    for rule in [*_values_of(arguments, '-p'), *_values_of(arguments, '--param')]:
        whom, _, name = rule.partition(':=')[0].rpartition(':')
        if whom in ('', node):
            yield name, rule


def _values_of(arguments: Sequence[str], option: str) -> list[str]:
    pairs = pairwise(arguments)
    return [value for name, value in pairs if name == option]


def _number(value: Any) -> Any:
    """Value for a comparison, in which 1e-3 is a number although YAML 1.1 takes it for a text."""
    try:
        read = yaml.safe_load(value) if isinstance(value, str) else value
        return float(read) if isinstance(read, (str, int, float)) else read
    except (ValueError, yaml.YAMLError):
        return value
