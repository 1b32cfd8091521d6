# SPDX-License-Identifier: Apache-2.0
"""Rings with colliding walls, and the collision in phi^4 theory by an independent scheme."""

import math

import numpy as np

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.collisions.runs import Collision

NARROW = (0.5, 0.3)
SINE_GORDON = (8.0, 0.9)


def ring_of(example: tuple[float, float], length: float = 40.0) -> Chain:
    """Ring with the given r / a and rest angle [rad], of so many reaches."""
    ratio, rest_angle = example
    chain = Chain(2, 1.0, ratio, rest_angle, 1.0, 1.0)
    rotors = 2 * math.ceil(length * penetration_depth(chain))
    return Chain(rotors, 1.0, ratio, rest_angle, 1.0, 1.0, periodic=True)


def meeting(example: tuple[float, float], speed: float, onwards: bool = False) -> Collision:
    return Collision(ring_of(example), speed, onwards)


def phi4_speed_after(speed: float, spacing: float = 0.05, step: float = 0.02) -> float:
    """Speed at which walls tanh x of u_tt = u_xx + 2 u (1 - u^2) part after one collision.

    Differences of order 4 in space, leapfrog in time.
    """
    x = np.arange(-24.0, 24.0, spacing)
    gamma = 1 / math.sqrt(1 - speed**2)

    def walls(time: float) -> Array:
        away = 6.0 - speed * time
        return np.tanh(gamma * (x - away)) - np.tanh(gamma * (x + away)) + 1

    def curvature(u: Array) -> Array:
        beside = np.roll(u, 1) + np.roll(u, -1)
        return (16 * beside - np.roll(u, 2) - np.roll(u, -2) - 30 * u) / (12 * spacing**2)

    before, now, sites, met = walls(-step), walls(0.0), [], False
    while True:
        before, now = now, 2 * now - before + step**2 * (curvature(now) + 2 * now * (1 - now**2))
        left = np.flatnonzero(now < 0)
        met = met or not left.size
        if met and left.size:
            n = int(left[-1])
            sites.append(x[n] + spacing * now[n] / (now[n] - now[n + 1]))
            if sites[-1] > 4.0:
                far = [place for place in sites if place > 2.5]
                return float(np.polyfit(step * np.arange(len(far)), far, 1)[0])
