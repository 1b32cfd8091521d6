# SPDX-License-Identifier: Apache-2.0
"""The rigidity matrix of any configuration and its exact zero mode."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from soliton_linkage.chain import Array, Chain, Motion, uprightness

# Stands in for a coupling that vanishes, far below rounding beside any that does not.
_VANISHING = 1e-280


def rigidity_bands(chain: Chain, angles: Array) -> tuple[Array, Array]:
    """Return A_n = dl_n/dphi_n and B_n = dl_n/dphi_{n+1} [m/rad], each of shape (..., N-1)."""
    _, first, second = chain.springs(angles)
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
    return np.asarray(mode * ((-1.0) ** negatives / np.linalg.norm(mode)))


def mode_centre(mode: Array) -> float:
    """Where a mode sits [rotor spacings], sum_n n t_n^2 of a unit vector t."""
    return float(np.arange(len(mode)) @ mode**2)


def mode_towards_last(chain: Chain, angles: Array) -> Array:
    """The zero mode with the sign that moves the wall towards the last rotor [1], shape (N,).

    A wall at an edge goes on into the chain either way, after the edge rotor has swung past the
    line from its pivot to its neighbour's mass; there its coupling, A_0 or B_{N-2}, changes
    sign, and with it the wall's direction along the zero mode. The sign to start from is that of
    the left-leaning state with d < 1, where all A_n and B_n have the sign (-1)^(n+1) and the
    wall moves towards the last rotor while all theta_n grow; upside down all three signs are
    reversed. A spinner's edge rotor passes no such line: its wall moves towards the last rotor
    while sum_n h_n grows.
    """
    mode = zero_mode(chain, angles)
    if chain.motion is Motion.SPINNER:
        return mode if float(np.cos(angles) @ mode) >= 0 else -mode
    first, second = rigidity_bands(chain, angles)
    rotors = chain.number_of_rotors
    start = (-1) ** (rotors * (rotors + 1) // 2) * uprightness(angles) ** rotors
    return mode if start * np.sign(first[0]) * np.sign(second[-1]) >= 0 else -mode


def _without_zeros(band: Array) -> Array:
    return np.where(np.abs(band) < _VANISHING, _VANISHING, band)
