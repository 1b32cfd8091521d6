# SPDX-License-Identifier: Apache-2.0
"""Bonds that stop a wall in a chain with deviations of rotors and springs.

Each bond is a four-bar linkage; its four links are two rotors, the line between their pivots, and
their spring. The Grashof class of a linkage determines which rotors can turn fully. If the class
of one bond differs from the class of the other bonds, the rotors of this bond reach a limit of
their motion before the wall has passed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Chain, Motion


class Obstacle(NamedTuple):
    """Bond that may stop a wall, with the lengths of its four links [m]."""

    bond: int
    """Index of the spring between the rotors `bond` and `bond` + 1."""
    spacing: float
    rotor_lengths: tuple[float, float]
    rest_length: float
    reason: str
    """Condition that the rest length violates, with the limiting length [m]."""


def length_excesses(chain: Chain) -> Array:
    """Return r_n + r_{n+1} - lbar_n of each bond [m], shape (springs,).

    r_n is the length of rotor n and lbar_n the rest length of spring n. The values are below 0 in
    flippers with a lean ratio d < 1, and above the spacing a in spinners.
    """
    first, second = _rotor_lengths(chain)
    return np.asarray(first + second - chain.rest_lengths)


def blocked_bonds(chain: Chain) -> NDArray[np.bool_]:
    """Return for each bond whether it may stop a wall, shape (springs,).

    Let r be the rotor lengths, a the spacings and lbar the rest lengths. A wall passes if two
    conditions hold: lbar_n > a_n + |r_n - r_{n+1}| on all bonds, and r_n + r_{n+1} - a_n - lbar_n
    has the same sign on all bonds. A bond that violates the first condition, or that has the rarer
    sign, may stop the wall. By Grashof's criterion, a bond is a triple rocker if the sign is
    negative, as in flippers, and a double crank if it is positive, as in spinners. The two
    conditions are sufficient for a passage, but not necessary.
    """
    excess = length_excesses(chain) - chain.spacings
    other_class = ~(excess > 0) if _spinning(chain) else ~(excess < 0)
    return np.asarray(other_class | ~(chain.rest_lengths > _shortest(chain)))


def find_obstacles(chain: Chain) -> tuple[Obstacle, ...]:
    """Return the bonds that may stop a wall, with the lengths of their links and the reason.

    >>> import soliton_linkage as sl
    >>> shorter = sl.Deviations(rotor_length=(0.0, 0.0, -0.9, 0.0, 0.0))
    >>> [obstacle.bond for obstacle in sl.find_obstacles(sl.Chain(5, deviations=shorter))]
    [1, 2]
    """
    lengths, shortest = _rotor_lengths(chain), _shortest(chain)
    relation = 'shorter' if _spinning(chain) else 'longer'
    obstacles = []
    for bond in np.flatnonzero(blocked_bonds(chain)).tolist():
        first, second = float(lengths[0][bond]), float(lengths[1][bond])
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
    """Return the class of motion of a chain with deviations, or None if a bond may stop a wall.

    The chain is a spinner if the `length_excesses` of all bonds exceed the spacings, a flipper if
    no length excess is above 0, and otherwise a wobbling flipper.
    """
    if blocked_bonds(chain).any():
        return None
    if _spinning(chain):
        return Motion.SPINNER
    return Motion.WOBBLING_FLIPPER if (length_excesses(chain) > 0).any() else Motion.FLIPPER


def _rotor_lengths(chain: Chain) -> tuple[Array, Array]:
    lengths, left = chain.rotor_lengths, np.arange(chain.number_of_springs)
    return lengths[left], lengths[(left + 1) % chain.number_of_rotors]


def _shortest(chain: Chain) -> Array:
    first, second = _rotor_lengths(chain)
    return np.asarray(chain.spacings + np.abs(first - second))


def _spinning(chain: Chain) -> bool:
    excess = length_excesses(chain) - chain.spacings
    return 2 * int(np.count_nonzero(excess > 0)) > len(excess)
