# SPDX-License-Identifier: Apache-2.0
"""Topological charge of fields and configurations, and the half turns that spinners make."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from soliton_linkage.linkage.chain import Chain, Motion, staggered
from soliton_linkage.solitons.tanh_fit import DOMAIN, polarisation


def charge_of_field(displacements: ArrayLike, lean: float) -> float:
    """Topological charge of a field u(x) [m], Q = [u(-inf) - u(+inf)] / (2 ub), shape (K,).

    Of opposite sign to the paper's (eq. soliton_charge), so that the wall that is free at rest
    has Q = +1. Raises ValueError for a lean ub [m] that is not positive.
    """
    if not (math.isfinite(lean) and lean > 0):
        raise ValueError(f'lean = {lean} m must be a finite number above 0')
    field = np.asarray(displacements, dtype=np.float64)
    return float(field[0] - field[-1]) / (2 * lean)


def topological_charge(chain: Chain, angles: ArrayLike) -> int:
    """Walls of charge +1 less those of -1 in a configuration: 1, 0 or -1.

    Half the difference of the polarisations of the first and the last domain; a chain with
    periodic ends, where they are the same, has 0.
    """
    if chain.periodic:
        chain.check_angles(angles)
        return 0
    polarised = polarisation(chain, chain.check_angles(angles))
    signs = np.sign(polarised[np.abs(polarised) > DOMAIN])
    return int(signs[0] - signs[-1]) // 2 if len(signs) else 0


def half_turns(chain: Chain, angles: ArrayLike) -> int:
    """Half turns by which a spinner's last rotor is ahead of its first.

    A wall of charge Q that turns its rotors forwards counts Q, one that turns them backwards -Q.
    Neighbours are less than half a turn apart from how they are in a uniform state, so that
    whole turns that a rotor's angle has beside its neighbour's mean nothing. Raises ValueError
    for a flipper.
    """
    if chain.motion is not Motion.SPINNER:
        raise ValueError(f'a {chain.motion.value} does not turn; count the turns of a spinner')
    checked = chain.check_angles(angles)
    theta = staggered(checked)
    family = 1 if np.sin(theta[:-1] + theta[1:]).sum() > 0 else -1
    steps = np.diff(checked - chain.uniform_state(family)) / (2 * np.pi)
    return round(2 * float(np.sum(steps - np.round(steps))))
