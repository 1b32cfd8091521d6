# SPDX-License-Identifier: Apache-2.0
"""The command line of a node: its help, and what it does not know."""

from __future__ import annotations

import dataclasses
import inspect
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_type_hints

from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from soliton_linkage.linkage.quantities import Quantity, described_fields
from soliton_linkage_nodes.runtime.parameters import (
    describe_range,
    description_with_unit,
    type_name,
)

NodeClass = Callable[[], Node]
"""The class of a node that needs no arguments."""
USAGE = 2
"""Exit code of a program whose arguments are wrong, as argparse has it."""
_WIDTH = 96
"""Columns of the help, that of a usual window and of the sources."""
_PACKAGE = 'soliton_linkage_nodes'
_ROS_OPTIONS = ('--params-file', '-p', '--param', '-r', '--remap', '--log-level')
_EXAMPLES = ('-p NAME:=VALUE', '--params-file FILE', '-r NAME:=OTHER_NAME')
_PATHS = ('bag', 'output')
"""Parameters that a bare path is meant for, where a node has one."""


def check_arguments(node: NodeClass, arguments: Sequence[str]) -> None:
    """Print the help of a node and exit, or refuse arguments that it does not know with code 2.

    What follows `--ros-args` is left to ROS.
    """
    if {'-h', '--help'} & set(arguments):
        try:
            print(help_text(node), flush=True)
        except BrokenPipeError:
            # A pager has closed the pipe; Python would complain once more as it ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    try:
        unknown = remove_ros_args(list(arguments))
    except RuntimeError:
        return
    if unknown:
        meant = _meant(node, unknown)
        known = f'try: {_command(node)} {meant}' if meant else f'see {_command(node)} --help'
        print(
            f'{executable_name(node)} does not know {" ".join(unknown)!r}; {known}',
            file=sys.stderr,
        )
        sys.exit(USAGE)


def executable_name(node: NodeClass) -> str:
    """Name of the executable of a node and, unless it is remapped, of the node itself."""
    return re.sub(r'(?<!^)(?=[A-Z])', '_', node.__name__).lower()


def parameter_names(node: NodeClass) -> set[str]:
    """Names of the parameters that a node has whatever it is given."""
    return {
        prefix + name
        for group, prefix in _groups(node).items()
        for name in described_fields(group)
    }


def help_text(node: NodeClass) -> str:
    """What a node does, its topics, services and parameters, from its docstring and these."""
    told = inspect.cleandoc(node.__doc__ or '').replace('`', '')
    parameters = [
        line for group, prefix in _groups(node).items() for line in _described(group, prefix)
    ]
    lines = [
        f'{executable_name(node)}: {told}',
        '',
        'Run it with parameters by hand, from a file, or with other names of topics:',
        *(f'  {_command(node)} --ros-args {example}' for example in _EXAMPLES),
        *(['', 'Parameters, with their defaults:', *parameters] if parameters else []),
    ]
    return '\n'.join(lines)


def _groups(node: NodeClass) -> dict[type, str]:
    """Prefix of the parameters of a node by the dataclasses whose fields they are."""
    groups: dict[type, str] = getattr(node, 'PARAMETERS', {})
    return groups


def _described(group: type, prefix: str) -> Iterator[str]:
    kinds, quantities = get_type_hints(group), described_fields(group)
    for field in dataclasses.fields(group):
        if field.name in quantities:
            described = quantities[field.name]
            kind = type_name(kinds[field.name])
            yield f'  {prefix}{field.name}:={_as_yaml(field.default)}  ({kind})'
            yield from textwrap.wrap(
                _meaning(described), _WIDTH, initial_indent=' ' * 6, subsequent_indent=' ' * 6
            )


def _meaning(described: Quantity) -> str:
    changes = 'can be changed at run time' if described.adjustable else ''
    parts = (description_with_unit(described), describe_range(described), changes)
    return '; '.join(filter(None, parts))


def _as_yaml(value: Any) -> str:
    if isinstance(value, tuple):
        return str(list(value))
    return str(value).lower() if isinstance(value, bool) else str(value) or "''"


def _command(node: NodeClass) -> str:
    runner = f'ros2 run {_PACKAGE}' if shutil.which('ros2') else 'soliton-linkage run'
    return f'{runner} {executable_name(node)}'


def _meant(node: NodeClass, unknown: Sequence[str]) -> str | None:
    """Arguments that may be meant by those that are unknown; None where nothing comes near."""
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
