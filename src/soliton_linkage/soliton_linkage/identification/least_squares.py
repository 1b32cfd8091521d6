# SPDX-License-Identifier: Apache-2.0
"""Damped steps of least squares on normal equations, after Levenberg and Marquardt.

Adjustments of bonds and fits of motions share it. Both eliminate most of their unknowns, the
angles of each frame or the begin of each window, before they solve for the chain. With the
Jacobian of all unknowns, which `scipy.optimize.least_squares` takes, they would not fit into
memory.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from scipy.linalg import solve

from soliton_linkage.linkage.chain import Array

State = TypeVar('State')

_DAMPINGS = 12
"""Dampings that are tried for one step [1], the last 100: six stop short of the least in bent
valleys."""
_DAMPED = 1e-3
"""Damping beyond which a small promise is that of a short step [1], not of the end."""


def minimised(
    state: State,
    linearised: Callable[[State], Callable[[float], tuple[State, float]]],
    cost: Callable[[State], float],
    steps: int,
    settled: float,
    uphill: float = 0.0,
) -> State:
    """Return the state after some steps, the last of which promises a gain below `settled`.

    `linearised` returns a function that takes a damping [1] and returns the state after that step
    and the gain of the cost that it promises. A step may raise the cost by `uphill`. Where no
    damping lowers it, the state is returned as it is.
    """
    damping, before = 0.0, cost(state)
    for _ in range(steps):
        step = linearised(state)
        for _ in range(_DAMPINGS):
            changed, promised = step(damping)
            with np.errstate(all='ignore'):
                after = cost(changed)
            if after < before + uphill:
                break
            damping = max(4 * damping, 1e-4)
        else:
            return state
        state, before = changed, after
        if promised < settled and damping < _DAMPED:
            return state
        damping /= 8
    return state


def damped_change(matrix: Array, vector: Array, basis: Array, damping: float = 0.0) -> Array:
    """Return the change, (P,), in an orthonormal basis, (P, K), that solves normal equations."""
    full = basis.T @ matrix @ basis
    full += damping * np.diag(np.diag(full))
    return np.asarray(basis @ solve(full, basis.T @ vector, assume_a='sym'))
