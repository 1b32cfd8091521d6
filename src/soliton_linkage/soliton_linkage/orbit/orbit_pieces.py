# SPDX-License-Identifier: Apache-2.0
"""The orbit of a chain whose rotors and springs deviate, in pieces that are made all at once.

A linkage has one freedom. Given the angle of one rotor in the wall, the seed, all others hang on
it bar by bar, and with t_{n+1} = -(A_n / B_n) t_n outwards from the seed,

    ds = dphi_seed / t_seed,    |t| = 1.

Errors die out on both sides as the zero mode does, so that bars have their length to rounding,
and nothing has to be followed from rotor to rotor. A piece is the way of the wall past its seed.
It is kept as a Chebyshev series in the arc length, of the rotors that move.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.orbit.seed_path import SeedPath, Sides, impassable, seed_path

_NODES = 20
"""Of a Chebyshev series [1]: most pieces converge without being halved, or halved once."""
_MOST_SPLITS = 8
"""How often a piece is halved [1]: what has not converged by then never does."""
_ACCURACY = 1e-11
"""Of the last two coefficients of a series [rad], below what bars promise of their lengths."""
_STILL = 2e-11
"""Tangent of a rotor up to which it stands still [1]: the rounding of a series of `_NODES`."""
_DEPTHS_BESIDE = 25
"""Rotors beside a seed in penetration depths [1]: e^-25 is below `_STILL`."""
_ROTORS_BESIDE = 6
"""And as many more [rotors], for a wall's own width where the depth goes to 0."""
_NEWTON_STEPS = 30
"""Far more than Newton's method takes to converge [1]: it is a bound, not an accuracy."""
_AT_ONCE = 2_000_000
"""Numbers that are made at once [1], 16 MB: more of them are no quicker."""
_MOST_NUMBERS = 20_000_000
"""Numbers that an orbit may take to make [1], about a minute of them."""

_POINTS = np.cos(math.pi * np.arange(_NODES)[::-1] / (_NODES - 1))
"""Chebyshev points of the second kind from -1 to 1, shape (K,)."""
_ORDERS = np.arange(_NODES + 1)
"""Of Chebyshev polynomials, as far as the integral of a series reaches, shape (K + 1,)."""
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(_POINTS, _NODES - 1))
"""Coefficients of the series from values at the points, shape (K, K)."""


@dataclass(frozen=True)
class OrbitPiece:
    """A piece of the orbit, of the rotors that move in it."""

    seed: int
    """Number of the rotor that moves most, or nearly so."""
    length: float
    """Arc length [rad]."""
    first: int
    """Number of the first rotor that moves."""
    series: Array
    """Angles [rad] and after them tangents [1] of n rotors, in Chebyshev series, (K, 2 n)."""

    @property
    def rotors(self) -> int:
        """Number of rotors that move."""
        return int(self.series.shape[1]) // 2

    def at(self, arc: float) -> Array:
        """Angles [rad] and after them tangents [1] at an arc length [rad] in the piece, (2 n,)."""
        share = min(max(2 * arc / self.length - 1, -1.0), 1.0)
        return np.asarray(np.cos(_ORDERS[:-1] * math.acos(share)) @ self.series)

    def edge(self, column: int) -> tuple[float, float]:
        """Angles of the first (0) or last (-1) of its rotors where it begins and ends [rad]."""
        return self.at(0.0)[: self.rotors][column], self.at(self.length)[: self.rotors][column]


def orbit_pieces(chain: Chain) -> list[OrbitPiece]:
    """Pieces of the closed orbit in their order.

    It begins in the middle of leg 0. Raises ValueError where the wall does not get through the
    chain, and where it would take more than about a minute.
    """
    last = chain.number_of_rotors - 1
    depth = penetration_depth(chain) / chain.spacing
    beside = min(math.ceil(_DEPTHS_BESIDE * depth) + _ROTORS_BESIDE, last)
    while True:
        rounds = 2 if chain.motion is Motion.SPINNER else 4
        _check_size(chain, rounds * (last + 1) * _NODES * (2 * beside + 1))
        pieces = _pieces(chain, beside)
        if beside == last or not any(_cut(piece, beside, last) for piece in pieces):
            return pieces
        beside = min(2 * beside, last)


def _pieces(chain: Chain, beside: int) -> list[OrbitPiece]:
    """Pieces of the orbit with so many rotors on each side of each seed."""
    todo = seed_path(chain, beside)
    keys = np.arange(len(todo), dtype=np.float64)
    done: list[tuple[float, OrbitPiece]] = []
    numbers = 0
    for splits in range(_MOST_SPLITS):
        numbers += len(todo) * _NODES * (2 * beside + 1)
        _check_size(chain, numbers)
        batches = math.ceil(len(todo) * _NODES * (2 * beside + 1) / _AT_ONCE)
        left = []
        for batch in np.array_split(np.arange(len(todo)), batches):
            pieces = zip(batch.tolist(), _resolved(chain, todo[batch]), strict=True)
            for number, piece in pieces:
                if piece is None:
                    left.append(number)
                else:
                    done.append((float(keys[number]), piece))
        if not left:
            return [piece for _, piece in sorted(done, key=lambda each: each[0])]
        todo = todo[np.array(left)].halves()
        keys = (keys[left][:, None] + np.array([0.0, 0.5 ** (splits + 1)])).ravel()
    raise impassable(chain, int(todo.seeds[0]))


def _cut(piece: OrbitPiece, beside: int, last: int) -> bool:
    """Whether rotors move at the ends of what was looked at."""
    low, high = piece.seed - beside, piece.seed + beside
    return 0 < low == piece.first or last > high == piece.first + piece.rotors - 1


def _window(chain: Chain, path: SeedPath) -> _Window:
    """Rotors about the seeds of a path, as far as its sides reach."""
    beside = path.left_sides.shape[1] // 2
    columns = path.seeds[:, None] + np.arange(-beside, beside + 1)
    rotors, springs = chain.number_of_rotors, chain.number_of_springs
    there = (columns >= 0) & (columns < rotors)
    bars = np.clip(columns[:, :-1], 0, springs - 1)
    return _Window(
        chain.rotor_lengths[np.clip(columns, 0, rotors - 1)],
        chain.spacings[bars],
        chain.rest_lengths[bars],
        path.left_sides,
        path.right_sides,
        there[:, None],
    )


@dataclass(frozen=True)
class _Window:
    """Rotors and bars about seeds, (P, W) and (P, W - 1), with the seed in the middle."""

    reaches: Array
    spacings: Array
    lengths: Array
    left_sides: Sides
    right_sides: Sides
    there: NDArray[np.bool_]
    """Whether there are such rotors, shape (P, 1, W)."""

    @property
    def beside(self) -> int:
        """Number of rotors on each side of the seed."""
        return int(self.spacings.shape[1]) // 2

    def hung(self, angles: Array) -> Array:
        """Angles of all rotors from those of the seeds [rad], (P, K) to (P, K, W)."""
        found = np.empty((*angles.shape, self.reaches.shape[1]))
        beside = self.beside
        found[..., beside] = angles
        for n in range(beside, 2 * beside):
            hung = self._next(found[..., n], n, n + 1, n)
            found[..., n + 1] = np.where(self.there[..., n + 1], hung, angles)
        for n in range(beside, 0, -1):
            hung = self._next(found[..., n], n, n - 1, n - 1)
            found[..., n - 1] = np.where(self.there[..., n - 1], hung, angles)
        return found

    def tangents(self, angles: Array) -> Array:
        """Unit zero modes of configurations [1], (P, K, W), along which the seed's angle grows."""
        h, v = self.reaches[:, None] * np.sin(angles), self.reaches[:, None] * np.cos(angles)
        across, up = np.diff(h) + self.spacings[:, None], np.diff(v)
        first = h[..., :-1] * up - v[..., :-1] * across
        second = v[..., 1:] * across - h[..., 1:] * up
        beside = self.beside
        to_right = -first[..., beside:] / second[..., beside:]
        to_left = -second[..., :beside] / first[..., :beside]
        to_right[~np.broadcast_to(self.there[..., beside + 1 :], to_right.shape)] = 0
        to_left[~np.broadcast_to(self.there[..., :beside], to_left.shape)] = 0
        left = np.cumprod(to_left[..., ::-1], axis=-1)[..., ::-1]
        right = np.cumprod(to_right, axis=-1)
        mode = np.concatenate([left, np.ones((*angles.shape[:-1], 1)), right], axis=-1)
        return np.asarray(mode / np.linalg.norm(mode, axis=-1, keepdims=True))

    def _next(self, angles: Array, rotor: int, hung: int, bar: int) -> Array:
        """Angles [rad] of the rotors that hang on their neighbours, as in `hung_from`, (P, K)."""
        sides = self.right_sides if hung > rotor else self.left_sides
        spacings = self.spacings[:, bar, None] * (-1 if hung > rotor else 1)
        reach, length = self.reaches[:, hung, None], self.lengths[:, bar, None]
        h = spacings + self.reaches[:, rotor, None] * np.sin(angles)
        v = self.reaches[:, rotor, None] * np.cos(angles)
        distance = np.hypot(h, v)
        beyond = (length - distance + reach) * (length + distance - reach)
        short = (distance + reach - length) * (distance + reach + length)
        return np.asarray(
            np.arctan2(h, v)
            + sides[:, bar, None] * 2 * np.arctan2(np.sqrt(beyond), np.sqrt(short))
        )


def _resolved(chain: Chain, path: SeedPath) -> list[OrbitPiece | None]:
    """Pieces of a path, None where they are to be halved for the series to converge."""
    halves = (path.ends - path.begins)[:, None] / 2
    middles = path.begins[:, None] + halves
    window = _window(chain, path)
    beside = window.beside
    with np.errstate(invalid='ignore', divide='ignore'):
        tangents = window.tangents(window.hung(middles + halves * _POINTS))
        speeds = np.abs(halves / tangents[..., beside]) @ _TO_SERIES.T
        shares = _even_shares(speeds)
        angles = window.hung(middles + halves * shares)
        tangents = window.tangents(angles) * np.sign(halves)[..., None]
        both = np.concatenate([np.unwrap(angles, axis=1), tangents], axis=-1)
    series = np.einsum('jk,pkw->pjw', _TO_SERIES, both)
    lengths = chebyshev.chebint(speeds, axis=1, lbnd=-1).sum(axis=1)
    tails = np.abs(series[:, -2:]).max(axis=(1, 2))
    good = np.maximum(tails, np.abs(speeds[:, -2:]).max(axis=1)) < _ACCURACY
    moving = np.abs(tangents).max(axis=1) > _STILL
    pieces: list[OrbitPiece | None] = []
    for n, seed in enumerate(path.seeds.tolist()):
        if not good[n]:
            pieces.append(None)
            continue
        columns = np.flatnonzero(moving[n])
        first, end = int(columns[0]), int(columns[-1]) + 1
        width = moving.shape[1]
        kept = [series[n, :, first:end], series[n, :, width + first : width + end]]
        number = seed - beside + first
        pieces.append(OrbitPiece(seed, float(lengths[n]), number, np.hstack(kept)))
    return pieces


def _even_shares(speeds: Array) -> Array:
    """Where from -1 to 1 the arc, the integral of speeds in series (P, K), has its nodes, (P, K).

    Newton's method; where it does not converge the series has not either.
    """
    arcs = chebyshev.chebint(speeds, axis=1, lbnd=-1)
    wanted = arcs.sum(axis=1)[:, None] * (1 + _POINTS) / 2
    shares = np.tile(_POINTS, (len(speeds), 1))
    with np.errstate(invalid='ignore', divide='ignore'):
        for _ in range(_NEWTON_STEPS):
            basis = np.cos(_ORDERS * np.arccos(shares)[..., None])
            off = np.einsum('pkj,pj->pk', basis, arcs) - wanted
            steps = off / np.einsum('pkj,pj->pk', basis[..., :-1], speeds)
            shares = np.clip(shares - steps, -1, 1)
            if not (np.abs(steps) > _ACCURACY**2).any():
                break
    return shares


def _check_size(chain: Chain, numbers: int) -> None:
    if numbers > _MOST_NUMBERS:
        raise ValueError(
            f'the orbit of a chain of {chain.number_of_rotors} rotors that deviate takes '
            f'{numbers:.3g} numbers or more, and {_MOST_NUMBERS:.3g} is the limit; take fewer '
            'rotors, or leave their deviations out'
        )
