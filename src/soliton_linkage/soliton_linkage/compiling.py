# SPDX-License-Identifier: Apache-2.0
"""Compiles loops; imports numba.

Where types are given it does so when they are imported, so that nothing is compiled later, while
frames wait. What an earlier process has compiled is taken from its folder.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba import types
from numba.extending import intrinsic

Kernel = TypeVar('Kernel', bound=Callable[..., Any])

FREEDOMS = frozenset({'contract', 'nsz'})
"""Products and sums may contract, but no sum is reordered."""

NUMBER, COUNT, YES = types.float64, types.int64, types.boolean
READ = types.Array(types.float64, 1, 'C', readonly=True)
ROW = types.float64[::1]
READ_TABLE = types.Array(types.float64, 2, 'C', readonly=True)
TABLE = types.float64[:, ::1]
READ_FLAGS = types.Array(types.boolean, 1, 'C', readonly=True)
FLAGS = types.boolean[::1]
READ_BOX = types.Array(types.float64, 3, 'C', readonly=True)
BOX = types.float64[:, :, ::1]


def compiled(*arguments: Any) -> Callable[[Kernel], Kernel]:
    """Compile for arguments of these types."""

    def compile_for(function: Kernel) -> Kernel:
        return compile_loop(function, arguments)

    return compile_for


def compile_loop(
    function: Kernel,
    arguments: tuple[Any, ...] | None = None,
    freedoms: frozenset[str] = FREEDOMS,
    inlined: bool = False,
) -> Kernel:
    """Compile for arguments of these types, or for those that it is first called with.

    `inlined` puts it into the functions that call it, as they are compiled.
    """

    def compiler(cache: bool) -> Any:
        return numba.njit(
            arguments,
            cache=cache,
            fastmath=set(freedoms),
            error_model='numpy',
            forceinline=inlined,
            nogil=True,
        )

    try:
        return cast(Kernel, compiler(cache=True)(function))
    except RuntimeError:  # no folder to cache in can be written
        return cast(Kernel, compiler(cache=False)(function))


def _wide(_typing: Any) -> Any:
    """Vectorise the calling function as wide as the processor can; LLVM stays at half of it."""

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        # The method `add` of these attributes refuses names that it does not know.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), generate


take_widest_vectors = cast(Callable[[], None], intrinsic(_wide))


def _apart(_typing: Any) -> Any:
    """Promise that nothing is written to one array of the calling function and read from another.

    What has to be found out instead takes as long as some twenty rotors do.
    """

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        data = context.get_value_type(NUMBER).as_pointer()
        for argument in builder.function.args:
            if argument.type == data:
                argument.add_attribute('noalias')
        return context.get_dummy_value()

    return types.void(), generate


arrays_do_not_overlap = cast(Callable[[], None], intrinsic(_apart))
