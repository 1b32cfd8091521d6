# SPDX-License-Identifier: Apache-2.0
"""Linear theory of the uniform chain: dispersion, gap and topological polarisation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.chain import Array, Chain


def couplings(chain: Chain, lean: int = 1) -> tuple[float, float]:
    """Return q+ and q- [m/rad] of the state that leans right (+1) or left (-1).

    q+- = r cos(theta_bar) (2 r sin(theta_bar) +- a) / lbar, and in staggered angles
    dl_n = -(q+ dtheta_n + q- dtheta_{n+1}). Leaning left exchanges q+ with -q-.
    """
    sine, cosine = lean * math.sin(chain.rest_angle), math.cos(chain.rest_angle)
    scale = chain.rotor_length * cosine / chain.rest_length
    lean_across = 2 * chain.rotor_length * sine
    return scale * (lean_across + chain.spacing), scale * (lean_across - chain.spacing)


def dispersion(chain: Chain, wave_numbers: ArrayLike, branch: int = 1) -> Array:
    """Angular frequencies [rad/s] of phonons with the given wave numbers [rad/m].

    omega(k) = sqrt(k_e / M) |q+ +- q- e^(i k a)| / r, the upper sign for branch +1, the lower
    for -1 (paper, section 1, with the factor 1/r that it leaves out). In staggered angles and
    with k from -pi/a to pi/a one branch alone is the whole spectrum.
    """
    if branch not in (-1, 1):
        raise ValueError(f'branch = {branch!r} must be +1 or -1')
    plus, minus = couplings(chain)
    phase = np.exp(1j * np.asarray(wave_numbers, dtype=np.float64) * chain.spacing)
    return np.asarray(np.abs(plus + branch * minus * phase)) / (
        chain.rotor_length * chain.time_unit
    )


def gap(chain: Chain) -> float:
    """Lowest angular frequency of any phonon [rad/s], sqrt(k_e / M) ||q+| - |q-|| / r.

    That is 2 r sin(2 theta_bar) / lbar for d < 1 and 2 a cos(theta_bar) / lbar for d > 1, in
    units of sqrt(k_e / M).
    """
    plus, minus = couplings(chain)
    return abs(abs(plus) - abs(minus)) / (chain.rotor_length * chain.time_unit)


def penetration_depth(chain: Chain) -> float:
    """Decay length of the zero mode from its edge [m], ell = a / ln|q+ / q-|; 0 for d = 1."""
    plus, minus = couplings(chain)
    return chain.spacing / math.log(abs(plus / minus)) if minus else 0.0


def winding_number(chain: Chain, lean: int) -> int:
    """Turns of det R(k) = q+^2 - q-^2 e^(2 i k a) about 0 across the zone of two-rotor cells.

    1 in the left-leaning state (-1), whose zero mode sits at the first edge; 0 in the
    right-leaning one (+1), whose zero mode sits at the last (paper, section 1). The determinant
    runs once along a circle about q+^2 of radius q-^2.
    """
    plus, minus = couplings(chain, lean)
    return int(abs(minus) > abs(plus))
