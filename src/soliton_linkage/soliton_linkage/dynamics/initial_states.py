# SPDX-License-Identifier: Apache-2.0
"""Initial states of a chain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain


@dataclass(frozen=True)
class State:
    """Angles and rates of the rotors."""

    angles: Array
    """Angles phi [rad], shape (N,)."""
    rates: Array
    """Angular rates [rad/s], shape (N,)."""


def leaning(chain: Chain, lean: int) -> State:
    """Return a state that leans right (`lean` = 1) or left (-1), at rest with relaxed springs.

    If `Chain.deviations` do not allow that all springs are relaxed, the result is the equilibrium
    of the spring torques near the uniform state. Raises ValueError if no equilibrium is found.
    """
    # These imports load scipy, which modules that only use `State` do not need.
    from soliton_linkage.linear.statics import equilibrium, rest_state

    try:
        angles = rest_state(chain, lean)
    except ValueError:
        angles = equilibrium(chain, chain.uniform_state(lean))
    return State(angles, np.zeros_like(angles))


def with_soliton(chain: Chain, site: float, velocity: float) -> State:
    """Return a wall of charge +1 at a site coordinate [rotor spacings] with a velocity [m/s].

    `static_wall` computes the angles. The vector of all rates is the unit zero mode, which changes
    no spring length to first order, times Lambda v / a. Here v is the velocity, and Lambda is the
    arc length sqrt(sum_n dphi_n^2), integrated while the wall moves by one rotor spacing a (see
    `site_arc`). In this state, all springs are relaxed. In a chain of springs, the moving wall
    then contracts and radiates phonons, so that its speed decreases. The decrease was measured
    with the rotors of `config/flipper.yaml`, `wobbler.yaml` and `spinner.yaml`. At distances of 20
    to 60 rotor spacings from the start, it is 0.4 to 4 % of an initial speed of 0.2 c and 3 to
    51 % of 0.6 c, where c is the speed of sound. Raises the errors of `static_wall`, and
    ValueError if the velocity is not finite.
    """
    from soliton_linkage.solitons.static_wall import site_arc, static_wall

    if not math.isfinite(velocity):
        raise ValueError(f'velocity of the soliton = {velocity} m/s must be a finite number')
    angles = static_wall(chain, site)
    rate = velocity * site_arc(chain) / chain.spacing
    return State(angles, rate * mode_towards_last(chain, angles))


def with_pair(chain: Chain, kink: float, anti_kink: float) -> State:
    """Return a kink and an anti-kink, both at rest, at given sites [rotor spacings].

    Outside the pair, the chain leans left if `kink` > `anti_kink`, otherwise right. Raises the
    errors of `static_wall`.
    """
    from soliton_linkage.solitons.anti_kink import continuum_anti_kink
    from soliton_linkage.solitons.static_wall import static_wall

    first, second = static_wall(chain, kink), continuum_anti_kink(chain, anti_kink)
    left = np.arange(chain.number_of_rotors) < (kink + anti_kink) / 2
    angles = np.where(left == (kink < anti_kink), first, second)
    return State(angles, np.zeros_like(angles))
