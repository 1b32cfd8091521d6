# SPDX-License-Identifier: Apache-2.0
"""Geometry of a spring between two neighbouring masses, for one spring or arrays of springs."""

from __future__ import annotations

from typing import Any

import numpy as np

TINY = float(np.finfo(np.float64).tiny)
"""Lower bound of the spring length by which the formulas of the levers divide [m]. Because of this
bound, the levers are 0 instead of NaN if the masses coincide."""


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

    Relative to their pivots, the masses are at (h_left, v_left) and (h_right, v_right) [m]. The
    distance between the pivots is the `spacing` a [m], and `offset` [m^2] is an element of
    `Chain.offsets`. Let (dh, dv) = (a + h_right - h_left, v_right - v_left) and l = hypot(dh, dv).
    The derivatives of l with respect to the angles of the left and the right rotor are
    A = (h_left dv - v_left dh) / l and B = (v_right dh - h_right dv) / l. They are set to 0 if the
    masses coincide. The arguments are numbers or arrays. Compiled loops also call this function.
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
