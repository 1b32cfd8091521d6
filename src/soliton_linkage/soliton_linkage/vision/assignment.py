# SPDX-License-Identifier: Apache-2.0
"""Assignment of dots to rotors: the likeliest one for the whole chain.

The likelihood of a dot for a rotor falls with its distance from the rotor's circle, from the
expected angle and from the rotor's colour, and where a pivot is. That of a pair of dots for
neighbours falls with the deviation of their distance from the length of the bond. Viterbi's
algorithm finds the likeliest sequence of this hidden Markov model, whose states are the candidate
dots and none. Costs are minus twice a log likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

HIDDEN = -1
"""Number of the dot of a hidden rotor."""
_CANDIDATES = 6
"""Candidate dots of a rotor at most [1]."""
_HIDDEN = 14.0
"""Cost of a hidden rotor [1]: that of four standard deviations."""
_MOST_UNEXPECTED = 30.0
"""Largest cost of an unexpected angle [1]: rotors are kicked."""
_MOST_STRETCHED = 12.0
"""Largest cost of the length of a bond [1], less than that of a hidden rotor: with one neighbour
wrong a rotor is still right."""
_PIVOTS = 8.0
"""Cost of a dot at a pivot [1]: one of fifty is that of a mass in front of it."""


@dataclass(frozen=True)
class Prediction:
    """State of the N rotors that is expected in a picture, with standard deviations."""

    pivots: Array
    """Pivots [m], shape (N, 2)."""
    lengths: Array
    """Lengths of the rotors [m], shape (N,)."""
    length_deviations: Array
    angles: Array
    """Angles [rad], shape (N,)."""
    angle_deviations: Array
    bonds: Array
    """Distances of the masses of neighbours [m], shape (N - 1,)."""
    bond_deviations: Array
    colours: NDArray[np.intp]
    """Colours of the rotors' dots, shape (N,)."""


def assign_dots(
    places: Array, place_deviations: Array, colour_costs: Array, expected: Prediction
) -> NDArray[np.intp]:
    """Return the number of each rotor's dot, or `HIDDEN`, shape (N,).

    Dots have places [m] for rotors of either height, (2, K, 2), standard deviations [m], (K,), and
    costs for each colour, (K, C).
    """
    rotors = len(expected.pivots)
    if not places.shape[1]:
        return np.full(rotors, HIDDEN, dtype=np.intp)
    own = _own_costs(places, place_deviations, colour_costs, expected)
    width = min(_CANDIDATES, own.shape[1])
    candidates = np.argpartition(own, width - 1, axis=1)[:, :width]
    costs = np.take_along_axis(own, candidates, axis=1)
    parity = np.arange(rotors) % 2
    path = _viterbi(costs, _bond_costs(places[parity[:, None], candidates], expected))
    at = np.arange(rotors), np.minimum(path, width - 1)
    chosen = np.where(path < width, candidates[at], HIDDEN)
    once, owners = np.full_like(chosen, HIDDEN), set()
    for rotor in np.argsort(costs[at], kind='stable'):
        dot = int(chosen[rotor])
        if dot != HIDDEN and dot not in owners:
            owners.add(dot)
            once[rotor] = dot
    return once


def _own_costs(
    places: Array, place_deviations: Array, colour_costs: Array, expected: Prediction
) -> Array:
    """Return the cost of each dot for each rotor by itself, infinite if it is impossible."""
    arms = places[np.arange(len(expected.pivots)) % 2] - expected.pivots[:, None]
    lengths = np.hypot(arms[..., 0], arms[..., 1])
    angles = np.arctan2(arms[..., 0], arms[..., 1])
    length_deviations = np.hypot(expected.length_deviations[:, None], place_deviations)
    misfit = (lengths - expected.lengths[:, None]) / length_deviations
    away = angles - expected.angles[:, None]
    away -= 2 * np.pi * np.rint(away / (2 * np.pi))
    angle_deviations = np.hypot(
        expected.angle_deviations[:, None], place_deviations / expected.lengths[:, None]
    )
    costs = misfit**2 + np.minimum((away / angle_deviations) ** 2, _MOST_UNEXPECTED)
    costs += colour_costs[:, expected.colours].T
    costs += _PIVOTS * (lengths < place_deviations).any(axis=0)
    return np.asarray(np.where(np.abs(misfit) < 4.0, costs, np.inf))


def _bond_costs(where: Array, expected: Prediction) -> Array:
    """Return the cost of each pair of candidates of neighbours, shape (N - 1, width, width)."""
    apart = where[1:, None, :, :] - where[:-1, :, None, :]
    lengths = np.hypot(apart[..., 0], apart[..., 1])
    misfit = (lengths - expected.bonds[:, None, None]) / expected.bond_deviations[:, None, None]
    return np.asarray(np.minimum(misfit**2, _MOST_STRETCHED))


def _viterbi(costs: Array, joined: Array) -> NDArray[np.intp]:
    """Return the likeliest candidate of each rotor, `width` for none, shape (N,)."""
    rotors, width = costs.shape
    own = np.column_stack([costs, np.full(rotors, _HIDDEN)])
    steps = np.zeros((rotors - 1, width + 1, width + 1))
    steps[:, :width, :width] = joined
    best = own[0]
    came_from = np.zeros((rotors, width + 1), dtype=np.intp)
    for rotor in range(1, rotors):
        total = best[:, None] + steps[rotor - 1]
        came_from[rotor] = np.argmin(total, axis=0)
        best = total[came_from[rotor], np.arange(width + 1)] + own[rotor]
    path = np.empty(rotors, dtype=np.intp)
    path[-1] = int(np.argmin(best))
    for rotor in range(rotors - 1, 0, -1):
        path[rotor - 1] = came_from[rotor, path[rotor]]
    return path
