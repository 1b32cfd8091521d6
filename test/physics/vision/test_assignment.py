# SPDX-License-Identifier: Apache-2.0
"""Dots are assigned to their rotors."""

import itertools
from dataclasses import replace

import numpy as np

from soliton_linkage.vision.assignment import HIDDEN, Prediction, assign_dots

ANGLES = np.array([0.9, 2.2, 1.0, 2.1, 0.95])
ROTORS = len(ANGLES)


def scene() -> tuple[np.ndarray, np.ndarray, Prediction]:
    """Return the masses of five rotors [m], the costs of their colours, and the prediction."""
    pivots = np.column_stack([0.1 * np.arange(ROTORS), np.zeros(ROTORS)])
    masses = pivots + 0.2 * np.column_stack([np.sin(ANGLES), np.cos(ANGLES)])
    lengths = np.full(ROTORS, 0.2)
    bonds = np.hypot(*np.diff(masses, axis=0).T)
    colours = 1 + np.arange(ROTORS) % 3
    costs = np.where(colours[:, None] == np.arange(4), 0.0, 20.0)
    expected = Prediction(
        pivots,
        lengths,
        0.02 * lengths,
        ANGLES + 0.05,
        np.full(ROTORS, 0.1),
        bonds,
        0.03 * bonds,
        colours,
    )
    return masses, costs, expected


def test_dots_in_any_order_are_assigned_to_their_rotors():
    masses, costs, expected = scene()
    for order in itertools.islice(itertools.permutations(range(ROTORS)), 0, 120, 7):
        places = masses[list(order)]
        chosen = assign_dots(
            np.stack([places] * 2), np.full(ROTORS, 1e-3), costs[list(order)], expected
        )
        assert [order[dot] for dot in chosen] == list(range(ROTORS))


def test_a_rotor_without_a_dot_is_hidden():
    masses, costs, expected = scene()
    kept = [0, 1, 3, 4]
    chosen = assign_dots(np.stack([masses[kept]] * 2), np.full(4, 1e-3), costs[kept], expected)
    assert list(chosen) == [0, 1, HIDDEN, 2, 3]


def test_a_dot_at_a_pivot_is_a_mass_only_if_its_colour_fits():
    masses, costs, expected = scene()
    angles = expected.angles.copy()
    angles[2] = np.pi / 2 - 0.05
    before = replace(
        expected,
        angles=angles,
        bonds=0 * expected.bonds + 0.2,
        bond_deviations=0.1 + 0 * expected.bonds,
    )
    masses[2] = before.pivots[4]
    passing = assign_dots(np.stack([masses] * 2), np.full(ROTORS, 1e-3), costs, before)
    assert list(passing) == list(range(ROTORS))
    costs[2] = 9.7
    hidden = assign_dots(np.stack([masses] * 2), np.full(ROTORS, 1e-3), costs, before)
    assert list(hidden) == [0, 1, HIDDEN, 3, 4]
