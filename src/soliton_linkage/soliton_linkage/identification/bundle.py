# SPDX-License-Identifier: Apache-2.0
"""Lengths and offsets by least squares with errors in all readings, all frames at once.

Each frame has N unknown angles and N - 1 conditions, that every bond closes. The angles are
eliminated frame by frame: where J are the slopes of the misclosures w with the unknowns p,

    sum over frames of (w + J dp)^T M^-1 (w + J dp) = least,    v = S R^T M^-1 (w + J dp)

gives the change dp of the unknowns and the errors v of the readings (Gauss and Helmert). About
the true angles and lengths sum J^T M^-1 J is Fisher's information on p, with nothing assumed of
the motion, and its inverse the Cramer-Rao bound.

How far bonds are from closing: their length from mass to mass less that of spring or bar.

With h = r sin(phi), v = r cos(phi) and phi = y - o of a reading y, the misclosure of bond n is

    f_n = |(a_n + h_{n+1} - h_n, v_{n+1} - v_n)| - l_n.

Readings y with independent errors of variance S, whose true values make all f_n = 0, have to
first order the misclosures w = f(x) + R (y - o - x) of the covariance M = R S R^T about
configurations x; it is tridiagonal over the bonds of a frame, and its Cholesky factor, of two
diagonals, makes independent numbers of unit variance of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import numpy as np

from soliton_linkage.identification.lengths import OF_A_BOND, OF_A_ROTOR, Lengths
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.springs import spring_between

_TOGETHER = 256
"""Frames that are worked on at once: their arrays stay in the cache."""
_UNSEEN = 1e4
"""Variance of a reading that is missing, over that of most [1]: 100 times as unsure."""
_CLOSINGS = 8
"""Times that angles are moved after a step [1]: 2 or 3 but where bonds are in line with rotors."""
_CLOSED = 1e-4
"""Largest change of an angle with which they are closed [rad], far below the noise."""
_FARTHEST = 0.3
"""That angles may be from readings [rad]: Newton's steps between lengths that are far off, where
bonds are nearly in line with rotors, lead anywhere."""


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

    def pulled(self, forces: Array) -> Array:
        """R^T of forces in the bonds, (N - 1, T): torques on the rotors, (N, T)."""
        torques = np.zeros((len(forces) + 1, forces.shape[1]))
        torques[:-1] = self.first * forces
        torques[1:] += self.second * forces
        return torques


def misclosures(lengths: Lengths, angles: Array) -> Misclosures:
    """Misclosures about true angles of frames [rad], shape (N, T)."""
    r, a = lengths.rotor_lengths[:, None], lengths.spacings[:, None]
    rest = lengths.rest_lengths[:, None]
    sine, cosine = np.sin(angles), np.cos(angles)
    h, v = r * sine, r * cosine
    offset = a**2 + r[:-1] ** 2 + r[1:] ** 2 - rest**2
    values, first, second = spring_between(h[:-1], v[:-1], h[1:], v[1:], a, offset, rest)
    across = (a + h[1:] - h[:-1]) / (rest + values)
    up = (v[1:] - v[:-1]) / (rest + values)
    slopes = np.empty((*first.shape, OF_A_BOND))
    slopes[..., 0] = -(h[:-1] * across + v[:-1] * up)
    slopes[..., 1] = -first
    slopes[..., 2] = a * across
    slopes[..., 3] = -rest
    slopes[..., 4] = h[1:] * across + v[1:] * up
    slopes[..., 5] = -second
    return Misclosures(values, first, second, slopes)


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


@dataclass(frozen=True)
class NormalEquations:
    """Information on the unknowns, and what the readings say, for readings of unit variance."""

    matrix: Array
    """sum J^T M^-1 J [1/rad^2], shape (P, P)."""
    vector: Array
    """-sum J^T M^-1 w, shape (P,)."""
    squares: Array
    """sum over frames of the squared whitened misclosure of each bond [rad^2], shape (N - 1,)."""


class Bundle:
    """Readings of T frames and the true angles that they are believed to be of."""

    def __init__(
        self,
        lengths: Lengths,
        readings: Array,
        spreads: Array | None = None,
        repeats: Array | None = None,
    ) -> None:
        """Begin with first lengths and readings [rad], NaN where missing, shape (T, N).

        Spreads are standard deviations of single readings over that of most [1], (T, N). Of
        readings with repeats, (T, N), so many together say as much as one [1].
        """
        self._readings = np.ascontiguousarray(readings.T)
        self._seen = np.isfinite(self._readings)
        squared = 1.0 if spreads is None else spreads.T**2
        repeated = np.ones_like(self._readings) if repeats is None else repeats.T
        self._variances = np.where(self._seen, squared * repeated, _UNSEEN)
        self._counts = self._seen / repeated
        self.lengths = lengths
        self.angles = self._filled() - lengths.offsets[:, None]
        """True angles [rad], shape (N, T)."""
        self.normal: NormalEquations
        """Of a bundle that was closed."""

    def _filled(self) -> Array:
        """Readings, on straight lines between others where they are missing [rad], (N, T)."""
        frames = np.arange(self._readings.shape[1])
        return np.array(
            [
                np.interp(frames, frames[seen], values[seen])
                for values, seen in zip(self._readings, self._seen, strict=True)
            ]
        )

    def closed(self, lengths: Lengths) -> Bundle:
        """Return the bundle about other lengths, with angles at which all bonds close."""
        made = copy(self)
        made.lengths, made.angles = lengths, self.angles.copy()
        for _ in range(_CLOSINGS):
            if made.close() < _CLOSED:
                break
        made.normal = made.normal_equations()
        return made

    @property
    def conditions(self) -> float:
        """Number of independent conditions that readings fulfil.

        The reading that is surest tells where a frame is.
        """
        return float(np.sum(self._counts.sum(axis=0) - self._counts.max(axis=0)))

    def normal_equations(self) -> NormalEquations:
        """What all frames say of a change of the unknowns."""
        size = OF_A_ROTOR * self.lengths.rotors - 2
        matrix, vector = np.zeros((size, size)), np.zeros(size)
        squares = np.zeros(self.lengths.rotors - 1)
        for frames in self._chunks():
            about, factors, whitened = self._linearised(frames)
            squares += np.einsum('nt,nt->n', whitened, whitened)
            _accumulate(about, factors, whitened, matrix, vector)
        return NormalEquations(matrix, vector, squares)

    def close(self) -> float:
        """Move the angles to the nearest at which all bonds close; largest change [rad]."""
        largest = 0.0
        for frames in self._chunks():
            about, factors, whitened = self._linearised(frames)
            pulls = about.pulled(factors.solved(whitened))
            errors = np.clip(self._variances[:, frames] * pulls, -_FARTHEST, _FARTHEST)
            closed = self._corrected(frames) - errors
            largest = max(largest, float(np.abs(closed - self.angles[:, frames]).max()))
            self.angles[:, frames] = closed
        return largest

    def left(self) -> Array:
        """What the angles leave of the readings [rad], 0 where none was read, shape (T, N)."""
        left = self._readings - self.lengths.offsets[:, None] - self.angles
        return np.asarray(np.where(self._seen, left, 0.0).T)

    def _linearised(self, frames: slice) -> tuple[Misclosures, Factor, Array]:
        angles = self.angles[:, frames]
        about = misclosures(self.lengths, angles)
        apart = self._corrected(frames) - angles
        values = about.values + about.first * apart[:-1] + about.second * apart[1:]
        factors = factor(about.first, about.second, self._variances[:, frames])
        return about, factors, factors.whitened(values)

    def _corrected(self, frames: slice) -> Array:
        """Readings less the offsets; angles as they are where none was read, (N, T)."""
        read = self._readings[:, frames] - self.lengths.offsets[:, None]
        return np.where(self._seen[:, frames], read, self.angles[:, frames])

    def _chunks(self) -> Iterator[slice]:
        for begin in range(0, self._readings.shape[1], _TOGETHER):
            yield slice(begin, begin + _TOGETHER)


def _accumulate(
    about: Misclosures, factors: Factor, whitened: Array, matrix: Array, vector: Array
) -> None:
    """Add what some frames say to the normal equations."""
    bonds, frames = whitened.shape
    rows = np.zeros((frames, OF_A_ROTOR * bonds + 2))
    for n in range(bonds):
        end = OF_A_ROTOR * n + OF_A_BOND
        known = rows[:, :end]
        known *= (-factors.below[n] / factors.diagonal[n])[:, None]
        known[:, -OF_A_BOND:] += about.slopes[n] / factors.diagonal[n][:, None]
        matrix[:end, :end] += known.T @ known
        vector[:end] -= known.T @ whitened[n]
