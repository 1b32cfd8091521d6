# SPDX-License-Identifier: Apache-2.0
"""Reading of parameter files, and notices about overridden or unused parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from rclpy.node import Node

from soliton_linkage_nodes.runtime.parameters import overrides

_PARAMETERS = 'ros__parameters'
_WILDCARDS = {'**': r'(/\w+)*', '*': r'/\w+'}


Notice = tuple[str, bool]
"""Text to log, and whether it is a warning."""


def resolve_path(argument: str, value: str, known: Mapping[str, Path]) -> Path:
    """Return the path `known[value]`, or `value` as a path if it is no key of `known`.

    Raises ValueError if the path does not exist. `argument` is named in the text of the error.
    """
    path = known.get(value, Path(value))
    if not path.exists():
        raise ValueError(
            f'{argument}:={value} does not exist and is none of {", ".join(sorted(known))}; '
            f'give one of these, or a path from {Path.cwd()}'
        )
    return path


def check_files(arguments: Sequence[str]) -> None:
    """Raise ValueError if a command line names a parameter file that does not exist."""
    for path in map(Path, _values_of(arguments, '--params-file')):
        if not path.is_file():
            raise ValueError(
                f'parameter file {str(path)!r} does not exist; give a path from {Path.cwd()}'
            )


def read_sections(path: Path) -> dict[str, dict[str, Any]]:
    """Return the parameters in a file for each node pattern, such as `/**/simulator`.

    Raises OSError or ValueError if the file cannot be read or is no parameter file.
    """
    try:
        sections = dict(_sections(yaml.safe_load(path.read_text(encoding='utf-8')), ''))
    except (UnicodeDecodeError, yaml.YAMLError, AttributeError) as error:
        reason = ' '.join(str(error).split())
        raise ValueError(f'{path} is no parameter file: {reason}') from error
    if not sections:
        raise ValueError(f'{path} is no parameter file: it has no {_PARAMETERS}')
    return sections


def matches(pattern: str, node: str) -> bool:
    """Return whether a node pattern matches the name of a node."""
    tokens = pattern.strip('/').split('/')
    expression = ''.join(_WILDCARDS.get(token, '/' + re.escape(token)) for token in tokens)
    return re.fullmatch(expression, node) is not None


def notices(node: Node, arguments: Sequence[str], others: Sequence[Node] = ()) -> Iterator[Notice]:
    """Yield notices about the parameter files on the command line of a node.

    A warning names a file that has parameters neither for `node` nor for `others`. Another notice
    names each parameter whose value in a file differs from its value in an option `-p`.
    """
    name = node.get_fully_qualified_name()
    started = [name, *(other.get_fully_qualified_name() for other in others)]
    typed = dict(_rules(arguments, node.get_name()))
    for path in map(Path, _values_of(arguments, '--params-file')):
        try:
            sections = read_sections(path)
        except (OSError, ValueError):
            continue
        if not any(matches(pattern, one) for pattern in sections for one in started):
            remedy = f'begin its section with /**/{node.get_name()}:'
            text = f'{path} has parameters for {", ".join(sections)}, not for {name}; {remedy}'
            yield text, True
        own = [values for pattern, values in sections.items() if matches(pattern, name)]
        filed = {key: value for values in own for key, value in values.items()}
        for parameter in sorted(filed.keys() & typed.keys()):
            yield from _conflict(node, parameter, filed[parameter], typed[parameter], path)


def _conflict(node: Node, name: str, filed: Any, rule: str, path: Path) -> Iterator[Notice]:
    if name not in overrides(node):
        return
    used, typed = overrides(node)[name].value, rule.partition(':=')[2]
    if _number(filed) == _number(typed):
        return
    if _number(used) == _number(filed):
        remedy = 'change the file'
        if node.get_namespace() == '/':
            remedy = f'write -p {node.get_name()}:{name}:={typed} after it'
        yield f'{name} = {filed} of {path} overrides -p {rule}; {remedy}', True
    else:
        yield f'-p {rule} overrides {name} = {filed} of {path}', False


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
    for rule in [*_values_of(arguments, '-p'), *_values_of(arguments, '--param')]:
        target, _, name = rule.partition(':=')[0].rpartition(':')
        if target in ('', node):
            yield name, rule


def _values_of(arguments: Sequence[str], option: str) -> list[str]:
    return [value for name, value in pairwise(arguments) if name == option]


def _number(value: Any) -> Any:
    """Convert a value to a number if possible, because YAML 1.1 reads 1e-3 as a text."""
    try:
        read = yaml.safe_load(value) if isinstance(value, str) else value
        return float(read) if isinstance(read, (str, int, float)) else read
    except (ValueError, yaml.YAMLError):
        return value
