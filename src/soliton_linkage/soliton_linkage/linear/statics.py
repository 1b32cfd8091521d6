# SPDX-License-Identifier: Apache-2.0
"""Configurations at rest, in which all springs are relaxed or all spring torques are 0."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from soliton_linkage.linear.rigidity import Edge, rigidity_bands, rigidity_matrix
from soliton_linkage.linkage.chain import Array, Chain

_ITERATIONS = 60
"""Largest number of Newton iterations [1]; a start far from the result needs many."""
_LONGEST_STEP = 0.5
"""Largest change of an angle in a Newton step [rad]; longer steps could end far from the start."""
_ROUNDING = 1e-12
"""Newton's method has converged to an equilibrium when no torque is larger than this fraction of
k_e lbar r [1], because rounding errors have this size."""


def length_rounding(chain: Chain) -> float:
    """Return an upper bound of the rounding error of a spring extension [m]."""
    reach = float(chain.spacings.max() + 2 * chain.rotor_lengths.max())
    return 4 * float(np.finfo(np.float64).eps) * reach**2 / float(chain.rest_lengths.min())


def unstretched(chain: Chain, angles: Array) -> Array:
    """Return a configuration near `angles` in which every spring is relaxed [rad], shape (N,).

    Each Newton step dphi is the smallest change of the angles that relaxes the linearised springs:
    dphi = -R^T (R R^T)^(-1) (l - lbar), with the rigidity matrix R, the spring lengths l and the
    rest lengths lbar. Raises ValueError if the method does not converge.
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
        f'the extension of spring {spring} between rotors {spring} and '
        f'{(spring + 1) % chain.number_of_rotors} stays {extensions[spring]:.3g} m, with a rest '
        f'length of {chain.rest_lengths[spring]:.6g} m: no configuration near the given angles '
        'relaxes every spring; start from other angles, or lower the deviations of the chain'
    )


def rest_state(chain: Chain, lean: int) -> Array:
    """Return the angles [rad] of the relaxed state near the uniform state `lean` (+1 or -1).

    Raises ValueError if there is no such state.
    """
    return unstretched(chain, chain.uniform_state(lean))


def toggled_angle(chain: Chain, angles: Array, edge: Edge) -> float:
    """Return the other angle of an edge rotor at which its spring has the same length [rad].

    If the edge rotor has the angle phi, the other angle is 2 psi - phi, where psi is the direction
    from the pivot of the edge rotor to the mass of its neighbour. A wall that is reflected at this
    edge leaves the edge rotor at the other angle.
    """
    checked = chain.check_angles(angles)
    last = edge.resolved(chain, checked) is Edge.LAST
    rotor, neighbour = (-1, -2) if last else (0, 1)
    offset = float(chain.spacings[rotor]) * (-1 if last else 1)
    horizontal, vertical = chain.positions(checked)
    towards = math.atan2(offset + float(horizontal[neighbour]), float(vertical[neighbour]))
    return 2 * towards - float(checked[rotor])


def min_norm_change(chain: Chain, angles: Array, lengthening: Array) -> Array:
    """Return the smallest change of the angles that causes given extensions [rad], shape (N,).

    The change is R^T (R R^T)^(-1) dl, with the rigidity matrix R. The extensions dl [m] are
    `lengthening`, shape (springs,). Raises ValueError if the configuration has a state of
    self-stress, because R R^T is then singular.
    """
    try:
        if chain.periodic:
            matrix = rigidity_matrix(chain, angles)
            return np.asarray(matrix.T @ splu((matrix @ matrix.T).tocsc()).solve(lengthening))
        first, second = rigidity_bands(chain, angles)
        solved = solveh_banded(gram_matrix_bands(first, second), lengthening)
    except (LinAlgError, RuntimeError):
        raise ValueError(
            f'the chain has a state of self-stress at {_shown(angles)} rad, so that its lengths '
            'are not independent; use other angles'
        ) from None
    return chain.gathered(first * solved, second * solved)


def gram_matrix_bands(first: Array, second: Array) -> Array:
    """Return R R^T of a chain with free ends in LAPACK's upper band form [m^2], (2, springs).

    R is the rigidity matrix, and `first` and `second` are its levers A and B of `rigidity_bands`.
    The last row is the diagonal of R R^T. For a single spring, the shape is (1, 1).
    """
    banded = np.zeros((2, len(first)))
    banded[0, 1:] = second[:-1] * first[1:]
    banded[1] = first**2 + second**2
    return banded[-len(first) :]


def stiffness_matrix(chain: Chain, angles: Array) -> csc_array:
    """Return the second derivatives of the elastic energy [N m/rad^2], sparse, shape (N, N).

    The matrix is the sum of k_e (grad l grad l^T + (l - lbar) grad grad l) over all springs, with
    the length l, rest length lbar and stiffness k_e of each spring. Here grad is the derivative
    with respect to the angles, and grad grad l = grad grad e / (2 l) - grad l grad l^T / l with
    e = l^2 - lbar^2.
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
    """Return a configuration near `angles` in which all spring torques are 0 [rad], shape (N,).

    The equilibrium may be unstable. Raises ValueError if Newton's method does not converge.
    """
    state = chain.check_angles(angles).copy()
    scale = float((chain.stiffnesses * chain.rest_lengths).max() * chain.rotor_lengths.max())
    for _ in range(_ITERATIONS):
        torques = chain.spring_torques(state)
        if float(np.abs(torques).max()) <= _ROUNDING * scale:
            return state
        try:
            step = splu(stiffness_matrix(chain, state)).solve(torques)
        except RuntimeError:
            raise ValueError(
                f'the stiffness matrix is singular at {_shown(state)} rad, because the springs do '
                'not resist every motion; start from other angles'
            ) from None
        state += step * min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-300))
    rotor = int(np.argmax(np.abs(torques)))
    raise ValueError(
        f'the torque on rotor {rotor} stays {torques[rotor]:.3g} N m: there is no equilibrium '
        'near the given angles; start from other angles'
    )


def _shown(angles: Array) -> str:
    return np.array2string(angles, precision=3, threshold=6)
