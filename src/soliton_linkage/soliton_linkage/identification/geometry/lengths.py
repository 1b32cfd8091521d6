# SPDX-License-Identifier: Apache-2.0
"""The lengths of a chain and the offsets of its encoders, as the unknowns of an adjustment.

They stand in the order r_0, o_0, a_0, l_0, r_1, o_1, a_1, l_1, ..., r_{N-1}, o_{N-1}, so that
those of a bond are six in a row: r_n, o_n, a_n, l_n, r_{n+1}, o_{n+1}. Changes of lengths are
those of their logarithms [1], changes of offsets are in [rad].
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations

OF_A_ROTOR = 4
"""Unknowns from one rotor to the next: r, o, a and l."""
OF_A_BOND = 6
"""Unknowns that the length of a bond depends on."""
_LONGEST_STEP = 0.2
"""Largest change of a logarithm or offset in one step: a fifth, far beyond what chains deviate."""


@dataclass(frozen=True)
class Lengths:
    """Lengths of a chain of N rotors with free ends, and offsets of its encoders."""

    rotor_lengths: Array
    """r, from pivot to mass [m], shape (N,)."""
    spacings: Array
    """a, from each pivot to the next [m], shape (N - 1,)."""
    rest_lengths: Array
    """l, of the springs at rest or of the bars [m], shape (N - 1,)."""
    offsets: Array
    """o, what readings are too large by [rad], shape (N,)."""

    @property
    def rotors(self) -> int:
        """Number of rotors."""
        return len(self.rotor_lengths)

    def changed(self, change: Array) -> Lengths:
        """These with a change of the unknowns, which is shortened where it is too large."""
        largest = float(np.abs(change).max(initial=0.0))
        rotor, offset, spacing, rest = split(change * min(1.0, _LONGEST_STEP / max(largest, 1e-9)))
        return Lengths(
            self.rotor_lengths * np.exp(rotor),
            self.spacings * np.exp(spacing),
            self.rest_lengths * np.exp(rest),
            self.offsets + offset,
        )

    def scaled(self, spacing: float) -> Lengths:
        """These with a mean spacing [m]."""
        scale = spacing / float(self.spacings.mean())
        return Lengths(
            scale * self.rotor_lengths,
            scale * self.spacings,
            scale * self.rest_lengths,
            self.offsets,
        )

    def chain(self, alike: Chain) -> Chain:
        """A chain with these lengths, in all else as a given one.

        Its parameters are the means of the lengths, and their deviations fractions of these.
        """
        spacing, length = float(self.spacings.mean()), float(self.rotor_lengths.mean())
        rest = float(self.rest_lengths.mean())
        cosine = math.sqrt(max(rest**2 - spacing**2, 0.0)) / (2 * length)
        deviations = Deviations(
            spacing=_fractions(self.spacings, spacing),
            rotor_length=_fractions(self.rotor_lengths, length),
            rest_length=_fractions(self.rest_lengths, rest),
            mass=alike.deviations.mass,
            stiffness=alike.deviations.stiffness,
            damping=alike.deviations.damping,
        )
        return replace(
            alike,
            number_of_rotors=self.rotors,
            spacing=spacing,
            rotor_length=length,
            rest_angle=math.acos(min(cosine, 1.0)),
            deviations=deviations,
        )


def lengths_of(chain: Chain) -> Lengths:
    """Lengths of a chain whose encoders have no offsets."""
    none = np.zeros(chain.number_of_rotors)
    return Lengths(chain.rotor_lengths, chain.spacings, chain.rest_lengths, none)


def split(unknowns: Array) -> tuple[Array, Array, Array, Array]:
    """Parts of the unknowns on the last axis: of r, o, a and l."""
    r, o, a, length = (unknowns[..., part::OF_A_ROTOR] for part in range(OF_A_ROTOR))
    return r, o, a, length


def split_lengths(unknowns: Array) -> dict[str, Array]:
    """The same by the names of `Deviations`, and offset."""
    return dict(
        zip(('rotor_length', 'offset', 'spacing', 'rest_length'), split(unknowns), strict=True)
    )


def _fractions(lengths: Array, mean: float) -> tuple[float, ...]:
    return tuple((lengths / mean - 1).tolist())
