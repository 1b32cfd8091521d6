# SPDX-License-Identifier: Apache-2.0
"""A chain with standard deviations, from a recording in which a soliton has passed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soliton_linkage.identification.adjustment import Adjustment, adjusted, measurable
from soliton_linkage.identification.lengths import OF_A_ROTOR, Lengths, split
from soliton_linkage.identification.residuals import check_jumps, check_slips, noise_of
from soliton_linkage.identification.screening import check_motion, filled
from soliton_linkage.identification.start import equal_rotors
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.passage import find_obstacles

_OPEN = 0.1
"""Standard deviation of a combination of lengths, by the angles alone, beyond which it is called
open [1]: more than workshops miss."""
_STRAINED = 1.3
"""Noise that the bonds leave over that from frame to frame, beyond which springs give way [1]."""


@dataclass(frozen=True)
class Identification:
    """A chain as the angles of a recording show it."""

    chain: Chain
    """With the mean spacing, mass, stiffness and damping that were given."""
    deviations: dict[str, Array]
    """Standard deviation of each length over that length [1], by the names of `Deviations`."""
    offsets: Array
    """What each encoder reads too much [rad], shape (N,)."""
    offset_deviations: Array
    """Standard deviations of these [rad], shape (N,)."""
    noise: float
    """Standard deviation of a reading [rad], as the bonds leave it open."""
    reading_noise: float
    """The same from frame to frame, which knows of no chain."""
    bond_noise: Array
    """The same as `noise` by each bond alone [rad], shape (N - 1,)."""
    tolerance: float
    """Standard deviation by which lengths of one kind differ from each other [1]."""
    open_combinations: tuple[str, ...]
    """What the angles alone leave open, in words."""
    warnings: tuple[str, ...]
    """What a user must know of it, one line each."""

    @property
    def worst_bonds(self) -> tuple[int, ...]:
        """Numbers of the bonds that leave most open, the worst first."""
        return tuple(np.argsort(-self.bond_noise).tolist())

    @property
    def strained(self) -> bool:
        """Whether springs give way beyond the noise, as rigid bars do not."""
        return self.noise > _STRAINED * self.reading_noise


def identify(
    times: Array,
    readings: Array,
    given: Chain,
    names: Sequence[str] = (),
    tolerance: float | None = None,
) -> Identification:
    """Chain that the readings [rad], NaN where missing, shape (T, N), of times [s], (T,), show.

    The given chain tells what angles do not: the mean spacing, masses, stiffness and damping;
    its number of rotors and other lengths do not count. A tolerance of lengths [1] is learnt
    unless it is given. Raises ValueError, in one line, for a recording that shows no chain.
    """
    names = names or [f'rotor {n}' for n in range(readings.shape[1])]
    whole = filled(times, readings, names)
    check_motion(times, whole, names)
    noise = noise_of(readings)
    check_jumps(times, whole, noise, names)
    seen = np.where(np.isfinite(readings), whole, np.nan)
    found = adjusted(seen, equal_rotors(whole), tolerance)
    check_slips(times, found.left, max(noise, found.noise), names)
    if not found.settled:
        raise ValueError(
            'no lengths close the bonds of this recording; check the order of the joints, their '
            'signs and their zeros, and that no rotor was held'
        )
    return _identified(found, given, noise)


def _identified(found: Adjustment, given: Chain, reading_noise: float) -> Identification:
    rotor, offset, spacing, rest = split(found.deviations)
    chain = found.lengths.scaled(given.spacing).chain(given)
    made = Identification(
        chain,
        {'rotor_length': rotor, 'spacing': spacing, 'rest_length': rest},
        found.lengths.offsets,
        offset,
        found.noise,
        reading_noise,
        found.bond_noise,
        found.tolerances.of_lengths,
        _open_combinations(found),
        tuple(
            f'bond {each.bond} may stop a wall: {each.rest_length:.4g} m {each.reason}'
            for each in find_obstacles(chain)
        ),
    )
    return made


def _open_combinations(found: Adjustment) -> tuple[str, ...]:
    """What the angles alone tell less well than workshops make it."""
    basis = measurable(found.lengths)
    values, vectors = np.linalg.eigh(basis.T @ found.information @ basis)
    loose = [
        (float(value**-0.5), basis @ vector)
        for value, vector in zip(values, vectors.T, strict=True)
        if value < _OPEN**-2
    ]
    return tuple(_in_words(spread, vector) for spread, vector in loose)


def _in_words(spread: float, vector: Array) -> str:
    """Say which rotors and lengths a combination is of, and by how much it is open."""
    rotor, _, spacing, rest = split(vector)
    size = np.abs(vector).max()
    kinds = [
        name
        for name, part in (('rotor_length', rotor), ('spacing', spacing), ('rest_length', rest))
        if np.abs(part).max() > 0.5 * size
    ]
    size = np.abs(vector).max()
    sides = [np.flatnonzero(side > 0.5 * size) // OF_A_ROTOR for side in (vector, -vector)]
    large = min((side for side in sides if len(side)), key=np.ptp)
    what = 'scale' if len(kinds) == 3 else ' and '.join(kinds) or 'offset'
    return f'{what} of rotors {large.min()} to {large.max()} against the others: {spread:.0%}'
