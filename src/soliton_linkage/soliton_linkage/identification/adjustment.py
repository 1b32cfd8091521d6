# SPDX-License-Identifier: Apache-2.0
"""Least-squares estimate of the lengths and encoder offsets with which all bonds close.

The misclosure of a bond is the distance between the ends of its two rotors minus its rest length.
The bond closes if the misclosure is 0. A bond whose lengths violate one of two limits (see
`_room`) may stop a domain wall. A moving wall is a soliton.
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
"""Largest number of Gauss-Newton steps in one run of the iteration [1]; 6 to 15 are usual."""
_RESTARTS = 3
"""Largest number of runs of the iteration [1]; each starts with the result of the previous one."""
_HALVINGS = 8
"""Largest number of step lengths that are tried [1]: the full step, its half, its quarter, ..."""
_NOISE_OF_COST = 1.0
"""A step is accepted if it increases -2 log likelihood by less than this [1], because the
linearisation of the misclosures causes errors of this size."""
_CONVERGED = 0.05
"""The iteration has converged if the Mahalanobis length of a step is smaller than this [1]."""
_TOLERANCE_CHANGE = 0.05
"""After each step, the prior standard deviations (see `Tolerances`) are estimated again. The
iteration continues while one of them changes by more than this fraction [1]."""


@dataclass(frozen=True)
class Adjustment:
    """Estimated lengths (in units of the mean spacing) and encoder offsets, with uncertainties."""

    lengths: Lengths
    covariance: Array
    """Covariance of the P unknowns of `lengths`, (P, P); the mean spacing has no variance."""
    information: Array
    """Fisher information of the readings (not of the prior) about the P unknowns, (P, P)."""
    tolerances: Tolerances
    noise: float
    """Standard deviation of a reading [rad], computed from the misclosures of all bonds."""
    bond_noise: Array
    """Standard deviation of a reading [rad], from the misclosures of each bond alone, (N - 1,)."""
    residuals: Array
    converged: bool

    @property
    def deviations(self) -> Array:
        """Standard deviation of each of the P unknowns, (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def adjust(
    readings: Array,
    start: Lengths,
    tolerance: float | None = None,
    relative_deviations: Array | None = None,
) -> Adjustment:
    """Estimate lengths and encoder offsets from readings [rad], (T, N), NaN if missing.

    `tolerance` is the prior standard deviation of log lengths [1]; if None, it is estimated.

    A bond that is nearly collinear with a rotor closes in two different configurations, and the
    iteration may follow the wrong one. Therefore, after convergence, the configurations of all
    frames are computed again from the readings. If they fit better, the iteration continues.
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
    before = _cost(bundle, prior, noise)
    for halvings in range(_HALVINGS):
        changed = bundle.closed(bundle.lengths.changed(change / 2**halvings))
        after = _cost(changed, prior, noise)
        if after < before + _NOISE_OF_COST:
            break
    return changed, halvings == 0 or after < before


def _cost(bundle: Bundle, prior: Array, noise: float) -> float:
    unknowns = to_unknowns(bundle.lengths)
    return float(bundle.normal.squares.sum() / noise**2 + unknowns @ prior @ unknowns)


def observable_basis(lengths: Lengths) -> Array:
    """Return an orthonormal basis of changes of the unknowns that keep the mean spacing.

    The shape is (P, P - 1), for P unknowns.
    """
    size = UNKNOWNS_PER_ROTOR * lengths.rotors - 2
    scale = np.zeros((size, 1))
    split(scale[:, 0])[2][:] = lengths.spacings
    return np.asarray(np.linalg.qr(scale, mode='complete')[0][:, 1:])


def cramer_rao_bound(
    chain: Chain, angles: Array, noise: float, tolerances: Tolerances | None = None
) -> Array:
    """Return the Cramer-Rao bound of the covariance of the P unknowns of a chain, (P, P).

    `angles` are the true angles [rad], (T, N), and `noise` is the standard deviation of a reading
    [rad]. `tolerances` specifies the prior of the unknowns; if it is None, there is no prior.
    """
    bundle = Bundle(chain_lengths(chain), angles)
    information = bundle.normal_equations().matrix / noise**2
    if tolerances is not None:
        information += tolerances.information(chain.number_of_rotors)
    return covariance_in(observable_basis(bundle.lengths), information)


def _covariance(bundle: Bundle, basis: Array, tolerances: Tolerances) -> tuple[float, Array]:
    normal = bundle.normal
    noise = math.sqrt(float(normal.squares.sum()) / max(bundle.conditions - len(basis.T), 1))
    prior = tolerances.information(bundle.lengths.rotors)
    return noise, covariance_in(basis, normal.matrix / noise**2 + prior)


_CHANCE = 3.0
"""A bond that violates no limit is reported if its distance from a limit is smaller than this
[standard deviations of the distance]. A bond that violates a limit is corrected if it violates
the limit by less than this."""
_MARGIN = 1e-3
"""After a correction, the distance of a bond from the limit is this times its spacing [1]."""
_ROUNDS = 5
"""Largest number of rounds of corrections [1]; a correction may violate another limit."""


def passable(lengths: Lengths, covariance: Array) -> Lengths:
    """Return the most likely lengths with which no bond may stop a wall (see `solitons.passage`).

    The correction of the unknowns p is dp = C G^T (G C G^T)^-1 s, with their covariance C, (P, P).
    For each bond that violates a limit, s contains the necessary change of the distance that
    `_room` returns, and G contains the derivatives of this distance by p. If a bond violates a
    limit by more than noise can cause, it is not corrected.
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
    """Return, for each bond near a limit, the probability that it violates the limit [1]."""
    room, slopes = _room(lengths)
    distances = (room / _deviations(slopes, covariance)).reshape(2, -1).min(axis=0)
    near = np.flatnonzero((distances > 0) & (distances < _CHANCE))
    return dict(zip(near.tolist(), ndtr(-distances[near]).tolist(), strict=True))


def _deviations(slopes: Array, covariance: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum('cp,pq,cq->c', slopes, covariance, slopes)))


def _room(lengths: Lengths) -> tuple[Array, Array]:
    """Return the distances of all K = N - 1 bonds from two limits, (2 K,), and derivatives.

    Distances have the same unit as the lengths. The first K elements are distances from the first
    limit, and the last K from the second one. The derivatives by the P unknowns are (2 K, P). A
    negative distance means that the bond violates the limit.

    For a bond with the rest length l, the spacing a and the rotor lengths r_n and r_(n+1), the
    first distance is l - a - |r_n - r_(n+1)|. The second one follows from
    s = a + l - r_n - r_(n+1), which must have the same sign on all bonds: it is positive in
    flippers, whose rotors swing, and negative in spinners, whose rotors turn fully. The second
    distance is |s|, with a negative sign if the sign of s differs from its sign on most bonds.
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
