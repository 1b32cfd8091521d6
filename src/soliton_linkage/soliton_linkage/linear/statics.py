# SPDX-License-Identifier: Apache-2.0
"""Configurations at rest: with every spring relaxed, or with the springs in balance."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from soliton_linkage.linear.rigidity import Edge, rigidity_bands, rigidity_matrix
from soliton_linkage.linkage.chain import Array, Chain

_ITERATIONS = 60
"""Largest number of Newton iterations [1]; a distant start needs many steps."""
_LONGEST_STEP = 0.5
"""Largest change of an angle in one iteration [rad], far below a change of the configuration."""
_ROUNDING = 1e-12
"""Torque that is left in balance over k_e lbar r [1]: the rounding of sums of such terms."""


def length_rounding(chain: Chain) -> float:
    """Error that rounding makes in the extension of a spring [m], with room to spare.

    Extensions are differences of terms as large as (a + 2 r)^2, divided by 2 lbar.
    """
    reach = float(chain.spacings.max() + 2 * chain.rotor_lengths.max())
    return 4 * float(np.finfo(np.float64).eps) * reach**2 / float(chain.rest_lengths.min())


def unstretched(chain: Chain, angles: Array) -> Array:
    """Return the configuration near a given one in which every spring is relaxed, shape (N,).

    Newton's method with the smallest correction that the linearised lengths allow,
    dphi = -R^T (R R^T)^(-1) (l - lbar). Raises ValueError where it finds none.
    """
    state = chain.check_angles(angles).copy()
    enough = length_rounding(chain)
    extensions = chain.spring_extensions(state)
    for _ in range(_ITERATIONS):
        worst = float(np.abs(extensions).max())
        if worst <= enough:
            return state
        step = min_norm_change(chain, state, -extensions)
        state += step * min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-300))
        extensions = chain.spring_extensions(state)
    spring = int(np.argmax(np.abs(extensions)))
    raise ValueError(
        f'spring {spring} stays {extensions[spring]:.3g} m beyond its length at rest of '
        f'{chain.rest_lengths[spring]:.6g} m, between rotors {spring} and '
        f'{(spring + 1) % chain.number_of_rotors}: no configuration near the given angles '
        'relaxes every spring; start nearer to one, or lower the deviations of the chain'
    )


def rest_state(chain: Chain, lean: int) -> Array:
    """Angles near the uniform state of a lean in which every spring is relaxed [rad], (N,).

    Without deviations that is the uniform state itself. Raises ValueError where there is none.
    """
    return unstretched(chain, chain.uniform_state(lean))


def toggled_angle(chain: Chain, angles: Array, edge: Edge) -> float:
    """Angle of the edge rotor that is its reflection at the line to its neighbour's mass [rad].

    phi_t = 2 psi - phi, with psi the direction from the pivot of the edge rotor to the mass of
    its neighbour. The bar between them has the same length, and a wall that is reflected leaves
    the edge rotor there.
    """
    checked = chain.check_angles(angles)
    last = edge.resolved(chain, checked) is Edge.LAST
    rotor, neighbour = (-1, -2) if last else (0, 1)
    offset = float(chain.spacings[rotor]) * (-1 if last else 1)
    horizontal, vertical = chain.positions(checked)
    towards = math.atan2(offset + float(horizontal[neighbour]), float(vertical[neighbour]))
    return 2 * towards - float(checked[rotor])


def min_norm_change(chain: Chain, angles: Array, lengthening: Array) -> Array:
    """Smallest change of the angles that lengthens the springs as given [m], shape (N,) [rad].

    dphi = R^T (R R^T)^(-1) dl, orthogonal to the zero mode. R R^T is tridiagonal and its
    smallest eigenvalue is on the scale of the squared gap. Raises ValueError where the springs
    cannot change so, in a configuration that has a state of self-stress.
    """
    try:
        if chain.periodic:
            matrix = rigidity_matrix(chain, angles)
            return np.asarray(matrix.T @ splu((matrix @ matrix.T).tocsc()).solve(lengthening))
        first, second = rigidity_bands(chain, angles)
        solved = solveh_banded(gram_matrix_bands(first, second), lengthening)
    except (LinAlgError, RuntimeError):
        raise ValueError(
            f'the chain is stuck at {_shown(angles)} rad, where its springs carry a state of '
            'self-stress; move it away from there'
        ) from None
    return chain.gathered(first * solved, second * solved)


def gram_matrix_bands(first: Array, second: Array) -> Array:
    """R R^T of free ends in the upper form of LAPACK, its diagonal last [m^2], (2, springs).

    A single spring has no neighbour: then the shape is (1, 1), without a band for one.
    """
    banded = np.zeros((2, len(first)))
    banded[0, 1:] = second[:-1] * first[1:]
    banded[1] = first**2 + second**2
    return banded[-len(first) :]


def stiffness_matrix(chain: Chain, angles: Array) -> csc_array:
    """Second derivatives of the elastic energy [N m/rad^2], sparse, shape (N, N).

    K = sum_n k_e (grad l grad l^T + (l - lbar) grad grad l) with, from e = l^2 - lbar^2,
    grad grad l = grad grad e / (2 l) - grad l grad l^T / l. Where every spring is relaxed only
    the first term is left, R^T k_e R.
    """
    checked = chain.check_angles(angles)
    extensions, first, second = chain.springs(checked)
    horizontal, vertical = chain.positions(checked)
    left = np.arange(chain.number_of_springs)
    right = (left + 1) % chain.number_of_rotors
    products = horizontal[left] * horizontal[right] + vertical[left] * vertical[right]
    lengths = extensions + chain.rest_lengths
    tension = chain.stiffnesses * extensions / lengths
    stretching = chain.stiffnesses - tension
    on_left = stretching * first**2 + tension * (chain.spacings * horizontal[left] + products)
    on_right = stretching * second**2 + tension * (products - chain.spacings * horizontal[right])
    between = stretching * first * second - tension * products
    rows = np.concatenate([left, right, left, right])
    columns = np.concatenate([left, right, right, left])
    entries = np.concatenate([on_left, on_right, between, between])
    rotors = chain.number_of_rotors
    return csc_array((entries, (rows, columns)), shape=(rotors, rotors))


def equilibrium(chain: Chain, angles: Array) -> Array:
    """Return the configuration near a given one in which the springs are in balance, (N,).

    Newton's method on the torques; the equilibrium need not be stable. Raises ValueError where
    it finds none.
    """
    state = chain.check_angles(angles).copy()
    scale = float((chain.stiffnesses * chain.rest_lengths).max() * chain.rotor_lengths.max())
    for _ in range(_ITERATIONS):
        torques = chain.spring_torques(state)
        if float(np.abs(torques).max()) <= _ROUNDING * scale:
            return state
        step = _yielding(chain, state, torques)
        state += step * min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-300))
    rotor = int(np.argmax(np.abs(torques)))
    raise ValueError(
        f'rotor {rotor} keeps a torque of {torques[rotor]:.3g} N m: the springs have no balance '
        'near the given angles; start nearer to one'
    )


def _yielding(chain: Chain, angles: Array, torques: Array) -> Array:
    """Change of the angles under torques [rad], to first order, shape (N,)."""
    try:
        return np.asarray(splu(stiffness_matrix(chain, angles)).solve(torques))
    except RuntimeError:
        raise ValueError(
            f'the chain yields without end at {_shown(angles)} rad, where its springs resist '
            'some motion not at all; start from other angles'
        ) from None


def _shown(angles: Array) -> str:
    return np.array2string(angles, precision=3, threshold=6)
