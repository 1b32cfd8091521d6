# SPDX-License-Identifier: Apache-2.0
"""How the chain comes to its uniform state beside a wall: exactly, and in the continuum."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Chain


@dataclass(frozen=True)
class Tail:
    """How the deviation from a uniform state dies out away from a wall.

    decay_length: distance over which it falls by e [m].
    wave_number: of its oscillation [rad/m]; 0 where it does not change its sign.
    """

    decay_length: float
    wave_number: float


def exact_tail(chain: Chain) -> Tail:
    """Tail of the discrete chain: du_n ~ (-(d - 1) / (d + 1))^n away from the wall.

    Its decay length is the penetration depth ell = a / ln((d + 1) / |d - 1|); from d = 1 on it
    changes its sign at every rotor, wave number pi / a: the flipper wobbles.
    """
    wave_number = math.pi / chain.spacing if chain.lean_ratio > 1 else 0.0
    return Tail(penetration_depth(chain), wave_number)


def wobble_exponents(chain: Chain) -> tuple[complex, complex]:
    """Return lambda_+- = 1 / ub +- sqrt(1 / ub^2 - 8 / a^2) [1/m] of the tail e^(lambda x).

    Roots of (a^2 / 8) du'' - (a^2 / (4 ub)) du' + du = 0 about u = ub = r sin(theta_bar), on
    the side of rotor 0 of a wall: the bar's length expanded to second order (paper, supporting
    information, eq. wobblingode with the sign of its middle term that the chain has).
    """
    inverse = 1 / (chain.rotor_length * math.sin(chain.rest_angle))
    square = (inverse - math.sqrt(8) / chain.spacing) * (inverse + math.sqrt(8) / chain.spacing)
    if square < 0:
        root = math.sqrt(-square)
        return complex(inverse, root), complex(inverse, -root)
    plus = inverse + math.sqrt(square)
    return complex(plus), complex(8 / chain.spacing**2 / plus)


def continuum_tail(chain: Chain) -> Tail:
    """Tail by `wobble_exponents`, of which the one that decays more slowly is left.

    For d > 1 / sqrt(2) it decays over ub and oscillates, with a wave number that tends to
    sqrt(8) / a: artefacts of the truncation, of which `exact_tail` has none. Both agree on the
    decay length for d << 1, a^2 / (4 ub), and for d >> 1, ub.
    """
    plus, minus = wobble_exponents(chain)
    return Tail(1 / minus.real, plus.imag)
