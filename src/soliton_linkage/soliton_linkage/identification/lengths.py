# SPDX-License-Identifier: Apache-2.0
"""Lengths of a chain and offsets of its encoders: the unknowns, their prior and first values.

The unknowns stand in the order r_0, o_0, a_0, l_0, r_1, o_1, a_1, l_1, ..., r_{N-1}, o_{N-1}, so
that those of a bond are six in a row: r_n, o_n, a_n, l_n, r_{n+1}, o_{n+1}. Changes of lengths are
those of their logarithms [1], changes of offsets are in [rad].

A priori, logarithms of lengths of one kind are normal about their common mean, and offsets about
0. The standard deviations of these normal distributions, the tolerances, are learnt.
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


_PASSING = 0.2
"""Difference of the sines of neighbours about a wall, over the largest of most bonds [1]."""


def equal_rotors(angles: Array) -> Lengths:
    """Return lengths of equal rotors on pivots a distance of 1 apart, for angles [rad] (T, N).

    The bond of equal rotors closes where

        cos(phi_n - phi_{n+1}) = K_0 + K_1 (sin(phi_{n+1}) - sin(phi_n)),
        K_0 = (a^2 + 2 r^2 - l^2) / (2 r^2),    K_1 = a / r,

    which is linear in K_0 and K_1 (after Freudenstein's equation of four-bar linkages).
    Raises ValueError where no chain has these angles.
    """
    inner = angles[:, 1:-1] if angles.shape[1] > 4 else angles
    apart = np.diff(np.sin(inner), axis=1)
    together = np.cos(np.diff(inner, axis=1))
    constants = np.nanmedian(together, axis=0)
    swing = float(np.median(np.nanmax(np.abs(apart - np.nanmedian(apart, axis=0)), axis=0)))
    across = apart - np.nanmedian(apart, axis=0)
    passing = np.abs(across) > _PASSING * swing
    ratio = float(across[passing] @ (together - constants)[passing])
    ratio /= float(across[passing] @ across[passing])
    constant = float(np.median(constants))
    if ratio < 0:
        raise ValueError(
            'the angles are those of a chain seen from behind: name the joints from the first '
            'rotor to the last, and count angles from upright towards the last'
        )
    squared = ratio**2 + 2 * (1 - constant)
    if not squared > ratio**2 > 0:
        raise ValueError(
            'the angles are those of no chain of rotors on pivots in a row; check that they are '
            'in radians, counted from upright towards the last rotor, in the order of the rotors'
        )
    rotors = angles.shape[1]
    length, rest = 1 / float(ratio), math.sqrt(squared) / float(ratio)
    return Lengths(
        np.full(rotors, length), np.ones(rotors - 1), np.full(rotors - 1, rest), np.zeros(rotors)
    )


_BEGIN = 0.04
"""Tolerances to start from [1], [rad]: wider ones let single lengths run away at first."""
_WIDEST = 0.3
"""The largest [1], [rad]: beyond a third nothing is alike."""
_NARROWEST = 1e-4
"""Smallest tolerance [1], [rad], a tenth of what workshops reach: 0 has no logarithm."""


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of lengths of one kind about their mean, and of offsets."""

    of_lengths: float = _BEGIN
    """Relative [1]."""
    of_offsets: float = _BEGIN
    """[rad]."""

    def information(self, rotors: int) -> Array:
        """Information on the unknowns of a chain of N rotors, shape (P, P)."""
        size = OF_A_ROTOR * rotors - 2
        information = np.zeros((size, size))
        for part in (0, 2, 3):
            places = np.arange(part, size, OF_A_ROTOR)
            alike = np.eye(len(places)) - 1 / len(places)
            information[np.ix_(places, places)] = alike / self.of_lengths**2
        places = np.arange(1, size, OF_A_ROTOR)
        information[places, places] = self.of_offsets**-2
        return information

    def close_to(self, other: Tolerances, share: float) -> bool:
        """Whether they are those of another to a share of it [1]."""
        return (
            abs(self.of_lengths - other.of_lengths) <= share * other.of_lengths
            and abs(self.of_offsets - other.of_offsets) <= share * other.of_offsets
        )

    def relearnt(
        self, lengths: Lengths, covariance: Array, of_lengths: float | None = None
    ) -> Tolerances:
        """Return the tolerances of lengths, of a given covariance (P, P), and offsets.

        A tolerance of lengths [1] is learnt unless it is given.
        """
        rotor, offset, spacing, rest = split(np.diag(covariance))
        squares = [
            _squares(np.log(lengths.rotor_lengths), rotor),
            _squares(np.log(lengths.spacings), spacing),
            _squares(np.log(lengths.rest_lengths), rest),
        ]
        learnt = math.sqrt(sum(squares) / (3 * lengths.rotors - 5))
        of_offsets = math.sqrt(float(np.mean(lengths.offsets**2 + offset)))
        return Tolerances(of_lengths or _within(learnt), _within(of_offsets))


def unknowns_of(lengths: Lengths) -> Array:
    """Logarithms of lengths and offsets in the order of the unknowns, shape (P,)."""
    values = np.empty(OF_A_ROTOR * lengths.rotors - 2)
    rotor, offset, spacing, rest = split(values)
    rotor[:], offset[:] = np.log(lengths.rotor_lengths), lengths.offsets
    spacing[:], rest[:] = np.log(lengths.spacings), np.log(lengths.rest_lengths)
    return values


def _squares(logarithms: Array, variances: Array) -> float:
    return float(np.sum((logarithms - logarithms.mean()) ** 2 + variances))


def _within(tolerance: float) -> float:
    return min(max(tolerance, _NARROWEST), _WIDEST)
