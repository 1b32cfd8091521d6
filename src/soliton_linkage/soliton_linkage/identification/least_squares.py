# SPDX-License-Identifier: Apache-2.0
"""Least squares on normal equations: damped steps, after Levenberg and Marquardt, and covariance.

Adjustments of bonds and fits of motions eliminate most of their unknowns, the angles of each frame
or the begin of each window, before they solve for the chain. The Jacobian of all unknowns, which
`scipy.optimize.least_squares` takes, has 10 GB for 3000 frames of 40 rotors. With that of
the chain's unknowns alone a step takes 3 s for 1000 frames, a whole adjustment here 0.4 s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

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
) -> State:
    """Return the state after some steps, the last of which promises a gain below `settled`.

    `linearised` returns a function that takes a damping [1] and returns the state after that step
    and the gain of the cost that it promises. Where no damping lowers the cost, the state is
    returned as it is.
    """
    damping, before = 0.0, cost(state)
    for _ in range(steps):
        step = linearised(state)
        for _ in range(_DAMPINGS):
            changed, promised = step(damping)
            with np.errstate(all='ignore'):
                after = cost(changed)
            if after < before:
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
    return np.asarray(basis @ np.linalg.solve(full, basis.T @ vector))


def covariance_in(basis: Array, information: Array) -> Array:
    """Return the covariance, (P, P), of changes in an orthonormal basis, (P, K)."""
    return np.asarray(basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T)
