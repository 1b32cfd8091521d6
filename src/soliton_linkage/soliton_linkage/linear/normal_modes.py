# SPDX-License-Identifier: Apache-2.0
"""Normal modes of small vibrations about any configuration with relaxed springs.

Let R be the rigidity matrix, I and k_e the diagonal matrices of the moments of inertia and the
stiffnesses, and B = k_e^(1/2) R I^(-1/2). The modes are the right singular vectors of B, and the
angular frequencies are its singular values. The rounding errors of these frequencies are about
1e-16 of the largest frequency. If the frequencies were computed from the eigenvalues of B^T B, the
errors would be 1e-8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigvalsh_tridiagonal, svd, svdvals

from soliton_linkage.linear.bands import check_frequencies
from soliton_linkage.linear.rigidity import rigidity_matrix, zero_mode
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain

_MOST_STRETCH = 1e-6
"""A spring counts as relaxed if its extension is at most this fraction of its rest length [1]. The
relative errors of the frequencies are then at most as large as this."""


@dataclass(frozen=True)
class NormalModes:
    """Frequencies and shapes of the normal modes of a chain of N rotors.

    frequencies: angular frequencies in ascending order [rad/s], shape (N,).
    shapes: changes of the angles in each mode [rad / (kg^(1/2) m)], shape (N, N), one mode per
        column. The columns are normalised, so that shapes^T diag(I) shapes is the unit matrix. The
        sign of each column is arbitrary.
    moments_of_inertia: moment of inertia I of each rotor about its pivot [kg m^2], shape (N,).
    """

    frequencies: Array
    shapes: Array
    moments_of_inertia: Array


def normal_modes(chain: Chain, angles: ArrayLike) -> NormalModes:
    """Return the normal modes about a configuration in which all springs are relaxed.

    With free ends, the zero mode is the first mode. The computing time is O(N^3). Raises
    ValueError if a spring is stretched.
    """
    matrix = _weighted_rigidity_matrix(chain, _relaxed(chain, angles))
    _, singular, rows = svd(matrix)
    frequencies = np.zeros(chain.number_of_rotors)
    frequencies[: len(singular)] = singular
    shapes = rows.T / np.sqrt(chain.moments_of_inertia)[:, None]
    return NormalModes(frequencies[::-1], shapes[:, ::-1], chain.moments_of_inertia)


def mode_frequencies(chain: Chain, angles: ArrayLike) -> Array:
    """Return the angular frequencies of `normal_modes` in ascending order [rad/s], shape (N,).

    With free ends, the frequencies are the eigenvalues >= 0 of [[0, B^T], [B, 0]]. If the rows are
    in the order rotor 0, spring 0, rotor 1 and so on, this matrix is tridiagonal. The computing
    time is therefore O(N^2). Raises ValueError if a spring is stretched.
    """
    relaxed = _relaxed(chain, angles)
    if chain.periodic:
        return np.asarray(svdvals(_weighted_rigidity_matrix(chain, relaxed))[::-1])
    _, first, second = chain.springs(relaxed)
    levers = np.sqrt(chain.stiffnesses) * np.stack([first, second])
    levers /= np.sqrt(np.stack([chain.moments_of_inertia[:-1], chain.moments_of_inertia[1:]]))
    between = levers.T.ravel()
    pairs = eigvalsh_tridiagonal(np.zeros(len(between) + 1), between, lapack_driver='sterf')
    frequencies = np.maximum(pairs[chain.number_of_springs :], 0.0)
    frequencies[0] = 0.0
    return np.asarray(frequencies)


def mode_density(frequencies: ArrayLike, edges: ArrayLike) -> Array:
    """Return a histogram of the mode frequencies [modes / rotor / (rad/s)], shape (bins,).

    The `edges` [rad/s] are the limits of the bins. For a long uniform chain, the value of a bin is
    the mean of `density_of_states` over the bin. Raises ValueError for frequencies that are
    negative or not finite, and for edges that do not increase.
    """
    counted, bounds = np.atleast_1d(np.asarray(frequencies, float)), np.asarray(edges, float)
    check_frequencies(counted)
    if not counted.size:
        raise ValueError('the density of 0 modes is undefined; give one frequency or more')
    ascending = bounds.ndim == 1 and len(bounds) > 1 and bool((np.diff(bounds) > 0).all())
    if not (ascending and np.isfinite(bounds).all()):
        raise ValueError(
            f'edges of bins = {np.array2string(bounds, threshold=6)} rad/s must be two or more '
            'finite numbers in ascending order'
        )
    return np.asarray(np.histogram(counted, bounds)[0] / (counted.size * np.diff(bounds)))


def mode_energies(modes: NormalModes, displacements: ArrayLike, rates: ArrayLike) -> Array:
    """Return the energy of each mode [J], E_j = (eta_j_dot^2 + omega_j^2 eta_j^2) / 2, (..., N).

    The mode coordinates are eta = shapes^T diag(I) dphi with the `displacements` dphi [rad],
    (..., N). In the same way, eta_dot follows from `rates` [rad/s]. Raises ValueError if the last
    axis of an array does not have the length N.
    """
    coordinates = _coordinates(modes, displacements, 'displacements')
    speeds = _coordinates(modes, rates, 'rates')
    return np.asarray(0.5 * (speeds**2 + (modes.frequencies * coordinates) ** 2))


def phonon_energies(chain: Chain, angles: ArrayLike, rates: ArrayLike) -> tuple[Array, Array]:
    """Return the frequencies [rad/s] and the energies [J] of all normal modes, shape (N,) each.

    The modes are vibrations about the relaxed configuration that `unstretched` finds near
    `angles`. The sum of the energies is the energy of the chain, up to terms of third order in the
    displacements from this configuration. With free ends, the first energy belongs to the zero
    mode; it is the kinetic energy that the wall would have in a chain of rigid bars. Raises
    ValueError for invalid angles [rad] or rates [rad/s], and if no relaxed configuration is near.
    """
    given = chain.check_angles(angles)
    relaxed = unstretched(chain, given)
    modes = normal_modes(chain, relaxed)
    energies = mode_energies(modes, given - relaxed, chain.check_angles(rates, 'rate'))
    return modes.frequencies, energies


def phonon_energy(chain: Chain, angles: ArrayLike, rates: ArrayLike) -> float:
    """Return the energy that is not in the zero mode [J]; the computing time is O(N).

    The energy is E = sum_n (k_e / 2) (R dphi)_n^2 + T(phi_dot - t (t^T I phi_dot) / (t^T I t)).
    Here dphi is the displacement from the relaxed configuration that `unstretched` finds, R is the
    rigidity matrix and t the zero mode of this configuration, I are the moments of inertia, and
    T(...) is the kinetic energy of rates. E is the sum of `phonon_energies` without the first
    energy. E includes the elastic energy of a moving wall. If there are several walls, only their
    common motion along t is excluded. With periodic ends, E is the total energy. Raises the same
    errors as `phonon_energies`.
    """
    given = chain.check_angles(angles)
    relaxed = unstretched(chain, given)
    left = chain.check_angles(rates, 'rate')
    if not chain.periodic:
        mode = zero_mode(chain, relaxed)
        momentum = chain.moments_of_inertia * mode
        left = left - mode * float(momentum @ left) / float(momentum @ mode)
    stretches = rigidity_matrix(chain, relaxed) @ (given - relaxed)
    return float(0.5 * chain.stiffnesses @ stretches**2 + chain.kinetic_energy(left))


def _relaxed(chain: Chain, angles: ArrayLike) -> Array:
    given = chain.check_angles(angles)
    stretches = np.abs(chain.spring_extensions(given)) / chain.rest_lengths
    spring = int(np.argmax(stretches))
    if stretches[spring] > _MOST_STRETCH:
        raise ValueError(
            f'spring {spring} is stretched by {stretches[spring]:.3g} of its rest length, more '
            f'than {_MOST_STRETCH:g}; give a configuration with relaxed springs, for example the '
            f'result of unstretched'
        )
    return given


def _weighted_rigidity_matrix(chain: Chain, angles: Array) -> Array:
    """Return B = k_e^(1/2) R I^(-1/2) of the module docstring [rad/s], shape (springs, N)."""
    matrix = rigidity_matrix(chain, angles).toarray()
    weighted = np.sqrt(chain.stiffnesses)[:, None] * matrix
    return np.asarray(weighted / np.sqrt(chain.moments_of_inertia))


def _coordinates(modes: NormalModes, values: ArrayLike, what: str) -> Array:
    given = np.asarray(values, dtype=np.float64)
    rotors = len(modes.moments_of_inertia)
    if given.shape[-1:] != (rotors,):
        raise ValueError(
            f'{what} of shape {given.shape} do not fit the modes of {rotors} rotors; give one '
            'number per rotor on the last axis'
        )
    return np.asarray((modes.moments_of_inertia * given) @ modes.shapes)
