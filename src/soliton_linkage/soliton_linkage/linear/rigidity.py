# SPDX-License-Identifier: Apache-2.0
"""Rigidity matrix and zero modes of any configuration, and the zero mode at an edge."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Chain, Motion, uprightness

# Functions that use scipy import it themselves, because the import takes 1 s and 50 MB. Actuators
# need only functions without scipy.
if TYPE_CHECKING:
    from scipy.sparse import csr_array

_VANISHING = 1e-280
"""Smallest product of a lever and a spring length in the computation of the zero mode [m^2/rad].
Smaller products are replaced by this value, because they are divisors."""
_BLOCK = 500
"""Number of factors that are multiplied before the product is rescaled [1]. Because the absolute
value of each factor is between 1/2 and 1, the absolute value of the product is above 2^-502. The
smallest normal double is 2^-1022."""
_FAR_FROM_OVERFLOW = 1e100
"""If a component of a mode, or the inverse of a component, is larger than this [1], the mode is
computed again with separate exponents. Squares of smaller components do not overflow."""


class Edge(enum.Enum):
    """Edge of the chain: the first, the last, or the one nearer to the centre of the zero mode."""

    NEAREST = 'nearest'
    FIRST = 'first'
    LAST = 'last'

    def resolved(self, chain: Chain, angles: Array) -> Edge:
        """Return this edge; for NEAREST, return the edge nearer to the centre of the zero mode."""
        return self if self is not Edge.NEAREST else _nearest(zero_mode(chain, angles))


def rigidity_bands(chain: Chain, angles: Array) -> tuple[Array, Array]:
    """Return the levers A_n = dl_n/dphi_n and B_n = dl_n/dphi_{n+1} of the springs [m/rad]."""
    _, first, second = chain.springs(angles)
    return first, second


def rigidity_matrix(chain: Chain, angles: Array) -> csr_array:
    """Return the sparse rigidity matrix R [m/rad], for which dl = R dphi, shape (springs, N)."""
    from scipy.sparse import csr_array

    first, second = rigidity_bands(chain, chain.check_angles(angles))
    springs = np.arange(chain.number_of_springs)
    rows = np.concatenate([springs, springs])
    columns = np.concatenate([springs, (springs + 1) % chain.number_of_rotors])
    shape = (chain.number_of_springs, chain.number_of_rotors)
    return csr_array((np.concatenate([first, second]), (rows, columns)), shape=shape)


def dynamical_matrix(chain: Chain, angles: Array) -> csr_array:
    """Return the dynamical matrix D = I^(-1/2) R^T k_e R I^(-1/2) [rad^2/s^2], sparse, (N, N).

    I and k_e are diagonal matrices of the moments of inertia and the stiffnesses, and R is the
    result of `rigidity_matrix`. D acts on the vector with the elements sqrt(I_n) dphi_n. If the
    springs are relaxed, the eigenvalues of D are the squared angular frequencies.
    """
    matrix = rigidity_matrix(chain, angles)
    scaled = matrix.multiply(1 / np.sqrt(chain.moments_of_inertia)).tocsr()
    product: csr_array = (scaled.T @ scaled.multiply(chain.stiffnesses[:, None])).tocsr()
    return product


def zero_modes(chain: Chain, angles: Array, tolerance: float = 1e-10) -> Array:
    """Return orthonormal zero modes t [1], which satisfy R t = 0, as columns, shape (N, N_0).

    The number N_0 of zero modes and the number N_ss of states of self-stress satisfy
    N_0 - N_ss = N - `number_of_springs` (paper, section 1). Singular values below `tolerance`
    times the largest singular value count as 0. The computing time is O(N^3).
    """
    from scipy.linalg import null_space

    return np.asarray(null_space(rigidity_matrix(chain, angles).toarray(), tolerance))


def states_of_self_stress(chain: Chain, angles: Array, tolerance: float = 1e-10) -> Array:
    """Return orthonormal states of self-stress as columns [1], shape (springs, N_ss).

    A state of self-stress consists of spring tensions s with R^T s = 0. `zero_modes` explains N_ss
    and `tolerance`.
    """
    from scipy.linalg import null_space

    return np.asarray(null_space(rigidity_matrix(chain, angles).toarray().T, tolerance))


def zero_mode(chain: Chain, angles: Array) -> Array:
    """Return the zero mode at a configuration: the unit vector t [1] with R t = 0, shape (N,).

    The recursion t_{n+1} = -(A_n / B_n) t_n with the levers A and B of `rigidity_bands` has no
    cancellation and takes a time O(N). The sign of t_n is the sign of
    (-1)^n prod_{j < n} A_j prod_{j >= n} B_j, a maximal minor of R. With this sign, t is
    continuous along a motion of the chain. Raises ValueError for periodic ends.

    >>> chain = Chain(number_of_rotors=10)
    >>> leaning_left = chain.uniform_state(-1)
    >>> mode = zero_mode(chain, leaning_left)
    >>> d = chain.lean_ratio
    >>> bool(np.isclose(abs(mode[0] / mode[1]), (1 + d) / (1 - d)))
    True
    """
    return _zero_mode_of(*_levers_of_free_chain(chain, angles))


def mode_centre(mode: Array) -> float:
    """Return the centre of a normalised mode, sum_n n t_n^2 [rotor spacings]."""
    return float(np.add.reduce(np.arange(len(mode)) * mode * mode))


def mode_towards_last(chain: Chain, angles: Array) -> Array:
    """Return the zero mode with the sign that moves the wall towards the last rotor [1], (N,).

    In a spinner, a motion along this mode increases the sum of h_n = r sin(phi_n). In a flipper,
    the result is `zero_mode` times the sign of (-1)^(N (N + 1) / 2) u^N A_0 B_{N-2}, with the
    levers A_0 and B_{N-2} of the edge rotors and u = `uprightness`. While the wall is reflected at
    an edge, the edge rotor swings through the line of its bar, and its lever changes its sign.
    There the result changes its sign relative to `zero_mode`, which is continuous along the
    motion.
    """
    first, second = _levers_of_free_chain(chain, angles)
    mode = _zero_mode_of(first, second)
    if chain.motion is Motion.SPINNER:
        return mode if float(np.cos(angles) @ mode) >= 0 else -mode
    # In a left-leaning flipper with d < 1, the result increases all theta_n. All levers A_n and
    # B_n of this flipper have the sign (-1)^(n+1), or the opposite sign if it is upside down.
    rotors = chain.number_of_rotors
    start = (-1) ** (rotors * (rotors + 1) // 2) * uprightness(angles) ** rotors
    return mode if start * np.sign(first[0]) * np.sign(second[-1]) >= 0 else -mode


def edge_mode(chain: Chain, angles: Array, edge: Edge, anywhere: bool = False) -> Array:
    """Return the normalised zero mode that moves the wall away from an edge [1], shape (N,).

    Raises ValueError if the centre of the mode is nearer to the other edge, unless `anywhere` is
    true.
    """
    return resolved_edge_mode(chain, angles, edge, anywhere)[1]


def resolved_edge_mode(
    chain: Chain, angles: Array, edge: Edge, anywhere: bool = False
) -> tuple[Edge, Array]:
    """Return the edge as FIRST or LAST, also for NEAREST, and the result of `edge_mode`."""
    mode = mode_towards_last(chain, angles)
    nearest = _nearest(mode)
    end = nearest if edge is Edge.NEAREST else edge
    if end is not nearest and not anywhere:
        raise ValueError(
            f'the centre of the zero mode is at rotor {mode_centre(mode):.1f} of 0 to '
            f'{chain.number_of_rotors - 1}, nearer the {nearest.value} edge than the '
            f'{end.value}; choose the {nearest.value} edge'
        )
    return end, mode if end is Edge.FIRST else -mode


def _levers_of_free_chain(chain: Chain, angles: Array) -> tuple[Array, Array]:
    """Return A_n l_n and B_n l_n [m^2], (springs,) each; ValueError for periodic ends."""
    if chain.periodic:
        raise ValueError(
            'a chain with periodic ends has as many springs as rotors and in general no zero '
            'mode; use free ends, or search for accidental modes with zero_modes'
        )
    horizontal, vertical = chain.positions(chain.check_angles(angles))
    h_left, h_right = horizontal[:-1], horizontal[1:]
    v_left, v_right = vertical[:-1], vertical[1:]
    across, up = chain.spacings + (h_right - h_left), v_right - v_left
    return h_left * up - v_left * across, v_right * across - h_right * up


def _zero_mode_of(first: Array, second: Array) -> Array:
    mode = np.ones(len(first) + 1)
    with np.errstate(all='ignore'):
        np.multiply.accumulate(-first / second, out=mode[1:])
    sizes = np.abs(mode)
    smallest, largest = np.minimum.reduce(sizes), np.maximum.reduce(sizes)
    if not 1 / _FAR_FROM_OVERFLOW < smallest <= largest < _FAR_FROM_OVERFLOW:
        first, second = _without_zeros(first), _without_zeros(second)
        mantissas, exponents = _cumulative_product(-first / second)
        mode = np.ldexp(mantissas, np.maximum(exponents - exponents.max(), -1100))
    mirrored = np.add.reduce(second < 0) % 2
    # np.linalg.norm would call BLAS. In long chains BLAS starts threads, which takes longer than
    # the sum.
    length = np.sqrt(np.add.reduce(mode * mode))
    return np.asarray(mode / (-length if mirrored else length))


def _cumulative_product(factors: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the products of the first 0, 1, ..., n factors as mantissas and exponents of 2."""
    mantissas, exponents = np.frexp(np.concatenate([[1.0], factors]))
    powers = np.cumsum(exponents, dtype=np.int64)
    products = np.empty_like(mantissas)
    carried, power = 1.0, 0
    for start in range(0, len(mantissas), _BLOCK):
        block = slice(start, start + _BLOCK)
        products[block] = carried * np.cumprod(mantissas[block])
        powers[block] += power
        carried, shift = np.frexp(products[block][-1])
        power += int(shift)
    mantissas, exponents = np.frexp(products)
    return mantissas, powers + exponents


def _without_zeros(lever: Array) -> Array:
    return np.where(np.abs(lever) < _VANISHING, _VANISHING, lever)


def _nearest(mode: Array) -> Edge:
    return Edge.FIRST if mode_centre(mode) <= (len(mode) - 1) / 2 else Edge.LAST
