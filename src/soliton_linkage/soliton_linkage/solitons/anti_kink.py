# SPDX-License-Identifier: Apache-2.0
"""Anti-kinks at rest, which cost energy: the springs are least stretched for where they are.

The place of a kink is free; that of an anti-kink is held by a constraint. Its path are the states
of least energy with a given sum of a field F over the rotors, `constraint_field`,

    grad V(phi) = p grad F(phi),    sum_n F_n(phi) = N - 1 - 2 x,

with the pull p, by Newton's method along x. Where the states of some x buckle there is no path:
the anti-kink is pinned, and slips from one site to another.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal, solve_banded
from scipy.optimize import minimize

from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered

_SAMPLES = 65
"""Of a path, over the two spacings after which it repeats: splines of them are good to 1e-6."""
_NEWTON_STEPS = 30
"""At most, to a state of least energy; some five do [1]."""
_CONVERGED = 1e-7
"""Step of Newton's that is the last [rad]."""
_LONGEST = 0.3
"""Step of Newton's [rad]."""
_BUCKLING = 1e-6
"""Least curvature, over the largest [1]: below it is rounding."""


@lru_cache(maxsize=8)
def anti_kink_path(chain: Chain, begin: float) -> tuple[Array, Array]:
    """Places of an anti-kink [rotor spacings], shape (K,), and its states [rad], shape (K, N).

    From a place on for two spacings, after which states repeat two rotors further. Places count
    the arc of the path, as those of kinks do. The chain must be so long that its ends are at
    rest. Raises ArithmeticError where the anti-kink is pinned.
    """
    angles, pull = continuum_anti_kink(chain, begin), 0.0
    found = []
    for place in np.linspace(begin, begin + 2, _SAMPLES):
        angles, pull = _least(chain, angles, pull, chain.number_of_rotors - 1 - 2 * float(place))
        found.append(angles)
    states = np.array(found)
    arcs = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(states, axis=0), axis=1))])
    places = begin + 2 * arcs / arcs[-1]
    places.flags.writeable = states.flags.writeable = False
    return places, states


@lru_cache(maxsize=8)
def resting_anti_kink(chain: Chain, near: float) -> tuple[float, Array]:
    """Place of an anti-kink in balance [rotor spacings], near another, and its angles [rad], (N,).

    The place is that of the sum of the field; the ends of the chain are fixed. Of those that
    flippers have on a rotor and between two it is the one that costs less.
    """
    starts = (near,) if chain.motion is Motion.SPINNER else (near, near + 0.5)
    found = [_balanced(chain, continuum_anti_kink(chain, start)) for start in starts]
    angles = min(found, key=lambda each: float(chain.elastic_energy(each)))
    angles.flags.writeable = False
    return (len(angles) - 1 - float(constraint_field(chain, angles)[0].sum())) / 2, angles


def continuum_anti_kink(chain: Chain, place: float) -> Array:
    """An anti-kink as the continuum has it, its ends at rest, shape (N,) [rad]."""
    rotors, rest = np.arange(chain.number_of_rotors), chain.rest_angle
    field = np.tanh((rotors - place) * chain.spacing / chain.wall_width)
    field[0], field[-1] = -1.0, 1.0
    if chain.motion is Motion.SPINNER:
        turning = np.where(rotors % 2, -1.0, 1.0)
        return staggered(rest + turning * np.arccos(field))
    return staggered(np.arcsin(math.sin(rest) * field))


def constraint_field(chain: Chain, angles: Array) -> tuple[Array, Array, Array]:
    """Field F of each rotor [1] and its first and second derivative by its angle, (N,).

    Of flippers it is (3 m - m^3) / 2 with the order field m = u / ub of `tanh_fit.order_field`:
    like that of spinners it does not change at rest, so that what holds its sum does not pull at
    the domains.
    """
    theta, sense = staggered(angles), np.where(np.arange(len(angles)) % 2, -1.0, 1.0)
    if chain.motion is Motion.SPINNER:
        beyond = theta - chain.rest_angle
        return np.cos(beyond), -np.sin(beyond) * sense, -np.cos(beyond)
    scale = 1 / math.sin(chain.rest_angle)
    lean, slope = scale * np.sin(theta), scale * np.cos(theta) * sense
    rise = 1.5 * (1 - lean**2)
    field = 1.5 * lean - 0.5 * lean**3
    return field, rise * slope, -rise * lean - 3 * lean * slope**2


def _balanced(chain: Chain, start: Array) -> Array:
    """State of least energy near another, shape (N,) [rad]; the ends are fixed."""
    scale = chain.stiffness * chain.spacing**2

    def cost(inner: Array) -> tuple[float, Array]:
        whole = np.concatenate([start[:1], inner, start[-1:]])
        torques = chain.spring_torques(whole)[1:-1]
        return float(chain.elastic_energy(whole)) / scale, -torques / scale

    options = {'maxiter': 5000, 'ftol': 1e-15, 'gtol': 1e-10}
    found = minimize(cost, start[1:-1], jac=True, method='L-BFGS-B', options=options)
    return np.concatenate([start[:1], found.x, start[-1:]])


def _least(chain: Chain, angles: Array, pull: float, wanted: float) -> tuple[Array, float]:
    """State of least energy with a sum of the field, and its pull, from one close by."""
    angles = angles.copy()
    for _ in range(_NEWTON_STEPS):
        field, first, second = constraint_field(chain, angles)
        curvature = stiffness_matrix(chain, angles).toarray() - np.diag(pull * second)
        bordered = np.zeros((len(angles) - 1, len(angles) - 1))
        bordered[:-1, :-1] = curvature[1:-1, 1:-1]
        bordered[:-1, -1], bordered[-1, :-1] = -first[1:-1], first[1:-1]
        slope = -chain.spring_torques(angles) - pull * first
        step = np.linalg.solve(bordered, -np.append(slope[1:-1], field.sum() - wanted))
        step *= min(1.0, _LONGEST / float(np.abs(step[:-1]).max()))
        angles[1:-1] += step[:-1]
        pull += float(step[-1])
        if np.abs(step[:-1]).max() < _CONVERGED:
            inner = curvature[1:-1, 1:-1]
            if _holds(inner.diagonal(), inner.diagonal(1), first[1:-1]):
                return angles, pull
            break
    raise ArithmeticError(
        f'an anti-kink in a chain with d = {chain.lean_ratio:.4g} is pinned: it cannot be led '
        'from one site to the next'
    )


def _holds(diagonal: Array, beside: Array, along: Array) -> bool:
    """Whether a tridiagonal curvature H is positive across a direction b.

    The matrix bordered by b then has one negative eigenvalue, of which H has all but that of
    -b . H^-1 b (Haynsworth).
    """
    limit = -_BUCKLING * float(np.abs(diagonal).max())
    falling = eigvalsh_tridiagonal(diagonal, beside, select='v', select_range=(-np.inf, limit))
    if len(falling) != 1:
        return len(falling) == 0
    bands = np.array([np.append(0.0, beside), diagonal, np.append(beside, 0.0)])
    return float(along @ solve_banded((1, 1), bands, along)) < 0
