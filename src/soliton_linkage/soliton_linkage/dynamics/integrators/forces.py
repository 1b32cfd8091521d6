# SPDX-License-Identifier: Apache-2.0
"""What acts on the rotors of a motion, as the compiled loops of `rotor_loops` take it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import NO_DEVIATIONS

Numbers = NDArray[np.int64]

VECTOR = 8
"""Numbers that a processor takes at once, at most; rows of arrays are made of so many."""


PlainForces = tuple[tuple[float, float, float, float, float], Array, Array, bool]
"""The fields of `Forces`; from Python a plain tuple is handed over in a third of the time."""


class Spring(NamedTuple):
    """Coefficients of springs that are all alike; see `rotor_loops.pull_and_cross`."""

    offset: float
    """c / lbar^2 + 1, where c is one of `Chain.offsets`."""
    slope: float
    """2 a r / lbar^2."""
    product: float
    """2 r^2 / lbar^2."""
    lever: float
    """k a r / I."""
    cross: float
    """k r^2 / I."""


class Forces(NamedTuple):
    """Accelerations by springs, by torques and by gravity."""

    spring: Spring
    springs: Array
    """Rows of `rotor_loops.pull`, shape (8, P); (8, 0) where `spring` is all that acts."""
    field: Array
    """Rows of `rotor_loops.add_field`, shape (3, P), or (3, 0) where there is none."""
    periodic: bool


def places_of(motion: EquationOfMotion) -> int:
    """Places for the rotors of a motion, in whole vectors."""
    return -(-motion.rotors // VECTOR) * VECTOR


def forces_of(motion: EquationOfMotion) -> PlainForces:
    """All that acts on the rotors but damping, the fields of `Forces`."""
    rows = _springs(motion)
    offset, _, slope, product, lever, cross, *_ = (float(row[0]) for row in rows)
    springs = padded(rows, places_of(motion))
    springs[0, rows.shape[1] :] = 1.0  # where there is no spring, none has length 0 either
    return (
        (offset, slope, product, lever, cross),
        np.empty((8, 0)) if _plain(motion) else springs,
        _field(motion),
        motion.chain.periodic,
    )


def padded(values: Array, places: int) -> Array:
    """Values of the rotors with zeros behind them, shape (..., places)."""
    longer = np.zeros((*values.shape[:-1], places))
    longer[..., : values.shape[-1]] = values
    return longer


def _springs(motion: EquationOfMotion) -> Array:
    chain, inverse = motion.chain, motion.inverse_inertias
    left = np.arange(chain.number_of_springs)
    right = (left + 1) % chain.number_of_rotors
    squares, lengths = chain.rest_lengths**2, chain.rotor_lengths
    lever_left = chain.stiffnesses * chain.spacings * lengths[left] * inverse[left]
    lever_right = chain.stiffnesses * chain.spacings * lengths[right] * inverse[right]
    crosses = chain.stiffnesses * lengths[left] * lengths[right]
    return np.array(
        [
            1 + chain.offsets / squares,
            2 * chain.spacings * lengths[right] / squares,
            2 * chain.spacings * lengths[left] / squares,
            2 * lengths[left] * lengths[right] / squares,
            lever_left,
            crosses * inverse[left],
            crosses * inverse[right],
            lever_right,
        ]
    )


def _plain(motion: EquationOfMotion) -> bool:
    """Whether springs that are all alike are all that acts."""
    even = motion.chain.deviations == NO_DEVIATIONS and not motion.fixed
    return even and not (motion.chain.periodic or motion.damped or motion.in_field)


def _field(motion: EquationOfMotion) -> Array:
    gravity = motion.gravity
    if not motion.in_field:
        return np.empty((3, 0))
    weights = gravity.acceleration * motion.chain.masses * motion.chain.rotor_lengths
    tilted = [weights * np.cos(gravity.tilt), weights * np.sin(gravity.tilt)]
    return padded(
        np.array([motion.held_torques, *tilted]) * motion.inverse_inertias, places_of(motion)
    )
