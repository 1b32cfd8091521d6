# SPDX-License-Identifier: Apache-2.0
"""The rigidity matrix of any configuration and its exact zero mode."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array

from soliton_linkage.chain import Array, Chain, Motion

# Stands in for a coupling that vanishes, far below rounding beside any that does not.
_VANISHING = 1e-280


def rigidity_bands(chain: Chain, angles: Array) -> tuple[Array, Array]:
    """Return A_n = dl_n/dphi_n and B_n = dl_n/dphi_{n+1} [m/rad], each of shape (..., N-1).

    A_n = (h_n v_{n+1} - v_n (a + h_{n+1})) / l_n, B_n = (v_{n+1} (a - h_n) + v_n h_{n+1}) / l_n.
    """
    horizontal, vertical = chain.positions(angles)
    lengths = chain.rest_length + chain.spring_extensions(angles)
    cross = vertical[..., :-1] * horizontal[..., 1:] - horizontal[..., :-1] * vertical[..., 1:]
    first = -(chain.spacing * vertical[..., :-1] + cross) / lengths
    second = (chain.spacing * vertical[..., 1:] + cross) / lengths
    return first, second


def rigidity_matrix(chain: Chain, angles: Array) -> csr_array:
    """Rigidity matrix R with dl = R dphi [m/rad], sparse, shape (N-1, N)."""
    first, second = rigidity_bands(chain, angles)
    bonds = np.arange(chain.number_of_rotors - 1)
    rows = np.concatenate([bonds, bonds])
    columns = np.concatenate([bonds, bonds + 1])
    shape = (chain.number_of_rotors - 1, chain.number_of_rotors)
    return csr_array((np.concatenate([first, second]), (rows, columns)), shape=shape)


def zero_mode(chain: Chain, angles: Array) -> Array:
    """Unit vector t [1] with R t = 0 at a configuration, shape (N,); exact in O(N).

    The recurrence t_{n+1} = -(A_n / B_n) t_n is followed outwards from the largest component,
    in the direction in which it decays, so that nothing overflows and rounding errors shrink.
    The sign is that of the maximal minors of R, t_n ~ (-1)^n A_0 ... A_{n-1} B_n ... B_{N-2}:
    along a motion of the linkage t turns continuously and never flips.
    """
    first, second = (_without_zeros(band) for band in rigidity_bands(chain, angles))
    growth = np.concatenate([[0.0], np.cumsum(np.log(np.abs(first / second)))])
    peak = int(np.argmax(growth))
    ratios = -first / second
    mode = np.concatenate(
        [np.cumprod(1 / ratios[:peak][::-1])[::-1], [1.0], np.cumprod(ratios[peak:])]
    )
    negatives = np.count_nonzero(first[:peak] < 0) + np.count_nonzero(second[peak:] < 0) + peak
    return mode * ((-1.0) ** negatives / np.linalg.norm(mode))


def mode_centre(mode: Array) -> float:
    """Where a mode sits [rotor spacings], sum_n n t_n^2 of a unit vector t."""
    return float(np.arange(len(mode)) @ mode**2)


def mode_towards_last(chain: Chain, angles: Array) -> Array:
    """The zero mode with the sign that moves the wall towards the last rotor [1], shape (N,).

    A wall at an edge goes on into the chain either way, after the edge rotor has swung past the
    line from its pivot to its neighbour's mass; there its coupling changes sign, and with it
    the wall's direction along the zero mode. A spinner's edge rotor passes no such line: its
    wall moves towards the last rotor while sum_n u_n grows.
    """
    mode = zero_mode(chain, angles)
    if chain.motion is Motion.SPINNER:
        return mode if float(np.cos(angles) @ mode) >= 0 else -mode
    sense = _edge_sense(chain, angles) * _sense_in_left_leaning_state(chain)
    return mode if sense >= 0 else -mode


def _edge_sense(chain: Chain, angles: Array) -> float:
    """Sign that changes where an edge rotor points at, or away from, its neighbour's mass."""
    first, second = rigidity_bands(chain, angles)
    return float(np.sign(first[0]) * np.sign(second[-1]))


@lru_cache(maxsize=16)
def _sense_in_left_leaning_state(chain: Chain) -> float:
    """+1 where sense and mode together point into the chain in the uniform left-leaning state."""
    state = chain.uniform_state(-1)
    small = 1e-4 * zero_mode(chain, state)
    ahead = mode_centre(zero_mode(chain, state + small))
    behind = mode_centre(zero_mode(chain, state - small))
    return float(np.sign(ahead - behind)) * _edge_sense(chain, state)


def _without_zeros(band: Array) -> Array:
    return np.where(np.abs(band) < _VANISHING, _VANISHING, band)
