# SPDX-License-Identifier: Apache-2.0
"""The lengths of every bond, from the angles of frames in which a wall passes, without forces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.identification.geometry.bundle import Bundle, NormalEquations
from soliton_linkage.identification.geometry.lengths import OF_A_ROTOR, Lengths, lengths_of, split
from soliton_linkage.identification.geometry.passable import passable
from soliton_linkage.identification.geometry.tolerances import Tolerances, unknowns_of
from soliton_linkage.identification.rounding import repeats
from soliton_linkage.linkage.chain import Array, Chain

_MOST_STEPS = 30
"""Gauss-Newton steps [1]: 6 to 15 are usual."""
_BEGINNINGS = 3
"""Times that steps are gone from where they led to [1]: 2 but for chains with several bonds that
nearly stop walls."""
_HALVINGS = 8
"""Parts of a step that are tried [1], the last a hundredth."""
_UPHILL = 1.0
"""By how much twice a logarithm of the likelihood may be less after a step [1], as it is by
chance: slopes are those to first order."""
_CLOSINGS = 8
"""Times that angles are moved after a step [1]: 2 or 3 but where bonds are in line with rotors."""
_CLOSED = 1e-4
"""Largest change of an angle with which they are closed [rad], far below the noise."""
_SETTLED = 0.05
"""Length of a step over the uncertainty of all unknowns together that ends them [1]."""
_LEARNT = 0.05
"""Relative change of the tolerances that ends them [1]: those of no offsets creep towards 0."""


@dataclass(frozen=True)
class Adjustment:
    """Lengths and offsets that the angles show, in lengths of the mean spacing, and how well."""

    lengths: Lengths
    covariance: Array
    """Of the unknowns, in their order, shape (P, P); the mean spacing is without error."""
    information: Array
    """What the angles alone say of the unknowns, shape (P, P)."""
    tolerances: Tolerances
    noise: float
    """Standard deviation of a reading [rad], by what the bonds leave open."""
    bond_noise: Array
    """The same by each bond alone, shape (N - 1,)."""
    left: Array
    """What is left of the readings [rad], shape (T, N)."""
    settled: bool
    """Whether more steps would change nothing."""

    @property
    def deviations(self) -> Array:
        """Standard deviation of each unknown, shape (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def adjusted(
    readings: Array,
    start: Lengths,
    tolerance: float | None = None,
    spreads: Array | None = None,
) -> Adjustment:
    """Lengths by the readings of frames [rad], NaN where missing, shape (T, N).

    A tolerance of lengths [1] is learnt from the readings unless it is given. Spreads are
    standard deviations of single readings over that of most [1], (T, N).

    Where a bond comes in line with a rotor, frames may have been closed on the far side of that
    while lengths were far off: at the end all are closed anew, from the readings. What does not
    settle begins anew from where it came to.
    """
    for _ in range(_BEGINNINGS):
        found = _adjusted(readings, start, tolerance, spreads)
        if found.settled:
            break
        start = found.lengths
    return found


def _adjusted(
    readings: Array, start: Lengths, tolerance: float | None, spreads: Array | None
) -> Adjustment:
    """The same in one go, which need not settle."""
    given = readings, spreads, repeats(readings)
    bundle = Bundle(start, *given)
    tolerances = Tolerances() if tolerance is None else Tolerances(tolerance)
    basis = measurable(start)
    _close(bundle)
    settled = False
    normal = bundle.normal_equations()
    for _ in range(_MOST_STEPS):
        noise, covariance = _covariance(bundle, normal, basis, tolerances)
        prior = tolerances.information(start.rotors)
        gradient = normal.vector / noise**2 - prior @ unknowns_of(bundle.lengths)
        change = covariance @ gradient
        normal, helped = _stepped(bundle, normal, change, prior, noise)
        if not helped:
            break
        before = tolerances
        tolerances = tolerances.relearnt(bundle.lengths, covariance)
        if tolerance is not None:
            tolerances = Tolerances(tolerance, tolerances.of_offsets)
        if float(change @ gradient) < _SETTLED**2 and tolerances.close_to(before, _LEARNT):
            begun = Bundle(passable(bundle.lengths, covariance), *given)
            _close(begun)
            anew = begun.normal_equations()
            least = _cost(bundle, normal, prior, noise) - _UPHILL
            settled = not _cost(begun, anew, prior, noise) < least
            if settled:
                break
            bundle, normal = begun, anew
    noise, covariance = _covariance(bundle, normal, basis, tolerances)
    information = normal.matrix / noise**2
    freedom = bundle.conditions - float(np.sum(covariance * information))
    bond_noise = np.sqrt(normal.squares * len(normal.squares) / freedom)
    return Adjustment(
        passable(bundle.lengths, covariance),
        covariance,
        information,
        tolerances,
        noise,
        bond_noise,
        bundle.left(),
        settled,
    )


def _stepped(
    bundle: Bundle, normal: NormalEquations, change: Array, prior: Array, noise: float
) -> tuple[NormalEquations, bool]:
    """Go a step, or a part of it where all of it would lead uphill; False where none helps."""
    lengths, angles = bundle.lengths, bundle.angles.copy()
    before = _cost(bundle, normal, prior, noise)
    for halvings in range(_HALVINGS):
        bundle.lengths = lengths.changed(change / 2**halvings)
        bundle.angles = angles.copy()
        _close(bundle)
        normal = bundle.normal_equations()
        after = _cost(bundle, normal, prior, noise)
        if after < before + _UPHILL:
            break
    return normal, halvings == 0 or after < before


def _close(bundle: Bundle) -> None:
    for _ in range(_CLOSINGS):
        if bundle.close() < _CLOSED:
            break


def _cost(bundle: Bundle, normal: NormalEquations, prior: Array, noise: float) -> float:
    """Twice the negative logarithm of the likelihood."""
    unknowns = unknowns_of(bundle.lengths)
    return float(normal.squares.sum() / noise**2 + unknowns @ prior @ unknowns)


def measurable(lengths: Lengths) -> Array:
    """Orthonormal changes of the unknowns that keep the mean spacing, shape (P, P - 1).

    Angles say nothing of the scale of all lengths together.
    """
    size = OF_A_ROTOR * lengths.rotors - 2
    scale = np.zeros((size, 1))
    split(scale[:, 0])[2][:] = lengths.spacings
    return np.asarray(np.linalg.qr(scale, mode='complete')[0][:, 1:])


def bound(
    chain: Chain, angles: Array, noise: float, tolerances: Tolerances | None = None
) -> Array:
    """Cramer-Rao bound of the covariance of the unknowns, shape (P, P).

    For true angles of frames [rad], shape (T, N), that are read with a noise [rad], and, where
    tolerances are known, the mean over all chains that are made with them.
    """
    bundle = Bundle(lengths_of(chain), angles)
    information = bundle.normal_equations().matrix / noise**2
    if tolerances is not None:
        information += tolerances.information(chain.number_of_rotors)
    return _inverse(information, measurable(bundle.lengths))


def _covariance(
    bundle: Bundle, normal: NormalEquations, basis: Array, tolerances: Tolerances
) -> tuple[float, Array]:
    """Noise [rad] and covariance of the unknowns."""
    noise = math.sqrt(float(normal.squares.sum()) / max(bundle.conditions - len(basis.T), 1))
    prior = tolerances.information(bundle.lengths.rotors)
    return noise, _inverse(normal.matrix / noise**2 + prior, basis)


def _inverse(information: Array, basis: Array) -> Array:
    return np.asarray(basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T)
