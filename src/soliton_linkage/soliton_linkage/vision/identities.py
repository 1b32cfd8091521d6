# SPDX-License-Identifier: Apache-2.0
"""Which dot is which rotor's: what is likeliest for the whole chain at once.

A dot is rotor n's the likelier, the nearer it is to n's circle, to where n is expected and to n's
colour; and two dots are neighbours' the likelier, the nearer their distance is to the length of
the bond between; where a pivot is, a dot is rather the pivot's. That is a hidden Markov model
along the chain whose states are the dots that come into question, and none; Viterbi's algorithm
finds its likeliest sequence. Costs are minus twice a log likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

NOBODY = -1
"""Instead of the number of a dot, for a rotor that has none."""
_CANDIDATES = 6
"""Dots that come into question for a rotor at most, the likeliest ones."""
_HIDDEN = 14.0
"""Cost of a rotor that has no dot [1]: that of four standard deviations."""
_MOST_UNEXPECTED = 30.0
"""Cost of a dot that is nowhere near where its rotor is expected [1]: rotors are kicked."""
_MOST_STRETCHED = 12.0
"""Cost of a bond of an impossible length [1], less than that of a rotor that is hidden: with one
neighbour wrong a rotor is still right."""

_PIVOTS = 8.0
"""Cost of a dot where a pivot is [1]: of fifty to be seen there, one is of a mass before it."""


@dataclass(frozen=True)
class Expectation:
    """What is known of the N rotors before a picture is looked at."""

    pivots: Array
    """Of the rotors [m], shape (N, 2)."""
    lengths: Array
    """Of the rotors [m], shape (N,)."""
    length_deviations: Array
    """Of these lengths [m], shape (N,)."""
    angles: Array
    """That are expected [rad], shape (N,)."""
    angle_deviations: Array
    """Of these angles [rad], shape (N,)."""
    bonds: Array
    """Distance of the masses of neighbours [m], shape (N - 1,)."""
    bond_deviations: Array
    """Of these distances [m], shape (N - 1,)."""
    colours: NDArray[np.intp]
    """Of the rotors' dots, shape (N,)."""


def identified(
    places: Array, place_deviations: Array, colour_costs: Array, expected: Expectation
) -> NDArray[np.intp]:
    """Number of each rotor's dot, or `NOBODY`, shape (N,).

    Dots are at places [m] for rotors of each of two heights, (2, K, 2), with a standard deviation
    [m], (K,), and have costs for each colour, (K, C).
    """
    rotors = len(expected.pivots)
    if not places.shape[1]:
        return np.full(rotors, NOBODY, dtype=np.intp)
    own = _own_costs(places, place_deviations, colour_costs, expected)
    width = min(_CANDIDATES, own.shape[1])
    candidates = np.argpartition(own, width - 1, axis=1)[:, :width]
    costs = np.take_along_axis(own, candidates, axis=1)
    parity = np.arange(rotors) % 2
    where = places[parity[:, None], candidates]
    joined = _bond_costs(where, expected)
    path = _viterbi(costs, joined)
    at = np.arange(rotors), np.minimum(path, width - 1)
    chosen = np.where(path < width, candidates[at], NOBODY)
    taken = costs[at]
    return _each_once(chosen, taken)


def _own_costs(
    places: Array, place_deviations: Array, colour_costs: Array, expected: Expectation
) -> Array:
    """Cost of each dot for each rotor by itself, infinite where it is out of the question."""
    parity = np.arange(len(expected.pivots)) % 2
    arms = places[parity] - expected.pivots[:, None]
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
    costs += _PIVOTS * _are_at_pivots(places, place_deviations, expected.pivots)
    return np.asarray(np.where(np.abs(misfit) < 4.0, costs, np.inf))


def _are_at_pivots(places: Array, place_deviations: Array, pivots: Array) -> NDArray[np.bool_]:
    """Which dots are where pivots are known to be, shape (K,)."""
    parity = np.arange(len(pivots)) % 2
    apart = np.hypot(*(places[parity] - pivots[:, None]).transpose(2, 0, 1))
    return np.asarray((apart < place_deviations).any(axis=0))


def _bond_costs(where: Array, expected: Expectation) -> Array:
    """Cost of each pair of candidates of neighbours, shape (N - 1, width, width)."""
    apart = where[1:, None, :, :] - where[:-1, :, None, :]
    lengths = np.hypot(apart[..., 0], apart[..., 1])
    misfit = (lengths - expected.bonds[:, None, None]) / expected.bond_deviations[:, None, None]
    return np.asarray(np.minimum(misfit**2, _MOST_STRETCHED))


def _viterbi(costs: Array, joined: Array) -> NDArray[np.intp]:
    """Likeliest candidate of each rotor, `width` for none, shape (N,)."""
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


def _each_once(chosen: NDArray[np.intp], costs: Array) -> NDArray[np.intp]:
    """Leave a dot to the rotor that it fits best."""
    once = np.full_like(chosen, NOBODY)
    owners: set[int] = set()
    for rotor in np.argsort(costs, kind='stable'):
        dot = int(chosen[rotor])
        if dot != NOBODY and dot not in owners:
            owners.add(dot)
            once[rotor] = dot
    return once
