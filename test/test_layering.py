# SPDX-License-Identifier: Apache-2.0
"""The layers: physics knows no ROS and no nodes, and no node knows another."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[1] / 'src'
PHYSICS = sorted((SOURCES / 'soliton_linkage/soliton_linkage').glob('**/*.py'))
MODULES = sorted((SOURCES / 'soliton_linkage_nodes/soliton_linkage_nodes').glob('**/*.py'))
ALLOWED_IN_PHYSICS = {'soliton_linkage', 'numpy', 'scipy', 'matplotlib', *sys.stdlib_module_names}
ALLOWED_IN_STUDIES = ALLOWED_IN_PHYSICS | {'distributed', 'imageio_ffmpeg', 'mpl_toolkits', 'yaml'}


def imported(path: Path) -> set[str]:
    """Dotted names that a file imports, down to the name taken from a module."""
    names = set()
    for statement in ast.walk(ast.parse(path.read_text())):
        if isinstance(statement, ast.Import):
            names |= {alias.name for alias in statement.names}
        elif isinstance(statement, ast.ImportFrom):
            package = [path.parent.name] if statement.level else []
            module = '.'.join([*package, *filter(None, [statement.module])])
            names |= {f'{module}.{alias.name}' for alias in statement.names}
    return names


def is_run(path: Path) -> bool:
    """Whether a module is a program: a node or a tool with a function `main`."""
    return any(getattr(part, 'name', '') == 'main' for part in ast.parse(path.read_text()).body)


PROGRAMS = {path.stem for path in MODULES if is_run(path)}


@pytest.mark.parametrize('path', PHYSICS, ids=lambda path: path.stem)
def test_physics_imports_nothing_but_itself_and_numerics(path: Path) -> None:
    allowed = ALLOWED_IN_STUDIES if path.parent.name == 'studies' else ALLOWED_IN_PHYSICS
    compiled = {'numba'} if path.stem == 'compiling' else set()
    assert {name.split('.')[0] for name in imported(path)} <= allowed | compiled


@pytest.mark.parametrize('path', PHYSICS, ids=lambda path: path.stem)
def test_physics_knows_no_study(path: Path) -> None:
    if path.parent.name != 'studies':
        assert not {name for name in imported(path) if 'studies' in name}


@pytest.mark.parametrize('path', MODULES, ids=lambda path: path.stem)
def test_no_module_imports_a_node(path: Path) -> None:
    modules = {tuple(name.split('.')[:2]) for name in imported(path)}
    assert not modules & {('soliton_linkage_nodes', program) for program in PROGRAMS}


def test_the_nodes_are_programs() -> None:
    nodes = {'simulator', 'edge_actuator', 'soliton_analyser', 'bag_recorder', 'bag_player'}
    assert nodes | {'soliton_steering'} <= PROGRAMS
