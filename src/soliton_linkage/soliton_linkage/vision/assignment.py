# SPDX-License-Identifier: Apache-2.0
"""Assignment of dots to rotors by maximum likelihood over the whole chain.

The mass of a rotor moves on a circle around its pivot. The likelihood that a dot marks this mass
depends on four properties of the dot: its distance from the circle, the difference between its
direction and the predicted angle, its colour, and whether it lies on a pivot. The likelihood of
two dots for neighbouring rotors depends on the distance between the dots, compared with the length
of the bond. This is a hidden Markov model. The states of each rotor are its candidate dots and
"hidden". Viterbi's algorithm finds the most likely sequence of states. A cost is minus twice the
logarithm of a likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

HIDDEN = -1
"""Number that replaces the dot number of a hidden rotor."""
_CANDIDATES = 6
"""Largest number of candidate dots of a rotor [1]."""
_HIDDEN_COST = 14.0
"""Cost of the state "hidden" [1]. It lies between the costs of errors of 3 and 4 standard
deviations."""
_MAX_ANGLE_COST = 30.0
"""Limit of the cost of an unexpected angle [1]. The cost is limited because kicks are not
predicted."""
_MAX_BOND_COST = 12.0
"""Limit of the cost of an unexpected bond length [1]. It is smaller than `_HIDDEN_COST`, so that a
wrong dot of a neighbour does not hide a rotor."""
_PIVOT_COST = 8.0
"""Additional cost of a dot at a pivot [1]. It assumes that one such dot in fifty is a mass in
front of the pivot."""
_MAX_LENGTH_ERROR = 4.0
"""Threshold of the error of the rotor length, in standard deviations [1]: a dot is no candidate if
the error is larger."""


@dataclass(frozen=True)
class Prediction:
    """Predicted state of N rotors in a picture, with standard deviations."""

    pivots: Array
    """Positions of the pivots [m], shape (N, 2)."""
    lengths: Array
    """Lengths of the rotors [m], shape (N,)."""
    length_deviations: Array
    """Standard deviations of the lengths [m], shape (N,)."""
    angles: Array
    """Angles [rad], shape (N,)."""
    angle_deviations: Array
    """Standard deviations of the angles [rad], shape (N,)."""
    bonds: Array
    """Distances between the masses of neighbouring rotors [m], shape (N - 1,)."""
    bond_deviations: Array
    """Standard deviations of these distances [m], shape (N - 1,)."""
    colours: NDArray[np.intp]
    """Index in `COLOURS` of the dot of each mass, shape (N,)."""


def assign_dots(
    points: Array, point_deviations: Array, colour_costs: Array, predicted: Prediction
) -> NDArray[np.intp]:
    """Return the dot number of each rotor, or `HIDDEN`, shape (N,).

    `points` are the positions of K dots [m], computed for the heights of even rotors and of odd
    rotors, shape (2, K, 2). `point_deviations` are their standard deviations [m], (K,).
    `colour_costs` is the cost of each of C colours for each dot, (K, C).
    """
    rotors = len(predicted.pivots)
    if not points.shape[1]:
        return np.full(rotors, HIDDEN, dtype=np.intp)
    own = _own_costs(points, point_deviations, colour_costs, predicted)
    width = min(_CANDIDATES, own.shape[1])
    candidates = np.argpartition(own, width - 1, axis=1)[:, :width]
    costs = np.take_along_axis(own, candidates, axis=1)
    parity = np.arange(rotors) % 2
    path = _viterbi(costs, _bond_costs(points[parity[:, None], candidates], predicted))
    at = np.arange(rotors), np.minimum(path, width - 1)
    chosen = np.where(path < width, candidates[at], HIDDEN)
    # If two rotors share a dot, the one with the lower cost keeps it.
    unique, used = np.full_like(chosen, HIDDEN), set()
    for rotor in np.argsort(costs[at], kind='stable'):
        dot = int(chosen[rotor])
        if dot != HIDDEN and dot not in used:
            used.add(dot)
            unique[rotor] = dot
    return unique


def _own_costs(
    points: Array, point_deviations: Array, colour_costs: Array, predicted: Prediction
) -> Array:
    """Return the cost of each dot for each rotor, shape (N, K). Costs of bonds are excluded."""
    arms = points[np.arange(len(predicted.pivots)) % 2] - predicted.pivots[:, None]
    lengths = np.hypot(arms[..., 0], arms[..., 1])
    angles = np.arctan2(arms[..., 0], arms[..., 1])
    length_deviations = np.hypot(predicted.length_deviations[:, None], point_deviations)
    length_errors = (lengths - predicted.lengths[:, None]) / length_deviations
    turns = angles - predicted.angles[:, None]
    turns -= 2 * np.pi * np.rint(turns / (2 * np.pi))
    angle_deviations = np.hypot(
        predicted.angle_deviations[:, None], point_deviations / predicted.lengths[:, None]
    )
    costs = length_errors**2 + np.minimum((turns / angle_deviations) ** 2, _MAX_ANGLE_COST)
    costs += colour_costs[:, predicted.colours].T
    costs += _PIVOT_COST * (lengths < point_deviations).any(axis=0)
    return np.asarray(np.where(np.abs(length_errors) < _MAX_LENGTH_ERROR, costs, np.inf))


def _bond_costs(points: Array, predicted: Prediction) -> Array:
    """Return the bond costs of neighbouring rotors for each pair of their candidate dots.

    The shape is (N - 1, width, width).
    """
    apart = points[1:, None, :, :] - points[:-1, :, None, :]
    lengths = np.hypot(apart[..., 0], apart[..., 1])
    errors = (lengths - predicted.bonds[:, None, None]) / predicted.bond_deviations[:, None, None]
    return np.asarray(np.minimum(errors**2, _MAX_BOND_COST))


def _viterbi(costs: Array, bond_costs: Array) -> NDArray[np.intp]:
    """Return the most likely candidate number of each rotor, shape (N,); `width` means hidden."""
    rotors, width = costs.shape
    own = np.column_stack([costs, np.full(rotors, _HIDDEN_COST)])
    steps = np.zeros((rotors - 1, width + 1, width + 1))
    steps[:, :width, :width] = bond_costs
    best = own[0]
    previous = np.zeros((rotors, width + 1), dtype=np.intp)
    for rotor in range(1, rotors):
        total = best[:, None] + steps[rotor - 1]
        previous[rotor] = np.argmin(total, axis=0)
        best = total[previous[rotor], np.arange(width + 1)] + own[rotor]
    path = np.empty(rotors, dtype=np.intp)
    path[-1] = int(np.argmin(best))
    for rotor in range(rotors - 1, 0, -1):
        path[rotor - 1] = previous[rotor, path[rotor]]
    return path
