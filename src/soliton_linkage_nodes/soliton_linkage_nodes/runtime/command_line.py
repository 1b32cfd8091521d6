# SPDX-License-Identifier: Apache-2.0
"""Command line of a node: help text and rejection of unknown arguments."""

from __future__ import annotations

import dataclasses
import inspect
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_type_hints

from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from soliton_linkage.linkage.quantities import described_fields
from soliton_linkage_nodes.runtime.parameters import (
    describe_range,
    description_with_unit,
    type_name,
)

NodeClass = Callable[[], Node]
USAGE = 2
"""Exit code of a program with wrong arguments, as in argparse."""
_WIDTH = 96
"""Longest line of the help text [characters]."""
_ROS_OPTIONS = ('--params-file', '-p', '--param', '-r', '--remap', '--log-level')
_EXAMPLES = ('-p NAME:=VALUE', '--params-file FILE', '-r NAME:=OTHER_NAME')
_PATHS = ('bag', 'output')
"""Parameters for a path. If the user gives a path without a parameter name, the error message
proposes the first of these parameters that the node has."""


def check_arguments(node: NodeClass, arguments: Sequence[str]) -> None:
    """Print the help of a node and exit if requested; exit if an argument is unknown."""
    if {'-h', '--help'} & set(arguments):
        print(help_text(node), flush=True)
        sys.exit(0)
    try:
        unknown = remove_ros_args(list(arguments))
    except RuntimeError:
        return
    if unknown:
        proposal, command = _proposal(node, unknown), _command(node)
        remedy = f'try: {command} {proposal}' if proposal else f'see {command} --help'
        text = ' '.join(unknown)
        print(f'{executable_name(node)}: unknown argument {text!r}; {remedy}', file=sys.stderr)
        sys.exit(USAGE)


def executable_name(node: NodeClass) -> str:
    """Return the name of a node's executable, which is also its default node name."""
    return re.sub(r'(?<!^)(?=[A-Z])', '_', node.__name__).lower()


def parameter_names(node: NodeClass) -> set[str]:
    """Return the names of all parameters in the groups that the attribute `PARAMETERS` lists."""
    groups = _groups(node).items()
    return {prefix + name for group, prefix in groups for name in described_fields(group)}


def help_text(node: NodeClass) -> str:
    """Return the help text of a node: its docstring and its parameters."""
    parameters = [
        line for group, prefix in _groups(node).items() for line in _describe(group, prefix)
    ]
    lines = [
        f'{executable_name(node)}: {inspect.cleandoc(node.__doc__ or "").replace("`", "")}',
        '',
        'Set parameters one by one or from a file, or rename topics:',
        *(f'  {_command(node)} --ros-args {example}' for example in _EXAMPLES),
        *(['', 'Parameters, with their defaults:', *parameters] if parameters else []),
    ]
    return '\n'.join(lines)


def _groups(node: NodeClass) -> dict[type, str]:
    groups: dict[type, str] = getattr(node, 'PARAMETERS', {})
    return groups


def _describe(group: type, prefix: str) -> Iterator[str]:
    types, quantities = get_type_hints(group), described_fields(group)
    for field in dataclasses.fields(group):
        if field.name in quantities:
            described = quantities[field.name]
            kind = type_name(types[field.name])
            yield f'  {prefix}{field.name}:={_as_yaml(field.default)}  ({kind})'
            adjustable = 'adjustable at run time' if described.adjustable else ''
            parts = (description_with_unit(described), describe_range(described), adjustable)
            text, indent = '; '.join(filter(None, parts)), ' ' * 6
            yield from textwrap.wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent)


def _as_yaml(value: Any) -> str:
    if isinstance(value, tuple):
        return str(list(value))
    return str(value).lower() if isinstance(value, bool) else str(value) or "''"


def _command(node: NodeClass) -> str:
    installed = shutil.which('ros2')
    runner = 'ros2 run soliton_linkage_nodes' if installed else 'soliton-linkage run'
    return f'{runner} {executable_name(node)}'


def _proposal(node: NodeClass, unknown: Sequence[str]) -> str | None:
    first, rest = unknown[0], unknown[1:]
    known = parameter_names(node)
    option, _, value = first.partition('=')
    name = option.lstrip('-').replace('-', '_')
    if first in _ROS_OPTIONS:
        return ' '.join(['--ros-args', *unknown])
    if ':=' in first:
        return f'--ros-args -p {first}'
    if name in known and (value or rest):
        return f'--ros-args -p {name}:={value or rest[0]}'
    if Path(first).suffix in ('.yaml', '.yml'):
        return f'--ros-args --params-file {first}'
    paths = [path for path in _PATHS if path in known]
    return None if first.startswith('-') or not paths else f'--ros-args -p {paths[0]}:={first}'
