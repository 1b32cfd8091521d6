# SPDX-License-Identifier: Apache-2.0
"""Linear theory of the uniform chain: phonons, speed of sound, zero mode, tails of walls.

Wave numbers k refer to the staggered angles, dtheta_n ~ e^(i k a n). The wave number of the angles
phi differs by pi / a, because dphi_n = (-1)^n dtheta_n. Quantities that tend to 0 in a limit are
computed without cancellation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soliton_linkage.linkage.chain import Array, Chain

ComplexArray = NDArray[np.complex128]


def couplings(chain: Chain, lean: int = 1) -> tuple[float, float]:
    """Return q+ and q- [m/rad] of the state that leans right (+1) or left (-1).

    q+- = r cos(theta_bar) (2 r sin(theta_bar) +- a) / lbar. In staggered angles dl_n = -(q+
    dtheta_n + q- dtheta_{n+1}) (paper, section 1, without the minus sign). In the left-leaning
    state q+ and -q- are exchanged. Raises ValueError for any other lean.
    """
    if lean not in (-1, 1):
        raise ValueError(f'lean = {lean!r} must be +1 (right) or -1 (left)')
    sine, cosine = lean * math.sin(chain.rest_angle), math.cos(chain.rest_angle)
    scale = chain.rotor_length * cosine / chain.rest_length
    lean_across = 2 * chain.rotor_length * sine
    return scale * (lean_across + chain.spacing), scale * (lean_across - chain.spacing)


def bloch_matrix(chain: Chain, wave_numbers: ArrayLike, lean: int = 1) -> ComplexArray:
    """Return the rigidity matrix R(k) of the cell of two rotors [m/rad], shape (..., 2, 2).

    R(k) = -[[q+, q-], [q- e^(2 i k a), q+]], with det R(k) = q+^2 - q-^2 e^(2 i k a). R(k) maps
    the amplitudes of the two staggered angles in a cell to the extensions of its two springs. Wave
    numbers [rad/m] may be complex. In the paper (section 1) the phase factor is in the lower right
    corner, which gives the winding number of the opposite lean. Raises ValueError for wave numbers
    that are not finite.
    """
    plus, minus = couplings(chain, lean)
    phases = _phases(chain, np.asarray(wave_numbers, dtype=np.complex128))
    matrix = np.empty((*phases.shape, 2, 2), dtype=np.complex128)
    matrix[..., 0, 0] = matrix[..., 1, 1] = -plus
    matrix[..., 0, 1] = -minus
    matrix[..., 1, 0] = -minus * np.exp(2j * phases)
    return matrix


def bloch_dynamical_matrix(chain: Chain, wave_numbers: ArrayLike, lean: int = 1) -> ComplexArray:
    """Return the dynamical matrix D(k) = k_e R(k)^dagger R(k) / (M r^2) [rad^2/s^2], (..., 2, 2).

    Its eigenvalues are the squared frequencies of both branches at real wave numbers [rad/m].
    Raises ValueError for wave numbers that are not finite.
    """
    matrix = bloch_matrix(chain, np.asarray(wave_numbers, dtype=np.float64), lean)
    matrix /= chain.rotor_length * chain.time_unit
    return np.asarray(np.conj(np.swapaxes(matrix, -1, -2)) @ matrix)


def dispersion(chain: Chain, wave_numbers: ArrayLike, branch: int = 1) -> Array:
    """Return the angular frequencies [rad/s] of phonons with given wave numbers [rad/m].

    omega(k) = sqrt(k_e / M) |q+ +- q- e^(i k a)| / r, with the plus sign for branch +1 and the
    minus sign for branch -1 (paper, section 1, without the factor 1/r). For k from -pi/a to pi/a
    each branch contains the whole spectrum. The code avoids cancellation by omega^2 = gap^2 +
    (2 c / a)^2 sin(k a / 2)^2 for branch +1 and d < 1 or branch -1 and d > 1, and the same with a
    cosine otherwise. Raises ValueError for another branch and for wave numbers that are not
    finite.
    """
    if branch not in (-1, 1):
        raise ValueError(f'branch = {branch!r} must be +1 or -1')
    halves = _phases(chain, np.asarray(wave_numbers, dtype=np.float64)) / 2
    lowest_at_0 = (chain.lean_ratio < 1) == (branch == 1)
    profile = np.sin(halves) if lowest_at_0 else np.cos(halves)
    return np.asarray(np.hypot(gap(chain), 2 * speed_of_sound(chain) / chain.spacing * profile))


def gap(chain: Chain) -> float:
    """Return the lowest angular frequency of any phonon [rad/s], sqrt(k_e / M) ||q+| - |q-|| / r.

    In units of sqrt(k_e / M) the gap is 2 r sin(2 theta_bar) / lbar for d < 1 and
    2 a cos(theta_bar) / lbar for d > 1. The paper (section 1) has r^2 sin(2 theta_bar) / lbar for
    any d.
    """
    return band_edges(chain)[0]


def band_edges(chain: Chain) -> tuple[float, float]:
    """Return the lowest and the highest angular frequency of the phonons [rad/s].

    They are sqrt(k_e / M) ||q+| -+ |q-|| / r. In units of sqrt(k_e / M) they are 2 cos(theta_bar)
    / lbar times the smaller and the larger of 2 r sin(theta_bar) and a. They are equal for d = 1.
    """
    scale = 2 * math.cos(chain.rest_angle) / (chain.rest_length * chain.time_unit)
    lean_across = 2 * chain.rotor_length * math.sin(chain.rest_angle)
    lower, upper = sorted((lean_across, chain.spacing))
    return scale * lower, scale * upper


def speed_of_sound(chain: Chain) -> float:
    """Return the speed c [m/s] in omega^2 = gap^2 + c^2 k^2, with k from the band minimum.

    c = a cos(theta_bar) sqrt(|4 r^2 sin(theta_bar)^2 - a^2|) / lbar sqrt(k_e / M)
    = a sqrt(|q+ q-|) / r sqrt(k_e / M) (paper, section 1). The minimum is at k = 0 for d < 1 and
    at pi/a for d > 1. All phonons are slower than c; see `largest_group_velocity`.
    """
    plus, minus = couplings(chain)
    return chain.spacing * math.sqrt(abs(plus * minus)) / (chain.rotor_length * chain.time_unit)


def largest_group_velocity(chain: Chain) -> float:
    """Return the largest d(omega)/dk of any phonon [m/s], a min(|q+|, |q-|) / r sqrt(k_e / M).

    The maximum is at |cos(k a)| = min(|q+|, |q-|) / max(|q+|, |q-|). It is smaller than the speed
    of sound.
    """
    slower = min(map(abs, couplings(chain)))
    return chain.spacing * slower / (chain.rotor_length * chain.time_unit)


def penetration_depth(chain: Chain) -> float:
    """Return the decay length of the zero mode [m], ell = a / ln|q+ / q-|; 0 for d = 1.

    ln|q+ / q-| = ln|(d + 1) / (d - 1)| = 2 artanh(min(d, 1/d)). For small d the depth is
    a / (2 d). In the paper (section 1) it is proportional to 1 / sin(theta_bar).

    >>> wide = Chain(rest_angle=0.1)
    >>> round(penetration_depth(wide) / wide.spacing, 2), round(1 / (2 * wide.lean_ratio), 2)
    (4.99, 5.01)
    """
    smaller = min(chain.lean_ratio, 1 / chain.lean_ratio)
    return chain.spacing / (2 * math.atanh(smaller)) if smaller < 1 else 0.0


def tail_ratio(chain: Chain) -> float:
    """Return the ratio of successive deviations in the tail of a wall, outer / inner [1].

    The ratio is q- / q+ = (d - 1) / (d + 1), for small deviations of the angles phi from a uniform
    state in a chain of relaxed bars.
    """
    plus, minus = couplings(chain)
    return minus / plus


@dataclass(frozen=True)
class Tail:
    """Decay of the deviation from a uniform state with the distance from a wall.

    decay_length: distance over which the deviation decreases by a factor of e [m].
    wave_number: wave number of the oscillation [rad/m]; 0 without sign changes.
    """

    decay_length: float
    wave_number: float


def exact_tail(chain: Chain) -> Tail:
    """Return the tail of the discrete chain, du_n ~ (-(d - 1) / (d + 1))^n.

    The decay length is the penetration depth ell = a / ln((d + 1) / |d - 1|). For d > 1 the
    deviation changes its sign at every rotor (wave number pi / a). This is the wobble of a
    wobbling flipper.
    """
    wave_number = math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0
    return Tail(penetration_depth(chain), wave_number)


def wobble_exponents(chain: Chain) -> tuple[complex, complex]:
    """Return lambda_+- = 1 / ub +- sqrt(1 / ub^2 - 8 / a^2) [1/m] of the tail e^(lambda x).

    They are the roots of (a^2 / 8) du'' - (a^2 / (4 ub)) du' + du = 0 about u = ub = r
    sin(theta_bar), on the side of the wall towards rotor 0. The equation is the second-order
    expansion of the bar length (paper, supporting information, eq. wobblingode with the opposite
    sign of the middle term).
    """
    inverse = 1 / (chain.rotor_length * math.sin(chain.rest_angle))
    square = (inverse - math.sqrt(8) / chain.spacing) * (inverse + math.sqrt(8) / chain.spacing)
    if square < 0:
        root = math.sqrt(-square)
        return complex(inverse, root), complex(inverse, -root)
    plus = inverse + math.sqrt(square)
    return complex(plus), complex(8 / chain.spacing**2 / plus)


def continuum_tail(chain: Chain) -> Tail:
    """Return the tail with the more slowly decaying exponent of `wobble_exponents`.

    For d > 1 / sqrt(2) this tail oscillates. Its decay length is ub, and its wave number tends to
    sqrt(8) / a. These are artefacts of the truncation, which `exact_tail` does not have. Both
    functions give the same decay length for d << 1, a^2 / (4 ub), and for d >> 1, ub.
    """
    plus, minus = wobble_exponents(chain)
    return Tail(1 / minus.real, plus.imag)


def zero_mode_wave_number(chain: Chain, lean: int = 1) -> complex:
    """Return the complex wave number k of the zero mode [rad/m], e^(i k a) = -q+ / q-.

    The imaginary part is -1 / ell for the right-leaning state (+1), whose mode grows towards the
    last edge, and 1 / ell for the left-leaning state (-1). The real part is 0 for d < 1 and
    pi / a for d > 1, where the sign of the mode alternates in staggered angles. The imaginary part
    is infinite for d = 1. The paper (section 1) prints sqrt(-omega_0) / c instead of
    i omega_0 / c, the limit of small d. Raises ValueError for any other lean.
    """
    plus, minus = couplings(chain, lean)
    depth = penetration_depth(chain)
    growth = math.copysign(1 / depth if depth else math.inf, abs(plus) - abs(minus))
    return complex(math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0, -growth)


def density_of_states(chain: Chain, frequencies: ArrayLike) -> Array:
    """Return the density of modes of an infinite chain [modes / rotor / (rad/s)], shape (...).

    g(omega) = 2 omega / (pi sqrt((omega^2 - lowest^2) (highest^2 - omega^2))) inside the band and
    0 outside. At the band edges it is infinite. Its integral is 1. For d = 1 the band is a single
    frequency. Raises ValueError for frequencies [rad/s] that are negative or not finite.
    """
    given = np.asarray(frequencies, dtype=np.float64)
    check_frequencies(given)
    lowest, highest = band_edges(chain)
    inside = (given >= lowest) & (given <= highest)
    above = np.where(inside, (given - lowest) * (given + lowest), 1.0)
    below = np.where(inside, (highest - given) * (highest + given), 1.0)
    with np.errstate(divide='ignore'):
        density = 2 * given / (np.pi * np.sqrt(above) * np.sqrt(below))
    return np.asarray(np.where(inside, density, 0.0))


def winding_number(chain: Chain, lean: int) -> int:
    """Return how often det R(k) winds around 0 while k crosses the Brillouin zone.

    The winding number is 1 in the left-leaning state (-1), whose zero mode is at the first edge,
    and 0 in the right-leaning state (+1), whose zero mode is at the last edge (paper, section 1).
    The determinant q+^2 - q-^2 e^(2 i k a) makes one turn on a circle of radius q-^2 about q+^2.
    Raises ValueError for any other lean.

    >>> [winding_number(Chain(), lean) for lean in (+1, -1)]
    [0, 1]
    """
    plus, minus = couplings(chain, lean)
    return int(abs(minus) > abs(plus))


def check_frequencies(frequencies: Array) -> None:
    """Raise ValueError for angular frequencies [rad/s] that are negative or not finite."""
    wrong = frequencies[~(np.isfinite(frequencies) & (frequencies >= 0))]
    if wrong.size:
        raise ValueError(
            f'frequency = {wrong[0]} rad/s must be a finite number of 0 or more; omit the sign, '
            f'because both signs mean the same mode'
        )


def _phases(chain: Chain, wave_numbers: NDArray[Any]) -> NDArray[Any]:
    """Return k a [rad]."""
    wrong = wave_numbers[~np.isfinite(wave_numbers)]
    if wrong.size:
        raise ValueError(
            f'wave number = {wrong[0]} rad/m must be a finite number; one zone reaches from '
            '-pi/a to pi/a'
        )
    return wave_numbers * chain.spacing
