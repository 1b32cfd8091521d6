# SPDX-License-Identifier: Apache-2.0
"""A chain with standard deviations, as a recording shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain


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
    damping_deviation: float
    """Standard deviation of the damping [N m s/rad], NaN where it is not told."""
    friction: float
    """Dry friction of each rotor, beside the damping [N m], NaN where it is not told."""
    friction_deviation: float
    """Standard deviation of it [N m]."""
    spacing_deviation: float
    """The same of the logarithm of the mean spacing [1], NaN where gravity did not tell that."""
    mass_deviation: float
    """The same of the logarithm of the mean mass [1], NaN where no push told that."""
    rigid: bool
    """Whether all bonds close to the noise, as bars do: then no stiffness is found."""
    left_out: int
    """Frames of the longest recordings by which masses, springs and drag were not found [1]."""
    open_combinations: tuple[str, ...]
    """What the angles alone leave open, in words."""
    warnings: tuple[str, ...]
    """What a user must know of it, one line each."""

    @property
    def worst_bonds(self) -> tuple[int, ...]:
        """Numbers of the bonds that leave most open, the worst first."""
        return tuple(np.argsort(-self.bond_noise).tolist())
