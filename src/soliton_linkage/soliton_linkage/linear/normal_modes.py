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
from scipy.linalg import svd

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
    """

    frequencies: Array
    shapes: Array


def normal_modes(chain: Chain, angles: ArrayLike) -> NormalModes:
    """Return the normal modes about a configuration in which all springs are relaxed.

    With free ends, the zero mode is the first mode. The computing time is O(N^3). Raises
    ValueError if a spring is stretched.
    """
    given = chain.check_angles(angles)
    stretches = np.abs(chain.spring_extensions(given)) / chain.rest_lengths
    spring = int(np.argmax(stretches))
    if stretches[spring] > _MOST_STRETCH:
        raise ValueError(
            f'spring {spring} is stretched by {stretches[spring]:.3g} of its rest length, more '
            f'than {_MOST_STRETCH:g}; give a configuration with relaxed springs, for example the '
            f'result of unstretched'
        )
    roots = np.sqrt(chain.moments_of_inertia)
    matrix = np.sqrt(chain.stiffnesses)[:, None] * rigidity_matrix(chain, given).toarray() / roots
    _, singular, rows = svd(matrix)
    frequencies = np.zeros(chain.number_of_rotors)
    frequencies[: len(singular)] = singular
    shapes = rows.T / roots[:, None]
    return NormalModes(frequencies[::-1], shapes[:, ::-1])


def phonon_energy(chain: Chain, angles: ArrayLike, rates: ArrayLike) -> float:
    """Return the energy that is not in the zero mode [J]; the computing time is O(N).

    The energy is E = sum_n (k_e / 2) (R dphi)_n^2 + T(phi_dot - t (t^T I phi_dot) / (t^T I t)).
    Here dphi is the displacement from the relaxed configuration that `unstretched` finds, R is the
    rigidity matrix and t the zero mode of this configuration, I are the moments of inertia, and
    T(...) is the kinetic energy of rates. E is the sum of the energies of all `normal_modes`
    without the zero mode. E includes the elastic energy of a moving wall. If there are several
    walls, only their common motion along t is excluded. With periodic ends, E is the total energy.
    Raises ValueError for invalid angles [rad] or rates [rad/s], and if no relaxed configuration is
    near.
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
