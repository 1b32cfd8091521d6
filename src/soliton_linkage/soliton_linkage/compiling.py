# SPDX-License-Identifier: Apache-2.0
"""Compiles the loops of the analysis when they are imported; imports numba.

Types are given, so that nothing is compiled later, while frames wait; what an earlier process has
compiled is taken from its folder.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba import types

Kernel = TypeVar('Kernel', bound=Callable[..., Any])

NUMBER, COUNT, YES = types.float64, types.int64, types.boolean
READ = types.Array(types.float64, 1, 'C', readonly=True)
ROW = types.float64[::1]
READ_TABLE = types.Array(types.float64, 2, 'C', readonly=True)
TABLE = types.float64[:, ::1]
READ_FLAGS = types.Array(types.boolean, 1, 'C', readonly=True)
FLAGS = types.boolean[::1]


def compiled(*arguments: Any) -> Callable[[Kernel], Kernel]:
    """Compile for arguments of these types; sums may contract, but none is reordered."""

    def compile_or_load(function: Kernel) -> Kernel:
        try:
            return _compiled(function, arguments, cache=True)
        except RuntimeError:  # no folder to cache in can be written
            return _compiled(function, arguments, cache=False)

    return compile_or_load


def _compiled(function: Kernel, arguments: tuple[Any, ...], cache: bool) -> Kernel:
    compiler = numba.njit(
        arguments,
        cache=cache,
        fastmath={'contract', 'nsz'},
        error_model='numpy',
        nogil=True,
    )
    return cast(Kernel, compiler(function))
