# SPDX-License-Identifier: Apache-2.0
"""What springs yield to a wall in motion: its momentum, and how its rate varies on the way.

Along its orbit Phi(s) a chain of rotors of the inertia I has the kinetic energy I w^2 / 2 at the
rate w, were its bars rigid. What moves a rotor off a straight path, I w^2 Phi'', is the work of
springs: with their tensions tau, R^T tau = I Phi'' of the rigidity matrix R and the stiffness k,

    mu = sum(tau^2 / k) / I,

the Lagrangian is I (w^2 + mu w^4) / 2 and so, to the lowest order in what is off the orbit,

    p / I = w + 2 mu w^3,   E / I = (w^2 + 3 mu w^4) / 2.

Impulses J add t . J to the momentum p, t = dPhi/ds. As mu is not the same between two rotors and
at one, a wall at a given energy E goes slower where springs yield more, as long as it passes
rotors more slowly than phonons vibrate.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.linalg import solveh_banded

from soliton_linkage.linear.bands import gap
from soliton_linkage.linear.rigidity import rigidity_bands
from soliton_linkage.linear.statics import banded_products
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

_SAMPLES = 32
"""Places in a rotor spacing [1]: a straight line between two is right to 2 % in wobblers."""
_LOWEST_ORDER = 0.2
"""Share 3 mu w^2 of the energy that springs may take for the lowest order to hold [1]."""
_ALIKE = 2
"""Rotor spacings after which the chain about a wall is the same [1], as rotors stagger."""
_SLOW = 0.25
"""Rotors that a slow wall passes in a period of the slowest phonon, at most [1]: the third of its
harmonics is below it."""


class Yielding:
    """How much springs yield to a wall of a chain, by its place between two rotors."""

    def __init__(self, orbit: Orbit) -> None:
        """Work it out in the middle of an orbit; deviations of the rotors count for nothing."""
        self._orbit = even = orbit
        chain = replace(orbit.chain, deviations=NO_DEVIATIONS)
        if orbit.chain != chain:
            even = UniformOrbit(chain)
        begin = _ALIKE * math.floor(even.middle / _ALIKE)
        places = begin + np.arange(_ALIKE * _SAMPLES) / _SAMPLES
        places = np.minimum(places, chain.number_of_rotors - 1.0)
        self._mu = [[_mu(even, even.arc_at(place, leg)) for place in places] for leg in (0, 1)]
        self._mean = float(np.mean(self._mu))
        adiabatic = _SLOW * gap(chain) * orbit.site_arc / (2 * math.pi)
        self._fastest = min(adiabatic, math.sqrt(_LOWEST_ORDER / (3 * np.max(self._mu))))

    def mu(self, arc: float) -> float:
        """Mu at an arc of the orbit [s^2]."""
        samples = self._mu[self._orbit.leg(arc) % 2]
        whole, beyond = divmod(self._orbit.place(arc) * _SAMPLES, 1.0)
        number = int(whole)
        here, there = (samples[each % len(samples)] for each in (number, number + 1))
        return here + beyond * (there - here)

    def pushed_rate(self, rate: float, momentum: float) -> float:
        """Rate after a momentum p / I [rad/s] was added, of a wall between any two rotors."""
        return pushed_rate(rate, momentum, self._mean)

    def change(self, arc: float, rate: float, before: float) -> float:
        """What springs make of the rate of a slow wall on its way to an arc, from one before."""
        if abs(rate) > self._fastest:
            return 1.0
        square = 3 * rate * rate
        return math.sqrt((1 + square * self.mu(before)) / (1 + square * self.mu(arc)))


def _mu(orbit: Orbit, arc: float) -> float:
    """Mu at an arc of the orbit of a chain without deviations [s^2]."""
    chain = orbit.chain
    bend = orbit.bend(arc)
    first, second = rigidity_bands(chain, orbit.configuration(arc))
    pulled = first * bend[:-1] + second * bend[1:]
    tensions: Array = solveh_banded(banded_products(first, second), pulled)
    return float(tensions @ tensions) * chain.moment_of_inertia / chain.stiffness


def pushed_rate(rate: float, momentum: float, mu: float) -> float:
    """Rate after a momentum p / I [rad/s] was added, of a wall that yields by mu [s^2]."""
    whole = rate + 2 * mu * rate**3 + momentum
    scale = math.sqrt(6 * mu)
    return 2 / scale * math.sinh(math.asinh(1.5 * scale * whole) / 3)
