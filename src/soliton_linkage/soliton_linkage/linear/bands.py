# SPDX-License-Identifier: Apache-2.0
"""Linear theory of the uniform chain: phonons, speed of sound, zero mode, tails of walls.

Wave numbers k [rad/m] refer to staggered angles, dtheta_n ~ e^(i k a n) with the spacing a. For
the angles phi, they differ by pi / a. d is the lean ratio, r the rotor length, M the mass, k_e the
stiffness, lbar the rest length and theta_bar the rest angle. Another `lean` than +1 or -1 raises
ValueError.
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

    A spring lengthens by dl_n = -(q+ dtheta_n + q- dtheta_{n+1}). In the right-leaning state q+- =
    r cos(theta_bar) (2 r sin(theta_bar) +- a) / lbar; the paper (section 1) omits the minus sign
    of dl_n. In the left-leaning state -q- replaces q+, and -q+ replaces q-.
    """
    if lean not in (-1, 1):
        raise ValueError(f'lean = {lean!r} must be +1 (right) or -1 (left)')
    sine, cosine = lean * math.sin(chain.rest_angle), math.cos(chain.rest_angle)
    scale = chain.rotor_length * cosine / chain.rest_length
    lean_across = 2 * chain.rotor_length * sine
    return scale * (lean_across + chain.spacing), scale * (lean_across - chain.spacing)


def bloch_matrix(chain: Chain, wave_numbers: ArrayLike, lean: int = 1) -> ComplexArray:
    """Return the rigidity matrix R(k) of the cell of two rotors [m/rad], shape (..., 2, 2).

    R(k) = -[[q+, q-], [q- e^(2 i k a), q+]] maps the staggered angles of a cell to its extensions.
    Wave numbers [rad/m] are finite and may be complex. In the paper (section 1), the phase factor
    is in the lower right corner. This exchanges the winding numbers of the two leans.
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

    The eigenvalues of D(k) are the squared frequencies of the two branches at finite real k
    [rad/m].
    """
    matrix = bloch_matrix(chain, np.asarray(wave_numbers, dtype=np.float64), lean)
    matrix /= chain.rotor_length * chain.time_unit
    return np.asarray(np.conj(np.swapaxes(matrix, -1, -2)) @ matrix)


def dispersion(chain: Chain, wave_numbers: ArrayLike, branch: int = 1) -> Array:
    """Return the angular frequencies [rad/s] of phonons with given finite wave numbers [rad/m].

    omega(k) = sqrt(k_e / M) |q+ +- q- e^(i k a)| / r with the sign `branch`; the paper (section 1)
    omits 1/r. Each branch contains the whole spectrum. To avoid cancellation, the code uses
    omega^2 = gap^2 + (2 c / a)^2 sin(k a / 2)^2, with a cosine if the minimum is at pi / a.
    """
    if branch not in (-1, 1):
        raise ValueError(f'branch = {branch!r} must be +1 or -1')
    halves = _phases(chain, np.asarray(wave_numbers, dtype=np.float64)) / 2
    lowest_at_0 = (chain.lean_ratio < 1) == (branch == 1)
    profile = np.sin(halves) if lowest_at_0 else np.cos(halves)
    return np.asarray(np.hypot(gap(chain), 2 * speed_of_sound(chain) / chain.spacing * profile))


def gap(chain: Chain) -> float:
    """Return the lowest angular frequency of a phonon [rad/s], sqrt(k_e / M) ||q+| - |q-|| / r.

    In units of sqrt(k_e / M) the gap is 2 r sin(2 theta_bar) / lbar for d < 1 and 2 a
    cos(theta_bar) / lbar for d > 1. The paper (section 1) has r^2 sin(2 theta_bar) / lbar for all
    d.
    """
    return band_edges(chain)[0]


def band_edges(chain: Chain) -> tuple[float, float]:
    """Return lowest and highest frequency of phonons [rad/s], sqrt(k_e / M) ||q+| -+ |q-|| / r."""
    scale = 2 * math.cos(chain.rest_angle) / (chain.rest_length * chain.time_unit)
    lean_across = 2 * chain.rotor_length * math.sin(chain.rest_angle)
    lower, upper = sorted((lean_across, chain.spacing))
    return scale * lower, scale * upper


def speed_of_sound(chain: Chain) -> float:
    """Return c = a sqrt(|q+ q-|) / r sqrt(k_e / M) [m/s] (paper, section 1).

    Near the band minimum, omega^2 = gap^2 + c^2 k^2. Here k is counted from the minimum, which is
    at 0 for d < 1 and at pi / a for d > 1.
    """
    plus, minus = couplings(chain)
    return chain.spacing * math.sqrt(abs(plus * minus)) / (chain.rotor_length * chain.time_unit)


def largest_group_velocity(chain: Chain) -> float:
    """Return the largest d(omega)/dk of any phonon [m/s], a min(|q+|, |q-|) / r sqrt(k_e / M)."""
    slower = min(map(abs, couplings(chain)))
    return chain.spacing * slower / (chain.rotor_length * chain.time_unit)


def penetration_depth(chain: Chain) -> float:
    """Return the decay length of the zero mode [m], ell = a / ln|q+ / q-|; 0 for d = 1.

    The logarithm is 2 artanh(min(d, 1/d)) with the lean ratio d. The paper (section 1) has ell ~ 1
    / sin(theta_bar).

    >>> wide = Chain(rest_angle=0.1)
    >>> round(penetration_depth(wide) / wide.spacing, 2), round(1 / (2 * wide.lean_ratio), 2)
    (4.99, 5.01)
    """
    smaller = min(chain.lean_ratio, 1 / chain.lean_ratio)
    return chain.spacing / (2 * math.atanh(smaller)) if smaller < 1 else 0.0


def tail_ratio(chain: Chain) -> float:
    """Return the ratio of the tails of a wall at neighbouring rotors, (d - 1) / (d + 1) [1].

    The tail is the small difference of phi from a uniform state. The numerator belongs to the
    rotor farther from the wall.
    """
    plus, minus = couplings(chain)
    return minus / plus


@dataclass(frozen=True)
class Tail:
    """Decay of the displacement from a uniform state with the distance from a wall.

    decay_length: distance over which the displacement decreases by a factor of e [m].
    wave_number: wave number of the oscillation of the sign [rad/m]; 0 if the sign is constant.
    """

    decay_length: float
    wave_number: float


def exact_tail(chain: Chain) -> Tail:
    """Return the tail of a wall in the discrete chain, (-(d - 1) / (d + 1))^n at rotor n.

    For a lean ratio d > 1, the signs alternate; this is the wobble of a wobbling flipper.
    """
    wave_number = math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0
    return Tail(penetration_depth(chain), wave_number)


def wobble_exponents(chain: Chain) -> tuple[complex, complex]:
    """Return the two exponents lambda [1/m] of the tail e^(lambda x) in the continuum.

    The exponents lambda_+- = 1 / ub +- sqrt(1 / ub^2 - 8 / a^2), ub = r sin(theta_bar), solve (a^2
    / 8) du'' - (a^2 / (4 ub)) du' + du = 0. This equation is the second-order expansion of the bar
    length on the side of rotor 0. In the paper (supporting information, eq. wobblingode), the
    middle term has the opposite sign.
    """
    inverse = 1 / (chain.rotor_length * math.sin(chain.rest_angle))
    square = (inverse - math.sqrt(8) / chain.spacing) * (inverse + math.sqrt(8) / chain.spacing)
    if square < 0:
        root = math.sqrt(-square)
        return complex(inverse, root), complex(inverse, -root)
    plus = inverse + math.sqrt(square)
    return complex(plus), complex(8 / chain.spacing**2 / plus)


def continuum_tail(chain: Chain) -> Tail:
    """Return the tail with the exponent, of the two `wobble_exponents`, that decays more slowly.

    For d > 1 / sqrt(2), the tail oscillates, with the decay length ub and a wave number up to
    sqrt(8) / a. The oscillation is an artefact of the expansion. The decay length agrees with
    `exact_tail` for d << 1 and d >> 1.
    """
    plus, minus = wobble_exponents(chain)
    return Tail(1 / minus.real, plus.imag)


def zero_mode_wave_number(chain: Chain, lean: int = 1) -> complex:
    """Return the complex wave number k of the zero mode [rad/m], e^(i k a) = -q+ / q-.

    With the penetration depth ell, the imaginary part is -1 / ell for the right-leaning and 1 /
    ell for the left-leaning state. The real part is 0 for d < 1 and pi / a for d > 1. For small d,
    k tends to i omega_0 / c with the gap omega_0; the paper (section 1) has sqrt(-omega_0) / c.
    """
    plus, minus = couplings(chain, lean)
    depth = penetration_depth(chain)
    growth = math.copysign(1 / depth if depth else math.inf, abs(plus) - abs(minus))
    return complex(math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0, -growth)


def density_of_states(chain: Chain, frequencies: ArrayLike) -> Array:
    """Return the density of modes of an infinite chain [modes / rotor / (rad/s)], shape (...).

    Between the band edges `lowest` and `highest`, the density is g(omega) = 2 omega / (pi
    sqrt((omega^2 - lowest^2) (highest^2 - omega^2))). The integral of the density is 1. Raises
    ValueError for frequencies [rad/s] that are negative or not finite.
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
    """Return how often det R(k) winds around 0 as k passes through the Brillouin zone [1].

    In the left-leaning state, the determinant q+^2 - q-^2 e^(2 i k a) winds once, and the zero
    mode is at the first edge. In the right-leaning state it does not wind, and the zero mode is at
    the last edge (paper, section 1).

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
    wrong = wave_numbers[~np.isfinite(wave_numbers)]
    if wrong.size:
        raise ValueError(
            f'wave number = {wrong[0]} rad/m must be a finite number; one zone reaches from '
            '-pi/a to pi/a'
        )
    return wave_numbers * chain.spacing
