# SPDX-License-Identifier: Apache-2.0
"""Linear theory of the uniform chain: phonons, speed of sound, zero mode, tails of walls.

Wave numbers k [rad/m] describe changes of the staggered angles, dtheta_n ~ e^(i k a n) with the
spacing a. In terms of the angles phi, the same motion has the wave number k + pi / a. The symbols
are the lean ratio d, the rotor length r, the mass M, the stiffness k_e, the rest length lbar and
the rest angle theta_bar. Functions raise ValueError if `lean` is neither +1 nor -1.
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

    Changes dtheta of the staggered angles lengthen spring n by
    dl_n = -(q+ dtheta_n + q- dtheta_{n+1}). In the right-leaning state,
    q+- = r cos(theta_bar) (2 r sin(theta_bar) +- a) / lbar. The paper (section 1) omits the minus
    sign in dl_n. The left-leaning state has -q- in place of q+, and -q+ in place of q-.
    """
    if lean not in (-1, 1):
        raise ValueError(f'lean = {lean!r} must be +1 (right) or -1 (left)')
    sine, cosine = lean * math.sin(chain.rest_angle), math.cos(chain.rest_angle)
    scale = chain.rotor_length * cosine / chain.rest_length
    lean_across = 2 * chain.rotor_length * sine
    return scale * (lean_across + chain.spacing), scale * (lean_across - chain.spacing)


def bloch_matrix(chain: Chain, wave_numbers: ArrayLike, lean: int = 1) -> ComplexArray:
    """Return the rigidity matrix R(k) of the cell of two rotors [m/rad], shape (..., 2, 2).

    R(k) maps changes of the staggered angles of the two rotors of a cell to the extensions of the
    two springs of the cell. With the results q+ and q- of `couplings`,
    R(k) = -[[q+, q-], [q- e^(2 i k a), q+]]. Wave numbers [rad/m] must be finite and may be
    complex. In the paper (section 1), the phase factor is in the lower right corner, which
    exchanges the winding numbers of the two states.
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

    Wave numbers k [rad/m] must be finite and real. The eigenvalues are the squared frequencies.
    """
    matrix = bloch_matrix(chain, np.asarray(wave_numbers, dtype=np.float64), lean)
    matrix /= chain.rotor_length * chain.time_unit
    return np.asarray(np.conj(np.swapaxes(matrix, -1, -2)) @ matrix)


def dispersion(chain: Chain, wave_numbers: ArrayLike, branch: int = 1) -> Array:
    """Return the angular frequencies [rad/s] of phonons with given finite wave numbers [rad/m].

    omega(k) = sqrt(k_e / M) |q+ +- q- e^(i k a)| / r, where `branch` (+1 or -1) is the sign +-.
    The paper (section 1) omits 1/r. Each branch alone contains all phonons if k runs from -pi / a
    to pi / a.
    """
    if branch not in (-1, 1):
        raise ValueError(f'branch = {branch!r} must be +1 or -1')
    halves = _phases(chain, np.asarray(wave_numbers, dtype=np.float64)) / 2
    lowest_at_0 = (chain.lean_ratio < 1) == (branch == 1)
    profile = np.sin(halves) if lowest_at_0 else np.cos(halves)
    return np.asarray(np.hypot(gap(chain), 2 * speed_of_sound(chain) / chain.spacing * profile))


def gap(chain: Chain) -> float:
    """Return the lowest angular frequency of the phonons, sqrt(k_e / M) ||q+| - |q-|| / r [rad/s].

    In units of sqrt(k_e / M) the gap is 2 r sin(2 theta_bar) / lbar for d < 1 and 2 a
    cos(theta_bar) / lbar for d > 1. The paper (section 1) has r^2 sin(2 theta_bar) / lbar.
    """
    return band_edges(chain)[0]


def band_edges(chain: Chain) -> tuple[float, float]:
    """Return the lowest and the highest angular frequency of the phonons [rad/s].

    The two frequencies are sqrt(k_e / M) ||q+| -+ |q-|| / r.
    """
    scale = 2 * math.cos(chain.rest_angle) / (chain.rest_length * chain.time_unit)
    lean_across = 2 * chain.rotor_length * math.sin(chain.rest_angle)
    lower, upper = sorted((lean_across, chain.spacing))
    return scale * lower, scale * upper


def speed_of_sound(chain: Chain) -> float:
    """Return the speed of sound c = a sqrt(|q+ q-|) sqrt(k_e / M) / r [m/s] (paper, section 1).

    Near the minimum of the band, which is at k_0 = 0 for d < 1 and at k_0 = pi / a for d > 1, the
    frequency omega satisfies omega^2 = gap^2 + c^2 (k - k_0)^2.
    """
    plus, minus = couplings(chain)
    return chain.spacing * math.sqrt(abs(plus * minus)) / (chain.rotor_length * chain.time_unit)


def largest_group_velocity(chain: Chain) -> float:
    """Return the largest d(omega)/dk of all phonons [m/s], a min(|q+|, |q-|) sqrt(k_e / M) / r."""
    slower = min(map(abs, couplings(chain)))
    return chain.spacing * slower / (chain.rotor_length * chain.time_unit)


def penetration_depth(chain: Chain) -> float:
    """Return the decay length of the zero mode [m], ell = a / ln|q+ / q-|; 0 for d = 1.

    The logarithm is 2 artanh(min(d, 1/d)) with the lean ratio d. The paper (section 1) has
    ell ~ 1 / sin(theta_bar). This agrees for small d, because ell then tends to a / (2 d):

    >>> wide = Chain(rest_angle=0.1)
    >>> round(penetration_depth(wide) / wide.spacing, 2), round(1 / (2 * wide.lean_ratio), 2)
    (4.99, 5.01)
    """
    smaller = min(chain.lean_ratio, 1 / chain.lean_ratio)
    return chain.spacing / (2 * math.atanh(smaller)) if smaller < 1 else 0.0


def tail_ratio(chain: Chain) -> float:
    """Return the ratio (d - 1) / (d + 1) of the tail of a wall at two neighbouring rotors [1].

    The tail is here the small difference between the angles phi and the angles in a uniform state.
    The ratio is the tail at the rotor farther from the wall, divided by the tail at the rotor
    nearer to the wall. The tail of the displacements in `exact_tail` has the ratio of opposite
    sign, because equal displacements of neighbouring masses need opposite changes of phi.
    """
    plus, minus = couplings(chain)
    return minus / plus


@dataclass(frozen=True)
class Tail:
    """Decay of the tail of a wall with the distance from the wall.

    The tail is here the displacement r sin(theta) of a mass minus its value in a uniform state.

    decay_length: distance over which the tail decreases by a factor of e [m].
    wave_number: wave number with which the sign of the tail oscillates [rad/m]; 0 if it does not.
    """

    decay_length: float
    wave_number: float


def exact_tail(chain: Chain) -> Tail:
    """Return the tail of a wall in the discrete chain.

    At the n-th rotor from the wall, the tail of the displacements is proportional to
    (-(d - 1) / (d + 1))^n. For d > 1, its sign alternates from rotor to rotor. This alternation is
    the wobble of a wobbling flipper.
    """
    wave_number = math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0
    return Tail(penetration_depth(chain), wave_number)


def wobble_exponents(chain: Chain) -> tuple[complex, complex]:
    """Return the two exponents lambda [1/m] of the tail e^(lambda x) in the continuum.

    The tail du(x) is the displacement minus ub = r sin(theta_bar), between rotor 0 and a kink,
    where the chain leans right. The exponents are lambda_+- = 1 / ub +- sqrt(1 / ub^2 - 8 / a^2).
    They follow from the equation (a^2 / 8) du'' - (a^2 / (4 ub)) du' + du = 0, which states that
    the bars keep their lengths, up to terms in du''. In the paper (equation `wobblingode`), the
    middle term has the opposite sign. On the other side of the kink, the exponents are -lambda_+-.
    """
    inverse = 1 / (chain.rotor_length * math.sin(chain.rest_angle))
    square = (inverse - math.sqrt(8) / chain.spacing) * (inverse + math.sqrt(8) / chain.spacing)
    if square < 0:
        root = math.sqrt(-square)
        return complex(inverse, root), complex(inverse, -root)
    plus = inverse + math.sqrt(square)
    return complex(plus), complex(8 / chain.spacing**2 / plus)


def continuum_tail(chain: Chain) -> Tail:
    """Return the tail e^(lambda x) for the one of the `wobble_exponents` that decays more slowly.

    For d > 1 / sqrt(2), the tail oscillates, with the decay length ub = r sin(theta_bar). This
    oscillation is an artefact of the continuum approximation. The decay length agrees with
    `exact_tail` for d << 1 and d >> 1.
    """
    plus, minus = wobble_exponents(chain)
    return Tail(1 / minus.real, plus.imag)


def zero_mode_wave_number(chain: Chain, lean: int = 1) -> complex:
    """Return the complex wave number k of the zero mode [rad/m], with e^(i k a) = -q+ / q-.

    The imaginary part is -1 / ell in the right-leaning and 1 / ell in the left-leaning state, with
    the penetration depth ell. The real part is 0 for d < 1 and pi / a for d > 1. For small d,
    1 / ell tends to omega_0 / c; the paper (section 1) has k = sqrt(-omega_0) / c.
    """
    plus, minus = couplings(chain, lean)
    depth = penetration_depth(chain)
    growth = math.copysign(1 / depth if depth else math.inf, abs(plus) - abs(minus))
    return complex(math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0, -growth)


def density_of_states(chain: Chain, frequencies: ArrayLike) -> Array:
    """Return the density of modes of an infinite chain [modes / rotor / (rad/s)], shape (...).

    Between the two `band_edges`, lowest and highest, the density is
    2 omega / (pi sqrt((omega^2 - lowest^2) (highest^2 - omega^2))). Outside the band, the density
    is 0. The integral of the density over all frequencies is 1. Raises ValueError for frequencies
    [rad/s] that are negative or not finite.
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
    """Return how often det R(k) of `bloch_matrix` winds around 0 along the Brillouin zone [1].

    The determinant is q+^2 - q-^2 e^(2 i k a). If the result is 1, the zero mode is at the first
    edge; if the result is 0, it is at the last edge (paper, section 1).

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
