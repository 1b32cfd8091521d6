# SPDX-License-Identifier: Apache-2.0
"""Anti-kinks at rest: the states with the least elastic energy V at each site coordinate x.

Because the energy depends on the site, a constraint must hold the anti-kink at its site. With the
Lagrange multiplier p of this constraint, stationary states satisfy

    grad V(phi) = p grad sum_n F_n(phi),    sum_n F_n(phi) = N - 1 - 2 x,

where `constraint_field` defines the field F_n. If one of these stationary states is not a minimum
of V under the constraint, the anti-kink is pinned: it cannot move continuously from site to site.
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
"""Number of samples of the angles over two rotor spacings [1]. Splines of the angles through these
samples have errors of 1e-6 rad."""
_NEWTON_STEPS = 30
"""Largest number of Newton steps [1]; about five are needed."""
_CONVERGED = 1e-7
"""Newton's method has converged when no angle changes by more than this in a step [rad]."""
_LONGEST = 0.3
"""A Newton step is scaled down so that no angle changes by more than this [rad]."""
_BUCKLING = 1e-6
"""Threshold in `_is_stable`: an eigenvalue of H counts as negative if it is below 0 by more than
this fraction of the largest diagonal element of H [1]. Rounding errors are smaller."""


@lru_cache(maxsize=8)
def anti_kink_path(chain: Chain, begin: float) -> tuple[Array, Array]:
    """Return K sites of an anti-kink [rotor spacings] and the angles at each site [rad], (K, N).

    The sites increase from `begin` to `begin` + 2 in proportion to the arc length of the path.
    Beyond these sites, the path repeats, shifted by two rotors. All sites must be far from the
    edges. Raises ArithmeticError if the anti-kink is pinned.
    """
    angles, multiplier = continuum_anti_kink(chain, begin), 0.0
    found = []
    for site in np.linspace(begin, begin + 2, _SAMPLES):
        field_sum = chain.number_of_rotors - 1 - 2 * float(site)
        angles, multiplier = _constrained_minimum(chain, angles, multiplier, field_sum)
        found.append(angles)
    states = np.array(found)
    arcs = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(states, axis=0), axis=1))])
    sites = begin + 2 * arcs / arcs[-1]
    sites.flags.writeable = states.flags.writeable = False
    return sites, states


def barrier_speed(chain: Chain, sites: Array, states: Array) -> float:
    """Return the smallest speed with which an anti-kink moves from site to site [spacings/s].

    This is the speed at a minimum of the elastic energy. A slower anti-kink does not cross the
    next maximum. `sites` and `states` are the result of `anti_kink_path`.
    """
    barrier = float(np.ptp([chain.elastic_energy(each) for each in states]))
    steps = np.diff(states, axis=0) / np.diff(sites)[:, None]
    mass = chain.moment_of_inertia * float((steps**2).sum(axis=1).mean())
    return math.sqrt(2 * barrier / mass)


@lru_cache(maxsize=8)
def resting_anti_kink(chain: Chain, near: float) -> tuple[float, Array]:
    """Return the site [rotor spacings] and angles [rad], (N,), of an anti-kink in equilibrium.

    The edge rotors are fixed at their angles in the uniform states. In a spinner, the energy is
    minimised from an anti-kink at the site `near`. In a flipper, the anti-kink has two equilibria
    within each rotor spacing. Therefore, the energy is minimised from the sites `near` and `near`
    + 1/2, and the result is the state with the smaller energy.
    """
    starts = (near,) if chain.motion is Motion.SPINNER else (near, near + 0.5)
    found = [_minimum(chain, continuum_anti_kink(chain, start)) for start in starts]
    angles = min(found, key=lambda each: float(chain.elastic_energy(each)))
    angles.flags.writeable = False
    return (len(angles) - 1 - float(constraint_field(chain, angles)[0].sum())) / 2, angles


def continuum_anti_kink(chain: Chain, site: float) -> Array:
    """Return the angles of an anti-kink of the continuum theory [rad], shape (N,).

    The edge rotors have their angles in the uniform states.
    """
    rotors, rest = np.arange(chain.number_of_rotors), chain.rest_angle
    field = np.tanh((rotors - site) * chain.spacing / chain.wall_width)
    field[0], field[-1] = -1.0, 1.0
    if chain.motion is Motion.SPINNER:
        turning = np.where(rotors % 2, -1.0, 1.0)
        return staggered(rest + turning * np.arccos(field))
    return staggered(np.arcsin(math.sin(rest) * field))


def constraint_field(chain: Chain, angles: Array) -> tuple[Array, Array, Array]:
    """Return the field F_n and its first and second derivative with respect to phi_n, (N,) each.

    For flippers F_n is (3 m - m^3) / 2 with the `order_field` m, and for spinners F_n is
    cos(theta - theta_bar). Far from the anti-kink, dF_n/dphi_n is 0 in both cases.
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


def _minimum(chain: Chain, start: Array) -> Array:
    scale = chain.stiffness * chain.spacing**2

    def cost(inner: Array) -> tuple[float, Array]:
        whole = np.concatenate([start[:1], inner, start[-1:]])
        torques = chain.spring_torques(whole)[1:-1]
        return float(chain.elastic_energy(whole)) / scale, -torques / scale

    options = {'maxiter': 5000, 'ftol': 1e-15, 'gtol': 1e-10}
    found = minimize(cost, start[1:-1], jac=True, method='L-BFGS-B', options=options)
    return np.concatenate([start[:1], found.x, start[-1:]])


def _constrained_minimum(
    chain: Chain, angles: Array, multiplier: float, field_sum: float
) -> tuple[Array, float]:
    angles = angles.copy()
    for _ in range(_NEWTON_STEPS):
        field, first, second = constraint_field(chain, angles)
        curvature = stiffness_matrix(chain, angles).toarray() - np.diag(multiplier * second)
        bordered = np.zeros((len(angles) - 1, len(angles) - 1))
        bordered[:-1, :-1] = curvature[1:-1, 1:-1]
        bordered[:-1, -1], bordered[-1, :-1] = -first[1:-1], first[1:-1]
        slope = -chain.spring_torques(angles) - multiplier * first
        step = np.linalg.solve(bordered, -np.append(slope[1:-1], field.sum() - field_sum))
        step *= min(1.0, _LONGEST / float(np.abs(step[:-1]).max()))
        angles[1:-1] += step[:-1]
        multiplier += float(step[-1])
        if np.abs(step[:-1]).max() < _CONVERGED:
            inner = curvature[1:-1, 1:-1]
            if _is_stable(inner.diagonal(), inner.diagonal(1), first[1:-1]):
                return angles, multiplier
            break
    raise ArithmeticError(
        f'an anti-kink in a chain with d = {chain.lean_ratio:.4g} is pinned: it has no stable '
        'states between one site and the next'
    )


def _is_stable(diagonal: Array, beside: Array, along: Array) -> bool:
    """Return whether x^T H x > 0 for all x orthogonal to the vector b = `along`.

    H is a tridiagonal matrix with the elements `diagonal` and, next to the diagonal, `beside`. By
    Haynsworth's theorem, H bordered by b has as many negative eigenvalues as H, plus one if
    b^T H^-1 b > 0. The result is true if the bordered matrix has exactly one negative eigenvalue.
    """
    limit = -_BUCKLING * float(np.abs(diagonal).max())
    negative = eigvalsh_tridiagonal(diagonal, beside, select='v', select_range=(-np.inf, limit))
    if len(negative) != 1:
        return len(negative) == 0
    bands = np.array([np.append(0.0, beside), diagonal, np.append(beside, 0.0)])
    return float(along @ solve_banded((1, 1), bands, along)) < 0
