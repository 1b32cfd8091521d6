# SPDX-License-Identifier: Apache-2.0
"""Whether a wall passes through a chain whose rotors and springs deviate.

Two neighbouring rotors, the line between their pivots and their spring make a four-bar linkage.
While every bond is one of the same class the wall passes whatever the deviations; where a bond
is of another class the rotors meet an end of their travel before the wall is through.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Chain, Motion


@dataclass(frozen=True)
class Obstacle:
    """A bond that may stop a wall, with its lengths [m].

    bond: number of the spring, which joins the rotors bond and bond + 1.
    reason: what is broken, with the values and their limit.
    """

    bond: int
    spacing: float
    rotor_lengths: tuple[float, float]
    rest_length: float
    reason: str


def reaches(chain: Chain) -> Array:
    """By how much the two rotors of each bond are longer than its spring [m], shape (springs,).

    r_n + r_{n+1} - lbar_n. Without deviations it is below 0 for d < 1, where flippers do not
    wobble, and above a for d > d_c, where the rotors spin: 4 r^2 - lbar^2 = a^2 (d^2 - 1).
    """
    lengths = chain.rotor_lengths
    left, right = _joined(chain)
    return np.asarray(lengths[left] + lengths[right] - chain.rest_lengths)


def blocked_bonds(chain: Chain) -> NDArray[np.bool_]:
    """Bonds that may stop a wall, shape (springs,); a wall surely passes where there is none.

    A wall passes, and returns, if on every bond lbar_n > a_n + |r_n - r_{n+1}| and if
    r_n + r_{n+1} - a_n - lbar_n has the same sign on all of them: below 0 each is a triple
    rocker, as in flippers, and above 0 a double crank, as in spinners (Grashof). The sign wanted
    is that of most bonds. This is sufficient: a wall may pass all the same.
    """
    excess = reaches(chain) - chain.spacings
    odd = ~(excess > 0) if _spinning(chain) else ~(excess < 0)
    return np.asarray(odd | ~(chain.rest_lengths > _shortest(chain)))


def find_obstacles(chain: Chain) -> tuple[Obstacle, ...]:
    """Return the blocked bonds with their lengths and the reason, in their order.

    >>> import soliton_linkage as sl
    >>> shorter = sl.Deviations(rotor_length=(0.0, 0.0, -0.9, 0.0, 0.0))
    >>> [obstacle.bond for obstacle in sl.find_obstacles(sl.Chain(5, deviations=shorter))]
    [1, 2]
    """
    lengths, shortest = chain.rotor_lengths, _shortest(chain)
    relation = 'shorter' if _spinning(chain) else 'longer'
    left, right = _joined(chain)
    obstacles = []
    for bond in np.flatnonzero(blocked_bonds(chain)).tolist():
        first, second = float(lengths[left[bond]]), float(lengths[right[bond]])
        spacing, rest = float(chain.spacings[bond]), float(chain.rest_lengths[bond])
        if rest <= shortest[bond]:
            limit = shortest[bond]
            reason = f'must be longer than {limit:.6g} m, a + |r_n - r_(n+1)|'
        else:
            limit = first + second - spacing
            reason = f'must be {relation} than {limit:.6g} m, r_n + r_(n+1) - a, as on most bonds'
        obstacles.append(Obstacle(bond, spacing, (first, second), rest, reason))
    return tuple(obstacles)


def motion_of_bonds(chain: Chain) -> Motion | None:
    """How a wall moves along a chain with its deviations, or None where a bond may stop it.

    Where none may, it is a spinner if r_n + r_{n+1} - lbar_n is above a_n on every bond, a
    flipper if it is below 0 on every bond, and wobbles if it is not.
    """
    if blocked_bonds(chain).any():
        return None
    if _spinning(chain):
        return Motion.SPINNER
    return Motion.WOBBLING_FLIPPER if (reaches(chain) > 0).any() else Motion.FLIPPER


def _joined(chain: Chain) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the left and the right rotor of each spring."""
    left = np.arange(chain.number_of_springs)
    return left, (left + 1) % chain.number_of_rotors


def _shortest(chain: Chain) -> Array:
    """Limit above which a spring reaches round both rotors [m], a_n + |r_n - r_{n+1}|."""
    left, right = _joined(chain)
    return np.asarray(
        chain.spacings + np.abs(chain.rotor_lengths[left] - chain.rotor_lengths[right])
    )


def _spinning(chain: Chain) -> bool:
    """Whether most bonds are double cranks."""
    excess = reaches(chain) - chain.spacings
    return 2 * int(np.count_nonzero(excess > 0)) > len(excess)
