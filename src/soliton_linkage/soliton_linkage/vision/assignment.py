# SPDX-License-Identifier: Apache-2.0
"""Assignment of dots to rotors by maximum likelihood over the whole chain.

The rotors are the steps of a hidden Markov model. The state of a rotor is "hidden" or one of its
candidate dots. The likelihood of a dot depends on its colour, on its distance from the circle
around the pivot, on the predicted angle, and on the distances from the dots of the neighbours.
Viterbi's algorithm finds the most likely sequence of states. A cost is -2 log likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

HIDDEN = -1
"""Dot number of a hidden rotor."""
_CANDIDATES = 6
"""Largest number of dots that are considered for one rotor."""
_HIDDEN_COST = 14.0
"""Cost of the state "hidden" [1], between the costs of errors of 3 and 4 standard deviations."""
_MAX_ANGLE_COST = 30.0
"""Largest cost of a difference from a predicted angle [1]; after kicks, predictions are wrong."""
_MAX_BOND_COST = 12.0
"""Largest cost of a wrong bond length [1]. Without this limit, the next rotor would count as
hidden if one rotor were assigned a wrong dot."""
_PIVOT_COST = 8.0
"""Additional cost of a dot at the position of any pivot [1]. Pivots carry dots too, so that such a
dot is the dot of a mass only with a probability of about p = 1/50: -2 log p = 8."""
_MAX_LENGTH_ERROR = 4.0
"""A dot is a candidate for a rotor only if the error of its distance from the pivot is smaller
than this [standard deviations]."""


@dataclass(frozen=True)
class Prediction:
    """Predicted state of N rotors in a picture, with standard deviations in the same units."""

    pivots: Array
    """Positions of the pivots [m], (N, 2)."""
    lengths: Array
    """Lengths of the rotors [m], (N,)."""
    length_deviations: Array
    angles: Array
    """Angles [rad], (N,)."""
    angle_deviations: Array
    bonds: Array
    """Predicted distances between the masses of neighbouring rotors [m], (N - 1,)."""
    bond_deviations: Array
    colours: NDArray[np.intp]
    """Colour of the dot on each mass, as an index in `COLOURS`, (N,)."""


def assign_dots(
    points: Array, point_deviations: Array, colour_costs: Array, predicted: Prediction
) -> NDArray[np.intp]:
    """Return the number of the dot on the mass of each rotor, or `HIDDEN`, (N,).

    A dot in a picture has a position (x, z) only for a given height above the plane of the frame
    markers (see `MarkerSettings`). Therefore `points`, (2, K, 2), contains two positions of each
    of K dots [m]: the first one for the height of the even rotors, and the second one for the
    height of the odd rotors. `point_deviations`, (K,), are the standard deviations of the
    positions [m]. `colour_costs`, (K, C), are the costs of the C `COLOURS` for each dot [1].
    """
    rotors = len(predicted.pivots)
    if not points.shape[1]:
        return np.full(rotors, HIDDEN, dtype=np.intp)
    own = _own_costs(points, point_deviations, colour_costs, predicted)
    width = min(_CANDIDATES, own.shape[1])
    candidates = np.argpartition(own, width - 1, axis=1)[:, :width]
    costs = np.take_along_axis(own, candidates, axis=1)
    parity = np.arange(rotors) % 2
    places = points[parity[:, None], candidates]
    apart = places[1:, None, :, :] - places[:-1, :, None, :]
    errors = np.hypot(apart[..., 0], apart[..., 1]) - predicted.bonds[:, None, None]
    errors /= predicted.bond_deviations[:, None, None]
    path = _viterbi(costs, np.minimum(errors**2, _MAX_BOND_COST))
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


def _viterbi(costs: Array, bond_costs: Array) -> NDArray[np.intp]:
    """Return which of W candidates is the most likely for each rotor, (N,); W means hidden."""
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
