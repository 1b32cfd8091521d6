# SPDX-License-Identifier: Apache-2.0
"""Orbit of a chain with deviations, divided into pieces that are stored as Chebyshev series.

In each piece, one rotor in the wall is called the seed. The angle of the seed determines the
angles of its neighbours, these determine the angles of the next rotors, and so on outwards. Errors
of the angles decay outwards as fast as the zero mode. The levers of bar n are A_n = dl_n/dphi_n
and B_n = dl_n/dphi_{n+1} with the distance l_n between the masses n and n + 1. The tangent t
satisfies t_{n+1} = -(A_n / B_n) t_n and |t| = 1. The arc length follows from
ds = dphi_seed / t_seed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.orbit.seed_path import SeedPath, blocked_wall_error, seed_path

_NODES = 20
"""Number K of terms of a Chebyshev series [1]. With 20 terms, most series converge without halving
the piece, or after one halving."""
_MOST_SPLITS = 8
"""Largest number of attempts to compute converged series [1]. After each attempt, the pieces whose
series have not converged are halved. More attempts do not improve the convergence."""
_ACCURACY = 1e-11
"""Threshold of convergence: a series has converged if the absolute values of its last two
coefficients are below this [rad]."""
_STILL = 2e-11
"""Threshold of motion: a rotor counts as immobile in a piece if the absolute value of its
component of the tangent never exceeds this [1]. The value is the rounding error of a series."""
_DEPTHS_BESIDE = 25
"""Largest distance from the seed at which rotors are computed [penetration depths]. The
penetration depth is the distance over which the tangent decays by the factor e. At 25 depths, the
tangent is e^-25, which is below `_STILL`."""
_ROTORS_BESIDE = 6
"""Number of rotors that are added on each side of the seed to the distance `_DEPTHS_BESIDE` [1],
because the penetration depth can be close to 0."""
_NEWTON_STEPS = 30
"""Largest number of Newton steps in the search for the nodes of a series [1]."""
_BATCH = 2_000_000
"""Largest number of values in a batch [1]. A batch of this size needs 16 MB; larger batches are
not faster."""
_MOST_NUMBERS = 20_000_000
"""A chain is rejected if more values than this [1] must be computed for its orbit. The computation
of this many values takes about a minute."""

_POINTS = np.cos(math.pi * np.arange(_NODES)[::-1] / (_NODES - 1))
"""Chebyshev points of the second kind from -1 to 1, shape (K,)."""
_ORDERS = np.arange(_NODES + 1)
"""Orders of the Chebyshev polynomials in the integral of a series of K terms, shape (K + 1,)."""
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(_POINTS, _NODES - 1))
"""Matrix that converts values at `_POINTS` to the coefficients of the series, shape (K, K)."""


@dataclass(frozen=True)
class OrbitPiece:
    """Piece of an orbit with one seed and n moving rotors; the first of them is rotor `first`."""

    seed: int
    length: float
    """Arc length of the piece [rad]."""
    first: int
    series: Array
    """Chebyshev coefficients of the angles [rad] and tangents [1] of the n rotors, (K, 2 n)."""

    @property
    def rotors(self) -> int:
        """Number n of moving rotors."""
        return int(self.series.shape[1]) // 2

    def at(self, arc: float) -> Array:
        """Return n angles [rad], then n tangents [1], at an arc length in the piece [rad]."""
        x = min(max(2 * arc / self.length - 1, -1.0), 1.0)
        return np.asarray(np.cos(_ORDERS[:-1] * math.acos(x)) @ self.series)


def orbit_pieces(chain: Chain) -> list[OrbitPiece]:
    """Return the pieces of the closed orbit in order, beginning in the middle of leg 0.

    Raises ValueError if the wall cannot pass, or if the computation would take over a minute.
    """
    last = chain.number_of_rotors - 1
    depth = penetration_depth(chain) / chain.spacing
    beside = min(math.ceil(_DEPTHS_BESIDE * depth) + _ROTORS_BESIDE, last)
    while True:
        passages = 2 if chain.motion is Motion.SPINNER else 4
        _check_size(chain, passages * (last + 1) * _NODES * (2 * beside + 1))
        pieces = _pieces(chain, beside)
        if beside == last or not any(_is_cut(piece, beside, last) for piece in pieces):
            return pieces
        beside = min(2 * beside, last)


def _pieces(chain: Chain, beside: int) -> list[OrbitPiece]:
    todo = seed_path(chain, beside)
    keys = np.arange(len(todo.seeds), dtype=np.float64)
    done: list[tuple[float, OrbitPiece]] = []
    numbers = 0
    for splits in range(_MOST_SPLITS):
        size = len(keys) * _NODES * (2 * beside + 1)
        numbers += size
        _check_size(chain, numbers)
        batches = np.array_split(np.arange(len(keys)), math.ceil(size / _BATCH))
        found = [piece for each in batches for piece in _resolved(chain, todo.take(each))]
        left = [number for number, piece in enumerate(found) if piece is None]
        done += [(float(key), piece) for key, piece in zip(keys, found, strict=True) if piece]
        if not left:
            return [piece for _, piece in sorted(done, key=lambda each: each[0])]
        todo = todo.take(np.array(left)).halves()
        keys = (keys[left][:, None] + np.array([0.0, 0.5 ** (splits + 1)])).ravel()
    raise blocked_wall_error(chain, int(todo.seeds[0]))


def _is_cut(piece: OrbitPiece, beside: int, last: int) -> bool:
    low, high = piece.seed - beside, piece.seed + beside
    return 0 < low == piece.first or last > high == piece.first + piece.rotors - 1


class _Window:
    """Windows of W rotors and W - 1 bars around each of P seeds."""

    def __init__(self, chain: Chain, path: SeedPath) -> None:
        self.beside = path.left_branches.shape[1] // 2
        columns = path.seeds[:, None] + np.arange(-self.beside, self.beside + 1)
        rotors, springs = chain.number_of_rotors, chain.number_of_springs
        bars = np.clip(columns[:, :-1], 0, springs - 1)
        self.rotor_lengths = chain.rotor_lengths[np.clip(columns, 0, rotors - 1)]
        self.spacings, self.bar_lengths = chain.spacings[bars], chain.rest_lengths[bars]
        self.left_branches, self.right_branches = path.left_branches, path.right_branches
        self.exists = ((columns >= 0) & (columns < rotors))[:, None]

    def angles(self, seeds: Array) -> Array:
        """Return all angles in the windows [rad], (P, K, W), for K given angles of each seed."""
        found = np.empty((*seeds.shape, self.rotor_lengths.shape[1]))
        beside = self.beside
        found[..., beside] = seeds
        for n in range(beside, 2 * beside):
            neighbour = self._neighbour(found[..., n], n, n + 1, n)
            found[..., n + 1] = np.where(self.exists[..., n + 1], neighbour, seeds)
        for n in range(beside, 0, -1):
            neighbour = self._neighbour(found[..., n], n, n - 1, n - 1)
            found[..., n - 1] = np.where(self.exists[..., n - 1], neighbour, seeds)
        return found

    def tangents(self, angles: Array) -> Array:
        """Return the unit zero modes, whose component at the seed is positive [1], (P, K, W)."""
        r = self.rotor_lengths[:, None]
        h, v = r * np.sin(angles), r * np.cos(angles)
        across, up = np.diff(h) + self.spacings[:, None], np.diff(v)
        first = h[..., :-1] * up - v[..., :-1] * across
        second = v[..., 1:] * across - h[..., 1:] * up
        beside = self.beside
        to_right = -first[..., beside:] / second[..., beside:]
        to_left = -second[..., :beside] / first[..., :beside]
        to_right[~np.broadcast_to(self.exists[..., beside + 1 :], to_right.shape)] = 0
        to_left[~np.broadcast_to(self.exists[..., :beside], to_left.shape)] = 0
        left = np.cumprod(to_left[..., ::-1], axis=-1)[..., ::-1]
        right = np.cumprod(to_right, axis=-1)
        mode = np.concatenate([left, np.ones((*angles.shape[:-1], 1)), right], axis=-1)
        return np.asarray(mode / np.linalg.norm(mode, axis=-1, keepdims=True))

    def _neighbour(self, angles: Array, rotor: int, neighbour: int, bar: int) -> Array:
        branches = self.right_branches if neighbour > rotor else self.left_branches
        spacings = self.spacings[:, bar, None] * (-1 if neighbour > rotor else 1)
        r, length = self.rotor_lengths[:, neighbour, None], self.bar_lengths[:, bar, None]
        h = spacings + self.rotor_lengths[:, rotor, None] * np.sin(angles)
        v = self.rotor_lengths[:, rotor, None] * np.cos(angles)
        distance = np.hypot(h, v)
        above = (length - distance + r) * (length + distance - r)
        below = (distance + r - length) * (distance + r + length)
        aside = branches[:, bar, None] * 2 * np.arctan2(np.sqrt(above), np.sqrt(below))
        return np.asarray(np.arctan2(h, v) + aside)


def _resolved(chain: Chain, path: SeedPath) -> list[OrbitPiece | None]:
    halves = (path.ends - path.begins)[:, None] / 2
    middles = path.begins[:, None] + halves
    window = _Window(chain, path)
    beside = window.beside
    with np.errstate(invalid='ignore', divide='ignore'):
        tangents = window.tangents(window.angles(middles + halves * _POINTS))
        speeds = np.abs(halves / tangents[..., beside]) @ _TO_SERIES.T
        angles = window.angles(middles + halves * _nodes_in_arc(speeds))
        tangents = window.tangents(angles) * np.sign(halves)[..., None]
        both = np.concatenate([np.unwrap(angles, axis=1), tangents], axis=-1)
    series = np.einsum('jk,pkw->pjw', _TO_SERIES, both)
    lengths = chebyshev.chebint(speeds, axis=1, lbnd=-1).sum(axis=1)
    tails = np.abs(series[:, -2:]).max(axis=(1, 2))
    converged = np.maximum(tails, np.abs(speeds[:, -2:]).max(axis=1)) < _ACCURACY
    moving = np.abs(tangents).max(axis=1) > _STILL
    pieces: list[OrbitPiece | None] = []
    for n, seed in enumerate(path.seeds.tolist()):
        if not converged[n]:
            pieces.append(None)
            continue
        columns = np.flatnonzero(moving[n])
        first, end = int(columns[0]), int(columns[-1]) + 1
        width = moving.shape[1]
        kept = [series[n, :, first:end], series[n, :, width + first : width + end]]
        number = seed - beside + first
        pieces.append(OrbitPiece(seed, float(lengths[n]), number, np.hstack(kept)))
    return pieces


def _nodes_in_arc(speeds: Array) -> Array:
    """Return the scaled angles x of the seeds at which the scaled arc lengths are `_POINTS`.

    The result has the shape (P, K). In each piece, the angle of the seed and the arc length are
    scaled so that they increase from -1 to 1. `speeds` contains the Chebyshev coefficients of
    ds/dx, (P, K).
    """
    arcs = chebyshev.chebint(speeds, axis=1, lbnd=-1)
    wanted = arcs.sum(axis=1)[:, None] * (1 + _POINTS) / 2
    points = np.tile(_POINTS, (len(speeds), 1))
    with np.errstate(invalid='ignore', divide='ignore'):
        for _ in range(_NEWTON_STEPS):
            basis = np.cos(_ORDERS * np.arccos(points)[..., None])
            errors = np.einsum('pkj,pj->pk', basis, arcs) - wanted
            steps = errors / np.einsum('pkj,pj->pk', basis[..., :-1], speeds)
            points = np.clip(points - steps, -1, 1)
            if not (np.abs(steps) > _ACCURACY**2).any():
                break
    return points


def _check_size(chain: Chain, numbers: int) -> None:
    if numbers > _MOST_NUMBERS:
        raise ValueError(
            f'the orbit of a chain of {chain.number_of_rotors} rotors with deviations takes at '
            f'least {numbers:.3g} numbers, more than the limit {_MOST_NUMBERS:.3g}; take fewer '
            'rotors, or remove their deviations'
        )
