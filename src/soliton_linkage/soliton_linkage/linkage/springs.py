# SPDX-License-Identifier: Apache-2.0
"""Geometry of one spring, or of an array of springs, between two neighbouring masses."""

from __future__ import annotations

from typing import Any

import numpy as np

TINY = float(np.finfo(np.float64).tiny)
"""Length below which the direction of a spring is undefined [m]."""


def spring_between(
    h_left: Any,
    v_left: Any,
    h_right: Any,
    v_right: Any,
    spacing: Any,
    offset: Any,
    rest_length: Any,
) -> tuple[Any, Any, Any]:
    """Return the extension [m] of a spring and its levers A and B [m/rad].

    The masses are at (h, v) [m] from their pivots. The distance between the pivots is `spacing`
    [m]; `offset` [m^2] is an element of `Chain.offsets`. With (dh, dv) = (a + h_right - h_left,
    v_right - v_left) the length is l = hypot(dh, dv). Its derivatives are A = (h_left dv - v_left
    dh) / l by the angle of the left rotor and B = (v_right dh - h_right dv) / l by the angle of
    the right rotor. Both are set to 0 if the masses coincide.

    Arguments are numbers or arrays that broadcast. Compiled loops inline this function:

        spring = compile_loop(spring_between, inlined=True)
    """
    across, up = h_right - h_left, v_right - v_left
    products = h_left * h_right + v_left * v_right
    excess = offset + 2 * spacing * across - 2 * products
    across = across + spacing
    length = np.hypot(across, up)
    divisor = np.maximum(length, TINY)
    return (
        excess / (length + rest_length),
        (h_left * up - v_left * across) / divisor,
        (v_right * across - h_right * up) / divisor,
    )
