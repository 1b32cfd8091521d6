# SPDX-License-Identifier: Apache-2.0
"""States of motion to start a chain from."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain


@dataclass(frozen=True)
class State:
    """Where the rotors are and how they move."""

    angles: Array
    """Actual angles [rad], shape (N,)."""
    rates: Array
    """Their rates [rad/s], shape (N,)."""


def leaning(chain: Chain, lean: int) -> State:
    """At rest near the uniform state that leans right (+1) or left (-1), every spring relaxed.

    Where deviations leave no such state the springs are in balance. Raises ValueError where
    there is none of that either.
    """
    # What only passes states on needs no scipy.
    from soliton_linkage.linear.statics import equilibrium, rest_state

    try:
        angles = rest_state(chain, lean)
    except ValueError:
        angles = equilibrium(chain, chain.uniform_state(lean))
    return State(angles, np.zeros_like(angles))


def with_soliton(chain: Chain, place: float, velocity: float) -> State:
    """A wall of charge +1 at a place [rotor spacings] with a velocity [m/s], on leg 0.

    The wall is the static one, every spring relaxed, and the rotors move along the zero mode at
    |phi_dot| = Lambda |v| / a, for rigid bars exactly so. It is not contracted: among springs it
    has the kinetic energy M_eff v^2 / 2 of which contraction and phonons take a part, and goes on
    more slowly, at 0.2 of the speed of sound by 0.4 to 4 % in the examples of the three motions
    and at 0.6 by 3 to 42 %. Raises ValueError for a velocity that is not finite and as
    `static_wall` does.
    """
    from soliton_linkage.solitons.static_wall import site_arc, static_wall

    if not math.isfinite(velocity):
        raise ValueError(f'velocity of the soliton = {velocity} m/s must be a finite number')
    angles = static_wall(chain, place)
    rate = velocity * site_arc(chain) / chain.spacing
    return State(angles, rate * mode_towards_last(chain, angles))
