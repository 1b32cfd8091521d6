# SPDX-License-Identifier: Apache-2.0
"""Lazy import of the public names of a package (Scientific Python, SPEC 1).

The stub file `__init__.pyi` of the package lists the public names and their modules. A module is
imported at the first use of one of its names, so that programs start faster.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

Exports = tuple[Callable[[str], object], Callable[[], list[str]], list[str]]


def public_names(package: str, file: str) -> Exports:
    """Return `__getattr__`, `__dir__` and `__all__` of a package from its name and `__file__`."""
    stub = ast.parse(Path(file).with_suffix('.pyi').read_text(encoding='utf-8'))
    homes = {
        alias.name: statement.module
        for statement in stub.body
        if isinstance(statement, ast.ImportFrom) and statement.module
        for alias in statement.names
    }

    def get(name: str) -> object:
        if name not in homes:
            raise AttributeError(f'module {package!r} has no attribute {name!r}')
        value: object = getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return get, names, sorted(homes)
