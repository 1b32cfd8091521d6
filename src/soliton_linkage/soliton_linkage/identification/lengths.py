# SPDX-License-Identifier: Apache-2.0
"""Unknown lengths of a chain and offsets of its encoders: order, initial values and prior.

The order of the P unknowns is r_0, o_0, a_0, l_0, r_1, and so on until o_{N-1}. Here, r, a and l
are the logarithms of rotor length, spacing and rest length, and o is an encoder offset [rad].

In the prior, the logarithms of each of the three kinds of lengths are normally distributed about
their mean, and the offsets about 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain

UNKNOWNS_PER_ROTOR = 4
"""Number of unknowns per rotor: r, o, a and l."""
UNKNOWNS_PER_BOND = 6
"""Number of unknowns that affect a bond: its a and l, and r and o of its two rotors."""
_LONGEST_STEP = 0.2
"""Largest change of a log length [1] or offset [rad] in a step; longer steps are shortened."""


@dataclass(frozen=True)
class Lengths:
    """Lengths of a chain of N rotors with free ends, and offsets of its encoders.

    In the fits, the unit of all lengths is the mean spacing instead of 1 m.
    """

    rotor_lengths: Array
    """Lengths r from pivot to mass [m], (N,)."""
    spacings: Array
    """Distances a from each pivot to the next [m], (N - 1,)."""
    rest_lengths: Array
    """Rest lengths l: lengths of relaxed springs, or of bars [m], (N - 1,)."""
    offsets: Array
    """Offsets o of the encoders, reading minus angle [rad], (N,)."""

    @property
    def rotors(self) -> int:
        """Number of rotors."""
        return len(self.rotor_lengths)

    def changed(self, change: Array) -> Lengths:
        """Return these lengths with `change`, (P,), added to the unknowns.

        If an element of `change` exceeds `_LONGEST_STEP`, the whole vector is scaled down.
        """
        largest = float(np.abs(change).max(initial=0.0))
        rotor, offset, spacing, rest = split(change * min(1.0, _LONGEST_STEP / max(largest, 1e-9)))
        return Lengths(
            self.rotor_lengths * np.exp(rotor),
            self.spacings * np.exp(spacing),
            self.rest_lengths * np.exp(rest),
            self.offsets + offset,
        )

    def scaled(self, spacing: float) -> Lengths:
        """Return the lengths, scaled so that the mean spacing is `spacing` [m]."""
        scale = spacing / float(self.spacings.mean())
        return Lengths(
            scale * self.rotor_lengths,
            scale * self.spacings,
            scale * self.rest_lengths,
            self.offsets,
        )

    def chain(self, template: Chain) -> Chain:
        """Return a chain with these lengths; `template` supplies all other parameters."""
        spacing, length = float(self.spacings.mean()), float(self.rotor_lengths.mean())
        rest = float(self.rest_lengths.mean())
        cosine = math.sqrt(max(rest**2 - spacing**2, 0.0)) / (2 * length)
        deviations = replace(
            template.deviations,
            spacing=tuple((self.spacings / spacing - 1).tolist()),
            rotor_length=tuple((self.rotor_lengths / length - 1).tolist()),
            rest_length=tuple((self.rest_lengths / rest - 1).tolist()),
        )
        return replace(
            template,
            number_of_rotors=self.rotors,
            spacing=spacing,
            rotor_length=length,
            rest_angle=math.acos(min(cosine, 1.0)),
            deviations=deviations,
        )


def chain_lengths(chain: Chain) -> Lengths:
    """Return the lengths of a chain, with encoder offsets of 0."""
    none = np.zeros(chain.number_of_rotors)
    return Lengths(chain.rotor_lengths, chain.spacings, chain.rest_lengths, none)


def split(unknowns: Array) -> tuple[Array, Array, Array, Array]:
    """Return views of the unknowns r, o, a and l, which alternate on the last axis."""
    r, o, a, length = (unknowns[..., k::UNKNOWNS_PER_ROTOR] for k in range(UNKNOWNS_PER_ROTOR))
    return r, o, a, length


def split_lengths(unknowns: Array) -> dict[str, Array]:
    """Return the views of `split`; the keys are `offset` and field names of `Deviations`."""
    names = 'rotor_length', 'offset', 'spacing', 'rest_length'
    return dict(zip(names, split(unknowns), strict=True))


_PASSING = 0.2
"""`initial_lengths` uses a bond only in frames in which a wall passes it. For each bond, d is
sin(phi_{n+1}) - sin(phi_n) minus its median over all frames. A wall is assumed to pass if |d| is
larger than this times the median, over the bonds, of the largest |d| of each bond [1]."""


def initial_lengths(angles: Array) -> Lengths:
    """Return lengths that fit angles [rad], (T, N), with equal rotors, equal bonds and spacing 1.

    Raises ValueError if no such lengths fit. The angles of the two equal rotors of a bond obey
    Freudenstein's equation, from which K_0 and K_1 are estimated:

        cos(phi_n - phi_{n+1}) = K_0 + K_1 (sin(phi_{n+1}) - sin(phi_n)),
        K_0 = (a^2 + 2 r^2 - l^2) / (2 r^2),    K_1 = a / r.
    """
    inner = angles[:, 1:-1] if angles.shape[1] > 4 else angles
    differences = np.diff(np.sin(inner), axis=1)
    cosines = np.cos(np.diff(inner, axis=1))
    constants = np.nanmedian(cosines, axis=0)
    across = differences - np.nanmedian(differences, axis=0)
    swing = float(np.median(np.nanmax(np.abs(across), axis=0)))
    passing = np.abs(across) > _PASSING * swing
    ratio = float(across[passing] @ (cosines - constants)[passing])
    ratio /= float(across[passing] @ across[passing])
    constant = float(np.median(constants))
    if ratio < 0:
        raise ValueError(
            'the angles are those of a chain seen from behind; name the joints from the first '
            'rotor to the last, and measure angles from upright towards the last rotor'
        )
    squared = ratio**2 + 2 * (1 - constant)
    if not squared > ratio**2 > 0:
        raise ValueError(
            'no chain of rotors with pivots in a row has these angles; check that they are in '
            'radians, measured from upright towards the last rotor, in the order of the rotors'
        )
    rotors = angles.shape[1]
    length, rest = 1 / float(ratio), math.sqrt(squared) / float(ratio)
    return Lengths(
        np.full(rotors, length), np.ones(rotors - 1), np.full(rotors - 1, rest), np.zeros(rotors)
    )


_INITIAL = 0.04
"""Initial values of the prior standard deviations of log lengths [1] and of offsets [rad]; with
larger values, the estimates diverge."""
_SMALLEST, _LARGEST = 1e-4, 0.3
"""Limits of the estimated prior standard deviations of log lengths [1] and of offsets [rad]."""


@dataclass(frozen=True)
class Tolerances:
    """Prior standard deviations of log lengths [1] and of offsets [rad].

    The value of the log lengths is the same for all three kinds. It is the standard deviation from
    the mean of the kind.
    """

    lengths: float = _INITIAL
    offsets: float = _INITIAL

    def information(self, rotors: int) -> Array:
        """Return the information matrix of the prior of the P unknowns of N `rotors`, (P, P)."""
        size = UNKNOWNS_PER_ROTOR * rotors - 2
        information = np.zeros((size, size))
        for part in (0, 2, 3):
            rows = np.arange(part, size, UNKNOWNS_PER_ROTOR)
            centred = np.eye(len(rows)) - 1 / len(rows)
            information[np.ix_(rows, rows)] = centred / self.lengths**2
        rows = np.arange(1, size, UNKNOWNS_PER_ROTOR)
        information[rows, rows] = self.offsets**-2
        return information

    def is_close(self, other: Tolerances, fraction: float) -> bool:
        """Return whether the relative differences from `other` are at most a `fraction` [1]."""
        return (
            abs(self.lengths - other.lengths) <= fraction * other.lengths
            and abs(self.offsets - other.offsets) <= fraction * other.offsets
        )

    @staticmethod
    def estimated(lengths: Lengths, covariance: Array, given: float | None) -> Tolerances:
        """Return tolerances estimated from lengths and the covariance of their unknowns, (P, P).

        If `given` [1] is not None, it replaces the estimated tolerance of the lengths.
        """
        rotor, offset, spacing, rest = split(np.diag(covariance))
        squares = [
            _squares(np.log(lengths.rotor_lengths), rotor),
            _squares(np.log(lengths.spacings), spacing),
            _squares(np.log(lengths.rest_lengths), rest),
        ]
        of_lengths = math.sqrt(sum(squares) / (3 * lengths.rotors - 5))
        of_offsets = math.sqrt(float(np.mean(lengths.offsets**2 + offset)))
        return Tolerances(given or _limited(of_lengths), _limited(of_offsets))


def to_unknowns(lengths: Lengths) -> Array:
    """Return the unknowns, (P,), in the order that the module docstring states."""
    values = np.empty(UNKNOWNS_PER_ROTOR * lengths.rotors - 2)
    rotor, offset, spacing, rest = split(values)
    rotor[:], offset[:] = np.log(lengths.rotor_lengths), lengths.offsets
    spacing[:], rest[:] = np.log(lengths.spacings), np.log(lengths.rest_lengths)
    return values


def _squares(logarithms: Array, variances: Array) -> float:
    return float(np.sum((logarithms - logarithms.mean()) ** 2 + variances))


def _limited(tolerance: float) -> float:
    return min(max(tolerance, _SMALLEST), _LARGEST)
