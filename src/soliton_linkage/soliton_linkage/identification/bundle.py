# SPDX-License-Identifier: Apache-2.0
"""Bundle adjustment of lengths and offsets: least squares with errors in all readings.

A reading y of a rotor with the encoder offset o gives the angle phi = y - o. The end of a rotor of
length r is h = r sin(phi) beside its pivot and v = r cos(phi) above it. With the spacing a and the
rest length l, the misclosure of bond n is the distance between the ends of its rotors minus l_n:

    f_n = |(a_n + h_{n+1} - h_n, v_{n+1} - v_n)| - l_n.

Linearised at estimated angles x, the misclosure of the readings is w = f(x) + R (y - o - x), R =
df/dphi. If S is the diagonal matrix of the variances of the readings, w has the covariance
M = R S R^T. In each frame, M is tridiagonal. The change dp of the unknowns p (lengths and offsets)
minimises

    sum over frames of (w + J dp)^T M^-1 (w + J dp),    J = dw/dp

(Gauss-Helmert model). At the true values of x and p, the sum of J^T M^-1 J over all frames is the
Fisher information on p.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.lengths import UNKNOWNS_PER_BOND, UNKNOWNS_PER_ROTOR, Lengths
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.springs import spring_between

_BATCH = 256
"""Number of frames in a batch; the arrays of a batch fit into the cache."""
_MISSING_VARIANCE = 1e4
"""Variance of a missing reading, relative to the variance of a typical reading [1]."""
_CLOSINGS = 8
"""Largest number of Newton steps of the angles after a change of lengths [1]; 2 or 3 are usual."""
_CLOSED = 1e-4
"""Newton's method ends when all angles change by less than this [rad], far less than the noise."""
_LARGEST_ERROR = 0.3
"""A Newton step moves an angle at most this far from its reading [rad], to avoid divergence."""


class Misclosures(NamedTuple):
    """Misclosures f of the bonds in T frames, and their first derivatives, each (N - 1, T).

    Here, length is the unit of the `Lengths`.
    """

    values: Array
    """Misclosures f [length]."""
    first: Array
    """Derivatives by the angle of the left rotor, df_n / dphi_n [length/rad]."""
    second: Array
    """Derivatives by the angle of the right rotor, df_n / dphi_{n+1} [length/rad]."""
    slopes: Array
    """Derivatives of f_n by log r_n, o_n, log a_n, log l_n, log r_{n+1} and o_{n+1}; the shape is
    (N - 1, T, 6)."""

    def torques(self, forces: Array) -> Array:
        """Return the torques R^T F on the rotors, (N, T), for bond forces F, (N - 1, T)."""
        torques = np.zeros((len(forces) + 1, forces.shape[1]))
        torques[:-1] = self.first * forces
        torques[1:] += self.second * forces
        return torques


def misclosures(lengths: Lengths, angles: Array) -> Misclosures:
    """Return the misclosures and their derivatives at the angles of T frames [rad], (N, T)."""
    r, a = lengths.rotor_lengths[:, None], lengths.spacings[:, None]
    rest = lengths.rest_lengths[:, None]
    sine, cosine = np.sin(angles), np.cos(angles)
    h, v = r * sine, r * cosine
    offset = a**2 + r[:-1] ** 2 + r[1:] ** 2 - rest**2
    values, first, second = spring_between(h[:-1], v[:-1], h[1:], v[1:], a, offset, rest)
    across = (a + h[1:] - h[:-1]) / (rest + values)
    up = (v[1:] - v[:-1]) / (rest + values)
    slopes = np.empty((*first.shape, UNKNOWNS_PER_BOND))
    slopes[..., 0] = -(h[:-1] * across + v[:-1] * up)
    slopes[..., 1] = -first
    slopes[..., 2] = a * across
    slopes[..., 3] = -rest
    slopes[..., 4] = h[1:] * across + v[1:] * up
    slopes[..., 5] = -second
    return Misclosures(values, first, second, slopes)


class CholeskyFactor(NamedTuple):
    """Diagonals of the bidiagonal Cholesky factor L of M = R S R^T = L L^T, (N - 1, T) each."""

    diagonal: Array
    below: Array

    def whitened(self, values: Array) -> Array:
        """Return L^-1 w, which has independent elements, for misclosures w, (N - 1, ..., T)."""
        whitened = np.empty_like(values)
        whitened[0] = values[0] / self.diagonal[0]
        for n in range(1, len(values)):
            whitened[n] = (values[n] - self.below[n] * whitened[n - 1]) / self.diagonal[n]
        return whitened

    def solved(self, whitened: Array) -> Array:
        """Return M^-1 w = L^-T `whitened`, (N - 1, T), where `whitened` is L^-1 w."""
        solved = np.empty_like(whitened)
        last = len(solved) - 1
        solved[last] = whitened[last] / self.diagonal[last]
        for n in range(last - 1, -1, -1):
            solved[n] = (whitened[n] - self.below[n + 1] * solved[n + 1]) / self.diagonal[n]
        return solved


def cholesky_factor(first: Array, second: Array, variances: Array) -> CholeskyFactor:
    """Return the Cholesky factor of M for the variances S of the readings [rad^2], (N, T)."""
    own = first**2 * variances[:-1] + second**2 * variances[1:]
    between = second[:-1] * first[1:] * variances[1:-1]
    diagonal, below = np.empty_like(own), np.zeros_like(own)
    diagonal[0] = np.sqrt(own[0])
    for n in range(1, len(own)):
        below[n] = between[n - 1] / diagonal[n - 1]
        diagonal[n] = np.sqrt(own[n] - below[n] ** 2)
    return CholeskyFactor(diagonal, below)


class NormalEquations(NamedTuple):
    """Normal equations of the P unknowns, for readings with the variance 1 rad^2."""

    matrix: Array
    """Left side, the information: sum of J^T M^-1 J over all frames [1/rad^2], (P, P)."""
    vector: Array
    """Right side: minus the sum of J^T M^-1 w over all frames, (P,)."""
    squares: Array
    """Sum over all frames of the squared whitened misclosures of each bond [rad^2], (N - 1,)."""


class Bundle:
    """Readings in T frames, with estimates of the true angles and of the lengths."""

    def __init__(
        self,
        lengths: Lengths,
        readings: Array,
        relative_deviations: Array | None = None,
        repeat_counts: Array | None = None,
    ) -> None:
        """Start with readings [rad], (T, N), NaN if missing.

        `relative_deviations` are the standard deviations of the readings, divided by the standard
        deviation of a typical reading [1]. `repeat_counts` is the result of
        `readings.repeat_counts`: a run of equal readings has the weight of one reading.
        """
        self._readings = np.ascontiguousarray(readings.T)
        self._seen = np.isfinite(self._readings)
        squared = 1.0 if relative_deviations is None else relative_deviations.T**2
        repeated = np.ones_like(self._readings) if repeat_counts is None else repeat_counts.T
        self._variances = np.where(self._seen, squared * repeated, _MISSING_VARIANCE)
        self._weights = self._seen / repeated
        self.lengths = lengths
        frames = np.arange(self._readings.shape[1])
        interpolated = [
            np.interp(frames, frames[seen], values[seen])
            for values, seen in zip(self._readings, self._seen, strict=True)
        ]
        self.angles = np.array(interpolated) - lengths.offsets[:, None]
        self.normal: NormalEquations
        """Result of `normal_equations`, stored by `closed`; other bundles lack this attribute."""

    def closed(self, lengths: Lengths) -> Bundle:
        """Return a bundle with other lengths, and with angles corrected until all bonds close."""
        moved = copy(self)
        moved.lengths, moved.angles = lengths, self.angles.copy()
        for _ in range(_CLOSINGS):
            if moved.close() < _CLOSED:
                break
        moved.normal = moved.normal_equations()
        return moved

    @property
    def conditions(self) -> float:
        """Number of independent conditions on the readings: n - 1 per frame with n readings."""
        return float(np.sum(self._weights.sum(axis=0) - self._weights.max(axis=0)))

    def normal_equations(self) -> NormalEquations:
        """Return the normal equations of all frames, linearised at the estimated angles."""
        size = UNKNOWNS_PER_ROTOR * self.lengths.rotors - 2
        matrix, vector = np.zeros((size, size)), np.zeros(size)
        squares = np.zeros(self.lengths.rotors - 1)
        for frames in self._batches():
            linearised, factors, whitened = self._linearised(frames)
            squares += np.einsum('nt,nt->n', whitened, whitened)
            rows = np.zeros((whitened.shape[1], size))
            for n in range(len(whitened)):
                end = UNKNOWNS_PER_ROTOR * n + UNKNOWNS_PER_BOND
                part, diagonal = rows[:, :end], factors.diagonal[n]
                part *= (-factors.below[n] / diagonal)[:, None]
                part[:, -UNKNOWNS_PER_BOND:] += linearised.slopes[n] / diagonal[:, None]
                matrix[:end, :end] += part.T @ part
                vector[:end] -= part.T @ whitened[n]
        return NormalEquations(matrix, vector, squares)

    def error_equations(self, shapes: Array) -> tuple[Array, Array]:
        """Return the normal equations of P unknowns and K N encoder errors: matrix and right side.

        An encoder error adds its size times a function of time to the readings of a rotor.
        `shapes`, (K, N, T), contains K such functions for each rotor. The matrix is
        (P + K N, P + K N).
        """
        rotors, size = self.lengths.rotors, UNKNOWNS_PER_ROTOR * self.lengths.rotors - 2
        every = size + len(shapes) * rotors
        matrix, vector = np.zeros((every, every)), np.zeros(every)
        for frames in self._batches():
            linearised, factors, whitened = self._linearised(frames)
            slopes = np.zeros((len(whitened), every, whitened.shape[1]))
            for n, of_bond in enumerate(linearised.slopes):
                begin = UNKNOWNS_PER_ROTOR * n
                slopes[n, begin : begin + UNKNOWNS_PER_BOND] = of_bond.T
                slopes[n, size + n :: rotors] = -linearised.first[n] * shapes[:, n, frames]
                slopes[n, size + n + 1 :: rotors] = (
                    -linearised.second[n] * shapes[:, n + 1, frames]
                )
            rows = factors.whitened(slopes).transpose(1, 0, 2).reshape(every, -1)
            matrix += rows @ rows.T
            vector -= rows @ whitened.ravel()
        return matrix, vector

    def close(self) -> float:
        """Take a Newton step of the angles to close the bonds; return the largest change [rad]."""
        largest = 0.0
        for frames in self._batches():
            linearised, factors, whitened = self._linearised(frames)
            torques = linearised.torques(factors.solved(whitened))
            errors = self._variances[:, frames] * torques
            errors = np.clip(errors, -_LARGEST_ERROR, _LARGEST_ERROR)
            closed = self._corrected(frames) - errors
            largest = max(largest, float(np.abs(closed - self.angles[:, frames]).max()))
            self.angles[:, frames] = closed
        return largest

    def residuals(self) -> Array:
        """Return readings minus offsets minus angles [rad], (T, N); 0 for missing readings."""
        residuals = self._readings - self.lengths.offsets[:, None] - self.angles
        return np.asarray(np.where(self._seen, residuals, 0.0).T)

    def _linearised(self, frames: slice) -> tuple[Misclosures, CholeskyFactor, Array]:
        angles = self.angles[:, frames]
        linearised = misclosures(self.lengths, angles)
        first, second = linearised.first, linearised.second
        errors = self._corrected(frames) - angles
        values = linearised.values + first * errors[:-1] + second * errors[1:]
        factors = cholesky_factor(first, second, self._variances[:, frames])
        return linearised, factors, factors.whitened(values)

    def _corrected(self, frames: slice) -> Array:
        read = self._readings[:, frames] - self.lengths.offsets[:, None]
        return np.where(self._seen[:, frames], read, self.angles[:, frames])

    def _batches(self) -> Iterator[slice]:
        for begin in range(0, self._readings.shape[1], _BATCH):
            yield slice(begin, begin + _BATCH)


def covariance_in(basis: Array, information: Array) -> Array:
    """Return the covariance, (P, P), of unknowns that change only along the columns of `basis`."""
    return np.asarray(basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T)
