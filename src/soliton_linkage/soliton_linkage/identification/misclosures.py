# SPDX-License-Identifier: Apache-2.0
"""How far bonds are from closing: their length from mass to mass less that of spring or bar.

With h = r sin(phi), v = r cos(phi) and phi = y - o of a reading y, the misclosure of bond n is

    f_n = |(a_n + h_{n+1} - h_n, v_{n+1} - v_n)| - l_n.

Readings y with independent errors of variance S, whose true values make all f_n = 0, have to
first order the misclosures w = f(x) + R (y - o - x) of the covariance M = R S R^T about
configurations x; it is tridiagonal over the bonds of a frame, and its Cholesky factor, of two
diagonals, makes independent numbers of unit variance of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.identification.lengths import OF_A_BOND, Lengths
from soliton_linkage.linkage.chain import Array


@dataclass(frozen=True)
class Misclosures:
    """Misclosures of T frames about configurations, to first order; bonds come first.

    The shapes are (N - 1, T), of `slopes` (N - 1, T, 6).
    """

    values: Array
    """f [m]."""
    first: Array
    """df_n / dphi_n [m/rad]."""
    second: Array
    """df_n / dphi_{n+1} [m/rad]."""
    slopes: Array
    """Change of f_n with the unknowns r_n, o_n, a_n, l_n, r_{n+1}, o_{n+1}."""


def misclosures(lengths: Lengths, angles: Array) -> Misclosures:
    """Misclosures about true angles of frames [rad], shape (N, T)."""
    r, a = lengths.rotor_lengths[:, None], lengths.spacings[:, None]
    rest = lengths.rest_lengths[:, None]
    sine, cosine = np.sin(angles), np.cos(angles)
    h, v = r * sine, r * cosine
    across, up = a + h[1:] - h[:-1], v[1:] - v[:-1]
    length = np.hypot(across, up)
    across, up = across / length, up / length
    first = h[:-1] * up - v[:-1] * across
    second = v[1:] * across - h[1:] * up
    slopes = np.empty((*first.shape, OF_A_BOND))
    slopes[..., 0] = -(h[:-1] * across + v[:-1] * up)
    slopes[..., 1] = -first
    slopes[..., 2] = a * across
    slopes[..., 3] = -rest
    slopes[..., 4] = h[1:] * across + v[1:] * up
    slopes[..., 5] = -second
    return Misclosures(length - rest, first, second, slopes)


@dataclass(frozen=True)
class Factor:
    """Cholesky factor of M = R S R^T of each frame, S diagonal; shapes (N - 1, T)."""

    diagonal: Array
    below: Array
    """Beside the diagonal of the row before, 0 in the first row."""

    def whitened(self, values: Array) -> Array:
        """Independent numbers of unit variance of misclosures, shape (N - 1, T)."""
        made = np.empty_like(values)
        made[0] = values[0] / self.diagonal[0]
        for n in range(1, len(values)):
            made[n] = (values[n] - self.below[n] * made[n - 1]) / self.diagonal[n]
        return made

    def solved(self, whitened: Array) -> Array:
        """M^-1 times misclosures, given these whitened, shape (N - 1, T)."""
        made = np.empty_like(whitened)
        last = len(made) - 1
        made[last] = whitened[last] / self.diagonal[last]
        for n in range(last - 1, -1, -1):
            made[n] = (whitened[n] - self.below[n + 1] * made[n + 1]) / self.diagonal[n]
        return made


def factor(first: Array, second: Array, variances: Array) -> Factor:
    """Factor of M, given df/dphi [m/rad] (N - 1, T) and variances of readings [rad^2] (N, T)."""
    own = first**2 * variances[:-1] + second**2 * variances[1:]
    between = second[:-1] * first[1:] * variances[1:-1]
    diagonal, below = np.empty_like(own), np.zeros_like(own)
    diagonal[0] = np.sqrt(own[0])
    for n in range(1, len(own)):
        below[n] = between[n - 1] / diagonal[n - 1]
        diagonal[n] = np.sqrt(own[n] - below[n] ** 2)
    return Factor(diagonal, below)
