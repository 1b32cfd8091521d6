# SPDX-License-Identifier: Apache-2.0
"""Linear theory of the uniform chain: phonons, speed of sound, zero mode, tails of walls.

Wave numbers k refer to the staggered angles, dtheta_n ~ e^(i k a n). The wave number of the angles
phi is different by pi / a, because dphi_n = (-1)^n dtheta_n. No result is computed as a difference
of nearly equal numbers.
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
    """Return the couplings q+ and q- of the right-leaning (+1) or left-leaning (-1) state [m/rad].

    In the right-leaning state q+- = r cos(theta_bar) (2 r sin(theta_bar) +- a) / lbar. In
    staggered angles, the length of spring n changes by dl_n = -(q+ dtheta_n + q- dtheta_{n+1});
    the paper (section 1) omits the minus sign. In the left-leaning state, -q- replaces q+, and -q+
    replaces q-. Raises ValueError for any other lean.
    """
    if lean not in (-1, 1):
        raise ValueError(f'lean = {lean!r} must be +1 (right) or -1 (left)')
    sine, cosine = lean * math.sin(chain.rest_angle), math.cos(chain.rest_angle)
    scale = chain.rotor_length * cosine / chain.rest_length
    lean_across = 2 * chain.rotor_length * sine
    return scale * (lean_across + chain.spacing), scale * (lean_across - chain.spacing)


def bloch_matrix(chain: Chain, wave_numbers: ArrayLike, lean: int = 1) -> ComplexArray:
    """Return the rigidity matrix R(k) of the cell of two rotors [m/rad], shape (..., 2, 2).

    R(k) maps the amplitudes of the two staggered angles in a cell to the extensions of the two
    springs of the cell. R(k) = -[[q+, q-], [q- e^(2 i k a), q+]], and det R(k) = q+^2 - q-^2
    e^(2 i k a). Wave numbers [rad/m] may be complex. In the paper (section 1) the phase factor is
    in the lower right corner. With that matrix, the winding number would be that of the opposite
    lean. Raises ValueError for wave numbers that are not finite.
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

    The eigenvalues of D(k) are the squared angular frequencies of the two branches. Wave numbers
    [rad/m] are real. Raises ValueError for wave numbers that are not finite.
    """
    matrix = bloch_matrix(chain, np.asarray(wave_numbers, dtype=np.float64), lean)
    matrix /= chain.rotor_length * chain.time_unit
    return np.asarray(np.conj(np.swapaxes(matrix, -1, -2)) @ matrix)


def dispersion(chain: Chain, wave_numbers: ArrayLike, branch: int = 1) -> Array:
    """Return the angular frequencies [rad/s] of phonons with given wave numbers [rad/m].

    omega(k) = sqrt(k_e / M) |q+ +- q- e^(i k a)| / r, with the plus sign for branch +1 and the
    minus sign for branch -1; the paper (section 1) omits the factor 1/r. For k from -pi/a to pi/a
    each branch contains the whole spectrum. To avoid cancellation, the code uses the equivalent
    form omega^2 = gap^2 + (2 c / a)^2 sin(k a / 2)^2 if the branch is +1 and d < 1, or if the
    branch is -1 and d > 1. In the other two cases a cosine replaces the sine. Raises ValueError
    for any other branch and for wave numbers that are not finite.
    """
    if branch not in (-1, 1):
        raise ValueError(f'branch = {branch!r} must be +1 or -1')
    halves = _phases(chain, np.asarray(wave_numbers, dtype=np.float64)) / 2
    lowest_at_0 = (chain.lean_ratio < 1) == (branch == 1)
    profile = np.sin(halves) if lowest_at_0 else np.cos(halves)
    return np.asarray(np.hypot(gap(chain), 2 * speed_of_sound(chain) / chain.spacing * profile))


def gap(chain: Chain) -> float:
    """Return the lowest angular frequency of any phonon [rad/s], sqrt(k_e / M) ||q+| - |q-|| / r.

    In units of sqrt(k_e / M) the gap is 2 r sin(2 theta_bar) / lbar for d < 1, and
    2 a cos(theta_bar) / lbar for d > 1. The paper (section 1) has a different expression, r^2
    sin(2 theta_bar) / lbar, for all d.
    """
    return band_edges(chain)[0]


def band_edges(chain: Chain) -> tuple[float, float]:
    """Return the lowest and the highest angular frequency of the phonons [rad/s].

    The band edges are sqrt(k_e / M) ||q+| -+ |q-|| / r. In units of sqrt(k_e / M) they are 2
    cos(theta_bar) / lbar, multiplied by 2 r sin(theta_bar) for one edge and by a for the other.
    They are equal for d = 1.
    """
    scale = 2 * math.cos(chain.rest_angle) / (chain.rest_length * chain.time_unit)
    lean_across = 2 * chain.rotor_length * math.sin(chain.rest_angle)
    lower, upper = sorted((lean_across, chain.spacing))
    return scale * lower, scale * upper


def speed_of_sound(chain: Chain) -> float:
    """Return the speed of sound c [m/s], defined by omega^2 = gap^2 + c^2 k^2.

    Here k is the wave number relative to the band minimum, which is at 0 for d < 1 and at pi/a for
    d > 1. The speed is c = a sqrt(|q+ q-|) / r sqrt(k_e / M) (paper, section 1), which equals
    a cos(theta_bar) sqrt(|4 r^2 sin(theta_bar)^2 - a^2|) / lbar sqrt(k_e / M). The group
    velocities of all phonons are below c; see `largest_group_velocity`.
    """
    plus, minus = couplings(chain)
    return chain.spacing * math.sqrt(abs(plus * minus)) / (chain.rotor_length * chain.time_unit)


def largest_group_velocity(chain: Chain) -> float:
    """Return the largest d(omega)/dk of any phonon [m/s], a min(|q+|, |q-|) / r sqrt(k_e / M).

    The phonon with this group velocity has |cos(k a)| = min(|q+|, |q-|) / max(|q+|, |q-|). The
    group velocity is smaller than the speed of sound.
    """
    slower = min(map(abs, couplings(chain)))
    return chain.spacing * slower / (chain.rotor_length * chain.time_unit)


def penetration_depth(chain: Chain) -> float:
    """Return the decay length of the zero mode [m], ell = a / ln|q+ / q-|; 0 for d = 1.

    It is computed by ln|q+ / q-| = ln|(d + 1) / (d - 1)| = 2 artanh(min(d, 1/d)). For small d the
    decay length is a / (2 d). In the paper (section 1) it is proportional to 1 / sin(theta_bar).

    >>> wide = Chain(rest_angle=0.1)
    >>> round(penetration_depth(wide) / wide.spacing, 2), round(1 / (2 * wide.lean_ratio), 2)
    (4.99, 5.01)
    """
    smaller = min(chain.lean_ratio, 1 / chain.lean_ratio)
    return chain.spacing / (2 * math.atanh(smaller)) if smaller < 1 else 0.0


def tail_ratio(chain: Chain) -> float:
    """Return the ratio by which the tail of a wall decays from one rotor to the next [1].

    The tail is the small difference of the angles phi from a uniform state in a chain with relaxed
    springs. The ratio of the differences of two neighbours, with the rotor farther from the wall
    in the numerator, is q- / q+ = (d - 1) / (d + 1).
    """
    plus, minus = couplings(chain)
    return minus / plus


@dataclass(frozen=True)
class Tail:
    """Decay of the displacement from a uniform state with the distance from a wall.

    decay_length: distance in which the displacement decreases by a factor of e [m].
    wave_number: wave number of the oscillation of the sign [rad/m]; 0 if the sign is constant.
    """

    decay_length: float
    wave_number: float


def exact_tail(chain: Chain) -> Tail:
    """Return the tail of a wall in the discrete chain, du_n ~ (-(d - 1) / (d + 1))^n.

    The decay length is the penetration depth ell = a / ln((d + 1) / |d - 1|). For d > 1 the
    displacement du_n from the uniform state changes its sign from rotor to rotor, so that the wave
    number is pi / a. These alternating signs are the wobble of a wobbling flipper.
    """
    wave_number = math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0
    return Tail(penetration_depth(chain), wave_number)


def wobble_exponents(chain: Chain) -> tuple[complex, complex]:
    """Return the two exponents lambda [1/m] of the tail e^(lambda x) in the continuum.

    The exponents are lambda_+- = 1 / ub +- sqrt(1 / ub^2 - 8 / a^2) with ub = r sin(theta_bar).
    They belong to the solutions of (a^2 / 8) du'' - (a^2 / (4 ub)) du' + du = 0 for small
    displacements du from u = ub, on the side of a wall towards rotor 0. The equation is the
    second-order expansion of the bar length. In the paper (supporting information, eq.
    wobblingode) the middle term has the opposite sign.
    """
    inverse = 1 / (chain.rotor_length * math.sin(chain.rest_angle))
    square = (inverse - math.sqrt(8) / chain.spacing) * (inverse + math.sqrt(8) / chain.spacing)
    if square < 0:
        root = math.sqrt(-square)
        return complex(inverse, root), complex(inverse, -root)
    plus = inverse + math.sqrt(square)
    return complex(plus), complex(8 / chain.spacing**2 / plus)


def continuum_tail(chain: Chain) -> Tail:
    """Return the tail with that exponent of `wobble_exponents` which decays more slowly.

    For d > 1 / sqrt(2) this tail oscillates. Its decay length is ub, and for large d its wave
    number tends to sqrt(8) / a. Both are artefacts of the truncated expansion; `exact_tail`
    returns the true values. The two functions agree on the decay length in two limits: a^2 / (4
    ub) for d << 1, and ub for d >> 1.
    """
    plus, minus = wobble_exponents(chain)
    return Tail(1 / minus.real, plus.imag)


def zero_mode_wave_number(chain: Chain, lean: int = 1) -> complex:
    """Return the complex wave number k of the zero mode [rad/m], e^(i k a) = -q+ / q-.

    The imaginary part is -1 / ell for the right-leaning state (+1), in which the mode grows
    towards the last edge. It is 1 / ell for the left-leaning state (-1), and infinite for d = 1.
    The real part is 0 for d < 1. For d > 1 it is pi / a, because the sign of the mode alternates
    in staggered angles. For small d the wave number tends to i omega_0 / c; the paper (section 1)
    has sqrt(-omega_0) / c instead. Raises ValueError for any other lean.
    """
    plus, minus = couplings(chain, lean)
    depth = penetration_depth(chain)
    growth = math.copysign(1 / depth if depth else math.inf, abs(plus) - abs(minus))
    return complex(math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0, -growth)


def density_of_states(chain: Chain, frequencies: ArrayLike) -> Array:
    """Return the density of modes of an infinite chain [modes / rotor / (rad/s)], shape (...).

    The density is g(omega) = 2 omega / (pi sqrt((omega^2 - lowest^2) (highest^2 - omega^2)))
    inside the band, infinite at the band edges, and 0 outside. Its integral over all frequencies
    is 1. For d = 1 the band is a single frequency. Raises ValueError for frequencies [rad/s] that
    are negative or not finite.
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

    The determinant q+^2 - q-^2 e^(2 i k a) runs once along a circle of radius q-^2 about q+^2. In
    the left-leaning state (-1) the circle contains 0, so that the winding number is 1; the zero
    mode is then at the first edge. In the right-leaning state (+1) the winding number is 0, and
    the zero mode is at the last edge (paper, section 1). Raises ValueError for any other lean.

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
    """Return k a [rad]; raise ValueError for wave numbers that are not finite."""
    wrong = wave_numbers[~np.isfinite(wave_numbers)]
    if wrong.size:
        raise ValueError(
            f'wave number = {wrong[0]} rad/m must be a finite number; one zone reaches from '
            '-pi/a to pi/a'
        )
    return wave_numbers * chain.spacing
