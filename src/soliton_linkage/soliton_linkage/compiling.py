# SPDX-License-Identifier: Apache-2.0
"""Compilation of loops by numba.

A function whose argument types are given is compiled during import, so that its calls do not wait
for the compiler. With NUMBA_DISABLE_JIT=1, loops run as Python code. They are then slower, but the
results are the same up to rounding errors.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic

from soliton_linkage.loop_cache import LoopCache, report_once

Kernel = TypeVar('Kernel', bound=Callable[..., Any])


def _nothing() -> None:
    pass


_compiled_or_not: object = numba.njit(_nothing)

COMPILES = _compiled_or_not is not _nothing
"""Whether numba compiles functions; false with NUMBA_DISABLE_JIT=1."""


FASTMATH_FLAGS = frozenset({'contract', 'nsz'})
"""Compiler flags that allow fused multiply-add, but no reordering of sums."""

f8, i8, b1 = types.float64, types.int64, types.boolean
const_f8_1d = types.Array(types.float64, 1, 'C', readonly=True)
f8_1d = types.float64[::1]
i8_1d = types.int64[::1]
const_f8_2d = types.Array(types.float64, 2, 'C', readonly=True)
f8_2d = types.float64[:, ::1]
const_b1_1d = types.Array(types.boolean, 1, 'C', readonly=True)
b1_1d = types.boolean[::1]
const_i8_2d = types.Array(types.int64, 2, 'C', readonly=True)
f8_3d = types.float64[:, :, ::1]
const_u1_2d = types.Array(types.uint8, 2, 'C', readonly=True)
u1_3d = types.uint8[:, :, ::1]
f4_3d = types.float32[:, :, ::1]
const_f4_3d = types.Array(types.float32, 3, 'C', readonly=True)
const_f4_1d = types.Array(types.float32, 1, 'C', readonly=True)
const_f4_2d = types.Array(types.float32, 2, 'C', readonly=True)


def records(dtype: np.dtype[np.void], writable: bool = False) -> Any:
    """Return the numba type of a 1-D structured array."""
    return types.Array(numba.from_dtype(dtype), 1, 'C', readonly=not writable)


def named_tuple(row: type[tuple[Any, ...]], *fields: Any) -> Any:
    """Return the numba type of a named tuple; `fields` is one common type, or one per field."""
    untyped = cast(Any, types)
    if len(fields) == 1:
        fields *= len(cast(Any, row)._fields)
    if len(set(fields)) == 1:
        return untyped.NamedUniTuple(fields[0], len(fields), row)
    return untyped.NamedTuple(fields, row)


def compiled(*arguments: Any) -> Callable[[Kernel], Kernel]:
    """Return a decorator that compiles a function at once, for arguments of the given types."""
    return lambda function: compile_loop(function, arguments)


def compile_loop(
    function: Kernel,
    arguments: tuple[Any, ...] | None = None,
    fastmath: frozenset[str] = FASTMATH_FLAGS,
    inlined: bool = False,
) -> Kernel:
    """Return a compiled function.

    If `arguments`, the types of the arguments, is given, the function is compiled at once for
    these types. Otherwise, it is compiled at its first call. `fastmath` contains flags for the
    compiler. If `inlined` is true, the compiler copies the function into its compiled callers.
    """
    options: dict[str, Any] = {
        'fastmath': set(fastmath),
        'error_model': 'numpy',
        'forceinline': inlined,
        'nogil': True,
    }
    loop: Any = numba.njit(**options)(function)
    if not COMPILES:
        return cast(Kernel, loop)
    try:
        loop._cache = LoopCache(function, [*sorted(fastmath), inlined])
    except RuntimeError:
        report_once(
            'no folder for compiled loops is writable, so that every start compiles the loops '
            'again; set NUMBA_CACHE_DIR to a writable folder'
        )
    if arguments is not None:
        loop.compile(arguments)
        loop.disable_compile()
    return cast(Kernel, loop)


def inlined(function: Kernel) -> Kernel:
    """Return a compiled function that the compiler copies into its compiled callers."""
    return compile_loop(function, inlined=True)


def _hint(attribute: str) -> Callable[[], None]:
    """Return a function F that adds an LLVM attribute to each compiled function that calls F."""

    def typed(_typing: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
            # `set.add` is called directly, because the method `add` of llvmlite's attributes
            # rejects names that it does not know.
            set.add(builder.function.attributes, attribute)
            return context.get_dummy_value()

        return types.void(), generate

    return cast(Callable[[], None], intrinsic(typed)) if COMPILES else _nothing


prefer_wide_vectors = _hint('"prefer-vector-width"="512"')
"""Hint that makes the compiler use vectors of 512 bits in the calling function. By default, LLVM
uses 256 bits. On processors with AVX-512, the hint makes `SymplecticNystrom` 1.3 times as fast for
40 rotors, and 1.5 times as fast for 1000 rotors."""

never_inlined = _hint('noinline')
"""Hint that keeps the compiler from copying the calling function into the functions that call it.
The compilation is then faster."""
