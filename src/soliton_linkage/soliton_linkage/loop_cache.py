# SPDX-License-Identifier: Apache-2.0
"""Cache of compiled loops: one file with a checksum for each loop, signature and processor type.

This module replaces the cache of numba, which has three faults. An empty or truncated index file
raises an error at import. Two processes can write different loops to the same file. After a change
of a function, the loops of other modules that call it are not recompiled. The module uses private
classes of numba, because numba has no public interface for a cache.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import pickle
import re
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any
from uuid import uuid4

import numba
import numpy as np
from numba.core.caching import FunctionCache
from numba.core.serialize import dumps

_CHECKSUM = hashlib.sha256().digest_size
"""Size of a checksum [bytes]."""
_CONSTANTS = (bool, int, float, str, tuple, frozenset)
"""Types of global values that numba compiles into a loop as constants."""


class LoopCache(FunctionCache):  # type: ignore[misc]
    """Cache of one loop; a damaged or outdated file is ignored and replaced."""

    def __init__(self, function: Callable[..., Any], options: object) -> None:
        """Create the cache; raise RuntimeError if no folder is writable."""
        super().__init__(function)
        self._options = repr(options)
        name = re.sub(r'-\d+(?=\.py)', '', self._impl.filename_base)  # omit the line number
        self._cache_file = _LoopFiles(Path(self.cache_path), name)

    def _index_key(self, sig: Any, codegen: Any) -> tuple[str, str]:
        """Return the text that determines the file name, and a text that changes with the code."""
        target = repr((sig, codegen.magic_tuple()))
        versions = f'numba {numba.__version__} llvmlite {version("llvmlite")}'
        return target, f'{target} {versions} {self._options} {_code_digest(self._py_func)}'

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a compiled loop; if the folder is not writable, log one warning."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            report_once(f'compiled loops cannot be saved and will be compiled again: {error}')


class _LoopFiles:
    def __init__(self, folder: Path, name: str) -> None:
        self._folder = folder
        self._name = name

    def load(self, key: tuple[str, str]) -> Any:
        path = self._path(key)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        if _checksum(content[_CHECKSUM:]) != content[:_CHECKSUM]:
            report_once(f'{path} is damaged and is replaced; its loop is compiled again')
            return None
        stored = content[_CHECKSUM:]
        if stored[:_CHECKSUM] != _checksum(key[1].encode()):
            return None
        try:
            return pickle.loads(stored[_CHECKSUM:])
        except ImportError:  # a function that the loop calls has moved to another module
            return None

    def save(self, key: tuple[str, str], data: Any) -> None:
        stored = _checksum(key[1].encode()) + dumps(data)
        path = self._path(key)
        unfinished = path.with_suffix(f'.{uuid4().hex}')
        try:
            unfinished.write_bytes(_checksum(stored) + stored)
            unfinished.replace(path)
        finally:
            unfinished.unlink(missing_ok=True)

    def flush(self) -> None:
        for path in self._folder.glob(f'{self._name}.*.nbc'):
            path.unlink(missing_ok=True)

    def _path(self, key: tuple[str, str]) -> Path:
        return self._folder / f'{self._name}.{_checksum(key[0].encode()).hex()[:12]}.nbc'


@functools.cache
def report_once(text: str) -> None:
    """Log a warning about the cache if it is the first one in this process."""
    if report_once.cache_info().currsize == 0:
        logging.getLogger(__name__).warning(text)


def _code_digest(function: Any) -> str:
    found: dict[str, None] = {}
    waiting, seen = [function], set()
    while waiting:
        loop = waiting.pop()
        if loop in seen:
            continue
        seen.add(loop)
        found[f'{loop.__qualname__} {loop.__defaults__} {_instructions(loop)}'] = None
        for name, value in _used(loop):
            if isinstance(value, _CONSTANTS):
                found[f'{name} = {value!r}'] = None
            elif isinstance(value, np.ndarray):
                found[f'{name} = {value.dtype} {value.shape} {value.tobytes().hex()}'] = None
            elif isinstance(value, type):
                found[f'{name} {getattr(value, "_fields", ())}'] = None
            elif isinstance(plain := getattr(value, 'py_func', None), FunctionType):
                waiting.append(plain)
    return _checksum('\n'.join(sorted(found)).encode()).hex()


def _instructions(function: Any) -> list[Any]:
    """Return the contents of a function's code objects, without docstring and line numbers."""
    return [
        (
            code.co_code.hex(),
            code.co_names,
            code.co_varnames,
            code.co_freevars,
            [
                constant
                for constant in code.co_consts
                if not isinstance(constant, CodeType) and constant != function.__doc__
            ],
        )
        for code in _codes(function.__code__)
    ]


def _used(function: Any) -> Iterator[tuple[str, Any]]:
    """Yield name and value of each global or enclosed variable that a function may read."""
    for code in _codes(function.__code__):
        for name in code.co_names:
            if name in function.__globals__:
                yield name, function.__globals__[name]
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _checksum(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()
