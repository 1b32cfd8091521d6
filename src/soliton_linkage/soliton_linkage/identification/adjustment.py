# SPDX-License-Identifier: Apache-2.0
"""Lengths of every bond that close the bonds of all frames, without forces.

Estimates of bonds near the limits of `solitons.passage` may lie beyond them, although no bond
stopped the wall of the recording. `passable` moves such lengths back as conditions in a least
squares adjustment do: for conditions that are short of zero by s, with the slopes G and lengths of
the covariance C,

    dp = C G^T (G C G^T)^-1 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from soliton_linkage.identification.bundle import Bundle
from soliton_linkage.identification.least_squares import covariance_in
from soliton_linkage.identification.lengths import (
    OF_A_ROTOR,
    Lengths,
    Tolerances,
    lengths_of,
    split,
    unknowns_of,
)
from soliton_linkage.identification.readings import repeats
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
    bundle = Bundle(start, *given).closed(start)
    tolerances = Tolerances(tolerance or Tolerances.of_lengths)
    basis = measurable(start)
    settled = False
    for _ in range(_MOST_STEPS):
        noise, covariance = _covariance(bundle, basis, tolerances)
        prior = tolerances.information(start.rotors)
        gradient = bundle.normal.vector / noise**2 - prior @ unknowns_of(bundle.lengths)
        change = covariance @ gradient
        bundle, helped = _stepped(bundle, change, prior, noise)
        if not helped:
            break
        before = tolerances
        tolerances = tolerances.relearnt(bundle.lengths, covariance, tolerance)
        if float(change @ gradient) < _SETTLED**2 and tolerances.close_to(before, _LEARNT):
            lengths = passable(bundle.lengths, covariance)
            anew = Bundle(lengths, *given).closed(lengths)
            settled = _cost(anew, prior, noise) >= _cost(bundle, prior, noise) - _UPHILL
            if settled:
                break
            bundle = anew
    noise, covariance = _covariance(bundle, basis, tolerances)
    information = bundle.normal.matrix / noise**2
    freedom = bundle.conditions - float(np.sum(covariance * information))
    squares = bundle.normal.squares
    return Adjustment(
        passable(bundle.lengths, covariance),
        covariance,
        information,
        tolerances,
        noise,
        np.sqrt(squares * len(squares) / freedom),
        bundle.left(),
        settled,
    )


def _stepped(bundle: Bundle, change: Array, prior: Array, noise: float) -> tuple[Bundle, bool]:
    """Return the bundle after a step, shortened where all of it leads uphill, and if that helps.

    Damped steps in its place stop far from the least where bonds are in line with rotors.
    """
    before = _cost(bundle, prior, noise)
    for halvings in range(_HALVINGS):
        changed = bundle.closed(bundle.lengths.changed(change / 2**halvings))
        after = _cost(changed, prior, noise)
        if after < before + _UPHILL:
            break
    return changed, halvings == 0 or after < before


def _cost(bundle: Bundle, prior: Array, noise: float) -> float:
    """Return twice the negative logarithm of the likelihood."""
    unknowns = unknowns_of(bundle.lengths)
    return float(bundle.normal.squares.sum() / noise**2 + unknowns @ prior @ unknowns)


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
    return covariance_in(measurable(bundle.lengths), information)


def _covariance(bundle: Bundle, basis: Array, tolerances: Tolerances) -> tuple[float, Array]:
    """Return the noise [rad] and the covariance of the unknowns."""
    normal = bundle.normal
    noise = math.sqrt(float(normal.squares.sum()) / max(bundle.conditions - len(basis.T), 1))
    prior = tolerances.information(bundle.lengths.rotors)
    return noise, covariance_in(basis, normal.matrix / noise**2 + prior)


_CHANCE = 3.0
"""Standard deviations from a limit up to which chance may have led across it [1]."""
_MARGIN = 1e-3
"""Of a bond from its limit, over its spacing [1]: orbits are followed to a hundredth of it."""
_ROUNDS = 5
"""Times that lengths are moved [1]: a bond's neighbours may come beyond their limit then."""


def passable(lengths: Lengths, covariance: Array) -> Lengths:
    """Nearest lengths at which no bond stops a wall, given what is known of them (P, P)."""
    for _ in range(_ROUNDS):
        room, slopes = _room(lengths)
        margins = _MARGIN * np.tile(lengths.spacings, 2)
        short = margins - room
        deviations = _deviations(slopes, covariance)
        mended = (short > 0) & (-room < _CHANCE * deviations + margins)
        if not mended.any():
            break
        known = covariance @ slopes[mended].T
        change = known @ np.linalg.lstsq(slopes[mended] @ known, short[mended], rcond=None)[0]
        lengths = lengths.changed(change)
    return lengths


def nearly_stopping(lengths: Lengths, covariance: Array) -> dict[int, float]:
    """Bonds that are within both limits, but by no more than chance, and how likely they are not.

    The probability [1] that a bond whose lengths are normal about these, with the covariance
    (P, P), to first order, is beyond the limit that it is nearer to, by its number.
    """
    room, slopes = _room(lengths)
    over = (room / _deviations(slopes, covariance)).reshape(2, -1).min(axis=0)
    near = np.flatnonzero((over > 0) & (over < _CHANCE))
    return dict(zip(near.tolist(), ndtr(-over[near]).tolist(), strict=True))


def _deviations(slopes: Array, covariance: Array) -> Array:
    """Standard deviations of what has slopes with the unknowns, shape (.,)."""
    return np.asarray(np.sqrt(np.einsum('cp,pq,cq->c', slopes, covariance, slopes)))


def _room(lengths: Lengths) -> tuple[Array, Array]:
    """How far bonds are within both limits, and the slopes of that with the unknowns, (., P).

    l - a - |r_n - r_(n+1)|, then a + l - r_n - r_(n+1) of flippers, its negative of spinners.
    """
    r, a, rest = lengths.rotor_lengths, lengths.spacings, lengths.rest_lengths
    left, right = r[:-1], r[1:]
    longer = np.where(left > right, 1.0, -1.0)
    class_room = a + rest - left - right
    side = 1.0 if np.median(class_room) > 0 else -1.0
    room = np.concatenate([rest - a - longer * (left - right), side * class_room])
    bonds = len(a)
    slopes = np.zeros((2, bonds, OF_A_ROTOR * bonds + 2))
    n = np.arange(bonds)
    places = OF_A_ROTOR * n
    slopes[0, n, places], slopes[1, n, places] = -longer * left, -side * left
    slopes[0, n, places + OF_A_ROTOR] = longer * right
    slopes[1, n, places + OF_A_ROTOR] = -side * right
    slopes[0, n, places + 2], slopes[1, n, places + 2] = -a, side * a
    slopes[0, n, places + 3], slopes[1, n, places + 3] = rest, side * rest
    return room, slopes.reshape(2 * bonds, -1)
