# SPDX-License-Identifier: Apache-2.0
"""Walls at rest and the motion of the chain with rigid bars, the truth that tests compare with.

A wall at rest is built bar by bar: each rotor hangs on its neighbour by a bar of length lbar,
on one of two sides, and away from the wall errors die out. The bars of a moving linkage keep
their length because its motion follows the zero mode, phi' = t(phi) with |t| = 1.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp

from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped

TOLERANCE = 1e-10


def wall_between(chain: Chain, rotor: int, turned: bool = False, crossed: bool = False) -> Array:
    """Angles of a wall at rest half way between a rotor and the next [rad], shape (N,).

    There the chain is its own image: n -> 2 rotor + 1 - n with phi -> phi + pi for flippers,
    so that h = r^2 sin(theta_bar)^2 / a, and with phi -> -phi for spinners, whose masses have
    crossed, h = (a + lbar) / 2, or not, h = (a - lbar) / 2. Turned is its image phi -> pi - phi.
    """
    spinner = chain.motion is Motion.SPINNER
    if spinner:
        h = (chain.spacing + (chain.rest_length if crossed else -chain.rest_length)) / 2
    else:
        h = (chain.rotor_length * math.sin(chain.rest_angle)) ** 2 / chain.spacing
    upright = (rotor % 2 == 1) == turned
    if spinner and not crossed:
        upright = not upright
    angle = math.asin(h / chain.rotor_length)
    return _built(chain, rotor, angle if upright else math.pi - angle, turned)


def _built(chain: Chain, rotor: int, angle: float, turned: bool) -> Array:
    angles = np.empty(chain.number_of_rotors)
    angles[rotor] = angle
    after = 1 if turned else -1
    before = -after if chain.motion is Motion.SPINNER else after
    for n in range(rotor, chain.number_of_rotors - 1):
        angles[n + 1] = _hung(chain, angles[n], -chain.spacing, after * (-1) ** n)
    for n in range(rotor, 0, -1):
        angles[n - 1] = _hung(chain, angles[n], chain.spacing, -before * (-1) ** n)
    return angles


def _hung(chain: Chain, angle: float, offset: float, side: int) -> float:
    """Angle of a rotor on a bar from its neighbour, whose pivot lies at an offset from its own."""
    r = chain.rotor_length
    h, v = offset + r * math.sin(angle), r * math.cos(angle)
    distance = math.hypot(h, v)
    cosine = (distance**2 + r**2 - chain.rest_length**2) / (2 * distance * r)
    return math.atan2(h, v) + side * math.acos(min(max(cosine, -1), 1))


def rigid_motion(chain: Chain, start: Array, arcs: Array, sense: float = 1.0) -> Array:
    """Angles after the given arc lengths along the zero mode [rad], shape (len(arcs), N)."""
    solution = solve_ivp(
        lambda _, angles: sense * zero_mode(chain, angles),
        (0, arcs[-1]),
        start,
        method='DOP853',
        t_eval=arcs,
        rtol=TOLERANCE,
        atol=TOLERANCE,
    )
    return np.ascontiguousarray(solution.y.T)


def distance(angles: Array, others: Array) -> Array:
    """Largest difference of two configurations over the rotors, turns of 2 pi apart [rad]."""
    return np.asarray(np.abs(wrapped(angles - others)).max(axis=-1))
