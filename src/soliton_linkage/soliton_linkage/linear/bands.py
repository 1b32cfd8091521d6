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

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.linkage.chain import Array, Chain


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


def dispersion(chain: Chain, wave_numbers: ArrayLike, branch: int = 1) -> Array:
    """Return the angular frequencies [rad/s] of phonons with given finite wave numbers [rad/m].

    omega(k) = sqrt(k_e / M) |q+ +- q- e^(i k a)| / r, where `branch` (+1 or -1) is the sign +-.
    The paper (section 1) omits 1/r. Each branch alone contains all phonons if k runs from -pi / a
    to pi / a.
    """
    if branch not in (-1, 1):
        raise ValueError(f'branch = {branch!r} must be +1 or -1')
    given = np.asarray(wave_numbers, dtype=np.float64)
    wrong = given[~np.isfinite(given)]
    if wrong.size:
        raise ValueError(
            f'wave number = {wrong[0]} rad/m must be a finite number; one zone reaches from '
            '-pi/a to pi/a'
        )
    halves = given * chain.spacing / 2
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


def winding_number(chain: Chain, lean: int) -> int:
    """Return how often det R(k) winds around 0 along the Brillouin zone [1].

    The rigidity matrix R(k) of a cell of two rotors has the determinant q+^2 - q-^2 e^(2 i k a).
    In the paper (section 1), the phase factor is in another corner of R, which exchanges the
    winding numbers of the two states. If the result is 1, the zero mode is at the first edge; if
    the result is 0, it is at the last edge.

    >>> [winding_number(Chain(), lean) for lean in (+1, -1)]
    [0, 1]
    """
    plus, minus = couplings(chain, lean)
    return int(abs(minus) > abs(plus))
