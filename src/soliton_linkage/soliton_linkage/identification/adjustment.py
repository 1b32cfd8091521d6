# SPDX-License-Identifier: Apache-2.0
"""Estimation of all lengths and offsets, such that every bond closes in every frame.

Noise may put the estimated lengths of a bond beyond a limit of `solitons.passage`, although no
bond stopped the wall in the recording. `passable` corrects such lengths by constrained least
squares. With the violations s, their derivatives G, and the covariance C of the lengths,

    dp = C G^T (G C G^T)^-1 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from soliton_linkage.identification.bundle import Bundle, covariance_in
from soliton_linkage.identification.lengths import (
    UNKNOWNS_PER_ROTOR,
    Lengths,
    Tolerances,
    chain_lengths,
    split,
    to_unknowns,
)
from soliton_linkage.identification.readings import repeat_counts
from soliton_linkage.linkage.chain import Array, Chain

_MOST_STEPS = 30
"""Largest number of Gauss-Newton steps [1]; usually 6 to 15 are taken."""
_RESTARTS = 3
"""Largest number of runs [1]; 2 suffice except for chains with several bonds near a limit."""
_HALVINGS = 8
"""Number of fractions 1, 1/2, 1/4, ... of a step that are tried [1]."""
_NOISE_OF_COST = 1.0
"""Largest accepted increase of -2 log likelihood [1], because derivatives are first-order."""
_CONVERGED = 0.05
"""Step below which the iteration has converged, relative to the standard deviation of all unknowns
together [1]."""
_TOLERANCE_CHANGE = 0.05
"""Relative change of the tolerances below which they have converged [1]."""


@dataclass(frozen=True)
class Adjustment:
    """Estimated lengths, in units of the mean spacing, and offsets, with their covariance."""

    lengths: Lengths
    covariance: Array
    """Covariance of the unknowns, in their order, (P, P); the mean spacing has no error."""
    information: Array
    """Information of the angles without the prior, shape (P, P)."""
    tolerances: Tolerances
    noise: float
    """Standard deviation of a reading, from all misclosures [rad]."""
    bond_noise: Array
    """Standard deviation of a reading, from the misclosures of each bond [rad], (N - 1,)."""
    residuals: Array
    """Readings minus offsets and angles [rad], shape (T, N)."""
    converged: bool

    @property
    def deviations(self) -> Array:
        """Standard deviation of each unknown, shape (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def adjust(
    readings: Array,
    start: Lengths,
    tolerance: float | None = None,
    relative_deviations: Array | None = None,
) -> Adjustment:
    """Estimate lengths and offsets from readings of frames [rad], NaN if missing, shape (T, N).

    The tolerance of lengths [1] is estimated unless it is given. Relative deviations, (T, N), are
    standard deviations of readings, divided by the typical standard deviation [1].

    If a bond is collinear with a rotor, the closure of a frame has two nearby solutions. With the
    initial lengths the wrong solution may be found. After convergence, all frames are therefore
    closed again, starting from the readings. If this changes the result, the iteration is
    repeated.
    """
    for _ in range(_RESTARTS):
        found = _adjust_once(readings, start, tolerance, relative_deviations)
        if found.converged:
            break
        start = found.lengths
    return found


def _adjust_once(
    readings: Array, start: Lengths, tolerance: float | None, relative_deviations: Array | None
) -> Adjustment:
    given = readings, relative_deviations, repeat_counts(readings)
    bundle = Bundle(start, *given).closed(start)
    tolerances = Tolerances(tolerance or Tolerances.lengths)
    basis = observable_basis(start)
    converged = False
    for _ in range(_MOST_STEPS):
        noise, covariance = _covariance(bundle, basis, tolerances)
        prior = tolerances.information(start.rotors)
        gradient = bundle.normal.vector / noise**2 - prior @ to_unknowns(bundle.lengths)
        change = covariance @ gradient
        bundle, improved = _stepped(bundle, change, prior, noise)
        if not improved:
            break
        before = tolerances
        tolerances = Tolerances.estimated(bundle.lengths, covariance, tolerance)
        if float(change @ gradient) < _CONVERGED**2 and tolerances.is_close(
            before, _TOLERANCE_CHANGE
        ):
            lengths = passable(bundle.lengths, covariance)
            again = Bundle(lengths, *given).closed(lengths)
            difference = _cost(again, prior, noise) - _cost(bundle, prior, noise)
            converged = difference >= -_NOISE_OF_COST
            if converged:
                break
            bundle = again
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
        bundle.residuals(),
        converged,
    )


def _stepped(bundle: Bundle, change: Array, prior: Array, noise: float) -> tuple[Bundle, bool]:
    """Return the bundle after a step, halved until the cost decreases, and whether it decreased.

    Levenberg-Marquardt steps would end far from the minimum if bonds are in line with rotors.
    """
    before = _cost(bundle, prior, noise)
    for halvings in range(_HALVINGS):
        changed = bundle.closed(bundle.lengths.changed(change / 2**halvings))
        after = _cost(changed, prior, noise)
        if after < before + _NOISE_OF_COST:
            break
    return changed, halvings == 0 or after < before


def _cost(bundle: Bundle, prior: Array, noise: float) -> float:
    """Return -2 log likelihood [1]."""
    unknowns = to_unknowns(bundle.lengths)
    return float(bundle.normal.squares.sum() / noise**2 + unknowns @ prior @ unknowns)


def observable_basis(lengths: Lengths) -> Array:
    """Return orthonormal changes of the unknowns with constant mean spacing, shape (P, P - 1).

    Angles do not depend on the scale of all lengths.
    """
    size = UNKNOWNS_PER_ROTOR * lengths.rotors - 2
    scale = np.zeros((size, 1))
    split(scale[:, 0])[2][:] = lengths.spacings
    return np.asarray(np.linalg.qr(scale, mode='complete')[0][:, 1:])


def cramer_rao_bound(
    chain: Chain, angles: Array, noise: float, tolerances: Tolerances | None = None
) -> Array:
    """Return the Cramer-Rao bound of the covariance of the unknowns, shape (P, P).

    Arguments are the true angles of frames [rad], shape (T, N), and the noise of readings [rad].
    With tolerances, the bound is for random chains with these tolerances.
    """
    bundle = Bundle(chain_lengths(chain), angles)
    information = bundle.normal_equations().matrix / noise**2
    if tolerances is not None:
        information += tolerances.information(chain.number_of_rotors)
    return covariance_in(observable_basis(bundle.lengths), information)


def _covariance(bundle: Bundle, basis: Array, tolerances: Tolerances) -> tuple[float, Array]:
    """Return the noise [rad] and the covariance of the unknowns."""
    normal = bundle.normal
    noise = math.sqrt(float(normal.squares.sum()) / max(bundle.conditions - len(basis.T), 1))
    prior = tolerances.information(bundle.lengths.rotors)
    return noise, covariance_in(basis, normal.matrix / noise**2 + prior)


_CHANCE = 3.0
"""Largest violation of a limit that noise can explain, in standard deviations [1]."""
_MARGIN = 1e-3
"""Distance of a corrected bond from its limit, relative to its spacing [1]."""
_ROUNDS = 5
"""Largest number of corrections [1]; each may move a neighbouring bond beyond its limit."""


def passable(lengths: Lengths, covariance: Array) -> Lengths:
    """Return the nearest lengths for which no bond stops a wall, given their covariance, (P, P).

    Violations that noise cannot explain are not corrected.
    """
    for _ in range(_ROUNDS):
        room, slopes = _room(lengths)
        margins = _MARGIN * np.tile(lengths.spacings, 2)
        violations = margins - room
        deviations = _deviations(slopes, covariance)
        corrected = (violations > 0) & (-room < _CHANCE * deviations + margins)
        if not corrected.any():
            break
        products = covariance @ slopes[corrected].T
        conditions = slopes[corrected] @ products
        change = products @ np.linalg.lstsq(conditions, violations[corrected], rcond=None)[0]
        lengths = lengths.changed(change)
    return lengths


def near_limit_bonds(lengths: Lengths, covariance: Array) -> dict[int, float]:
    """Return the probability that a bond exceeds its limit, for each bond close to a limit [1].

    The keys are the numbers of the bonds. The probability is computed to first order from the
    covariance (P, P). Bonds whose distance from the limit is large compared with the noise are
    omitted.
    """
    room, slopes = _room(lengths)
    distances = (room / _deviations(slopes, covariance)).reshape(2, -1).min(axis=0)
    near = np.flatnonzero((distances > 0) & (distances < _CHANCE))
    return dict(zip(near.tolist(), ndtr(-distances[near]).tolist(), strict=True))


def _deviations(slopes: Array, covariance: Array) -> Array:
    """Return the standard deviations of quantities from their derivatives, shape (.,)."""
    return np.asarray(np.sqrt(np.einsum('cp,pq,cq->c', slopes, covariance, slopes)))


def _room(lengths: Lengths) -> tuple[Array, Array]:
    """Return the distances of bonds to both limits [m], and their derivatives, (., P).

    The distances are l - a - |r_n - r_(n+1)|, and a + l - r_n - r_(n+1) for flippers or its
    negative for spinners.
    """
    r, a, rest = lengths.rotor_lengths, lengths.spacings, lengths.rest_lengths
    left, right = r[:-1], r[1:]
    longer = np.where(left > right, 1.0, -1.0)
    class_room = a + rest - left - right
    side = 1.0 if np.median(class_room) > 0 else -1.0
    room = np.concatenate([rest - a - longer * (left - right), side * class_room])
    bonds = len(a)
    slopes = np.zeros((2, bonds, UNKNOWNS_PER_ROTOR * bonds + 2))
    n = np.arange(bonds)
    first = UNKNOWNS_PER_ROTOR * n
    slopes[0, n, first], slopes[1, n, first] = -longer * left, -side * left
    slopes[0, n, first + UNKNOWNS_PER_ROTOR] = longer * right
    slopes[1, n, first + UNKNOWNS_PER_ROTOR] = -side * right
    slopes[0, n, first + 2], slopes[1, n, first + 2] = -a, side * a
    slopes[0, n, first + 3], slopes[1, n, first + 3] = rest, side * rest
    return room, slopes.reshape(2 * bonds, -1)
