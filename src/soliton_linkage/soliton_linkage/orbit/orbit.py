# SPDX-License-Identifier: Apache-2.0
"""Base class of the closed zero-energy orbits of chains."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from soliton_linkage.linkage.chain import Array, Chain

_STEP = 1e-3
"""Step of the arc length in the numerical derivative of the tangent [rad]. With this step, the
error of the derivative is 1e-6/rad."""


class OrbitSegment(NamedTuple):
    """Angles and derivatives of n rotors near the wall; rotor `first` is the first of them."""

    first: int
    angles: Array
    """Actual (not staggered) angles [rad], shape (n,)."""
    tangent: Array
    """Derivatives of the angles with respect to the arc length [1], shape (n,). For all other
    rotors of the chain, the derivatives are below 1e-6."""

    @property
    def within(self) -> slice:
        """Slice of the n rotors in an array of all rotors of the chain."""
        return slice(self.first, self.first + len(self.angles))


class PiecewiseCubic:
    """Fast evaluation of a piecewise cubic polynomial, which is linear outside its knots."""

    def __init__(self, polynomial: PPoly) -> None:
        self.knots: list[float] = polynomial.x.tolist()
        self._coefficients: list[list[float]] = polynomial.c.T.tolist()

    def interval(self, at: float) -> int:
        """Return the index of the interval that contains the position `at` or is nearest to it."""
        return min(max(bisect_right(self.knots, at) - 1, 0), len(self.knots) - 2)

    def at(self, at: float) -> tuple[float, float]:
        """Return the value and the derivative at the position `at`."""
        within = min(max(at, self.knots[0]), self.knots[-1])
        number = self.interval(within)
        a, b, c, d = self._coefficients[number]
        x = within - self.knots[number]
        slope = (3 * a * x + 2 * b) * x + c
        return ((a * x + b) * x + c) * x + d + slope * (at - within), slope


class Orbit(ABC):
    """Closed orbit of a chain: a curve of configurations, parametrised by the arc length.

    The arc length `arc` [rad] is the integral of ds = sqrt(sum_n dphi_n^2). Because the orbit is
    closed, the methods accept any real number as arc length. A leg is the part of the orbit
    between two reflections of the wall. In even legs, the wall moves towards the last rotor, and
    in odd legs towards the first rotor. Leg 0 begins at arc length 0, where the wall is reflected
    at the first rotor.

    The lever of an edge rotor is the derivative of the length of its bar with respect to its
    angle. An edge rotor of a flipper is called toggled if the sign of its lever differs from the
    sign in the left-leaning state, in which all staggered angles (see `staggered`) are -theta_bar.
    In leg 0, no edge rotor is toggled. If a chain is assembled upside down, each angle phi of the
    orbit must be replaced by pi - phi.
    """

    chain: Chain
    """Chain whose configurations form the orbit."""
    number_of_legs: int
    """Number of legs: 4 for flippers, 2 for spinners."""
    site_arc: float
    """Mean arc length per rotor spacing [rad]."""
    _starts: list[float]
    """Arc lengths at which the legs begin, followed by the length of the orbit [rad]."""

    @property
    def length(self) -> float:
        """Arc length of the whole orbit [rad]."""
        return self._starts[-1]

    @property
    def middle(self) -> float:
        """Site coordinate of the middle of the chain [rotor spacings]."""
        return (self.chain.number_of_rotors - 1) / 2

    @property
    @abstractmethod
    def wall_extent(self) -> float:
        """Upper bound of the arc length during which one rotor moves [rad].

        The bound applies to one passage of the wall past the rotor, also if the wall is reflected
        there. A rotor moves if its component of the tangent exceeds 1e-6.
        """

    def leg_arcs(self, leg: int) -> tuple[float, float]:
        """Return the arc lengths [rad] at which a leg begins and ends."""
        return self._starts[leg], self._starts[leg + 1]

    def leg(self, arc: float) -> int:
        """Return the number of the leg at an arc length [rad], from 0 to `number_of_legs` - 1."""
        starts = self._starts
        return bisect_right(starts, arc % starts[-1], 0, self.number_of_legs) - 1

    @abstractmethod
    def site(self, arc: float) -> float:
        """Return the site of the wall at an arc length, from 0 to N - 1 [rotor spacings]."""

    @abstractmethod
    def arc_at(self, site: float, leg: int) -> float:
        """Return the arc length [rad] in a leg at which the wall is at a site [rotor spacings].

        If the wall does not reach the site in this leg, the arc length is extrapolated linearly.
        """

    @abstractmethod
    def site_arc_at(self, arc: float) -> float:
        """Return |ds / d(site)|, the arc length per rotor spacing, at an arc length s [rad]."""

    @abstractmethod
    def segment(self, arc: float) -> OrbitSegment:
        """Return angles and tangent of the rotors near the wall at an arc length [rad]."""

    @abstractmethod
    def background(self, arc: float) -> tuple[Array, Array]:
        """Return the angles on the left and on the right of the wall [rad], shape (N,) each.

        The first array contains the angle of each rotor while the rotor is far to the left of the
        wall, the second array its angle while it is far to the right of the wall. All arc lengths
        in a leg give the same result.
        """

    def configuration(self, arc: float) -> Array:
        """Return the angles of the whole chain at an arc length [rad], shape (N,)."""
        angles, right = self.background(arc)
        segment = self.segment(arc)
        angles[segment.within.stop :] = right[segment.within.stop :]
        angles[segment.within] = segment.angles
        return angles

    def tangent(self, arc: float) -> Array:
        """Return the unit tangent dPhi/ds, the zero mode, at an arc length [rad], shape (N,)."""
        tangent = np.zeros(self.chain.number_of_rotors)
        segment = self.segment(arc)
        tangent[segment.within] = segment.tangent
        return tangent

    def curvature(self, arc: float) -> Array:
        """Return d2Phi/ds2, the derivative of the tangent, at an arc length [1/rad], (N,)."""
        ahead, behind = self.tangent(arc + _STEP), self.tangent(arc - _STEP)
        return np.asarray((ahead - behind) / (2 * _STEP))

    def free_rate(self, arc: float) -> float:
        """Return the rate ds/dt of free motion, relative to a chain without deviations [1].

        Free motion conserves the kinetic energy sum_n (I_n / 2) (t_n ds/dt)^2 with the tangent t
        and the moments of inertia I_n. With the moment of inertia I of a rotor without deviations,
        the relative rate is therefore 1 / sqrt(sum_n (I_n / I) t_n^2).
        """
        segment = self.segment(arc)
        moments = self.chain.moments_of_inertia[segment.within]
        return math.sqrt(self.chain.moment_of_inertia / float(moments @ segment.tangent**2))
