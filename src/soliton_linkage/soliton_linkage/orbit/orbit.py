# SPDX-License-Identifier: Apache-2.0
"""Interface of a closed zero-energy orbit, and the common methods of all orbits."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from soliton_linkage.linkage.chain import Array, Chain

_STEP = 1e-3
"""Arc step for the derivative of the tangent [rad]. The error of the derivative is 1e-6."""


class OrbitSegment(NamedTuple):
    """Rotors near the wall in a configuration, and their motion along the orbit."""

    first: int
    """Index of the first rotor."""
    angles: Array
    """Actual angles [rad], shape (n,)."""
    tangent: Array
    """Derivative of the angles by the arc length [1], shape (n,). It is below 1e-6 for all other
    rotors."""


class PiecewiseCubic:
    """Piecewise cubic polynomial, linear outside its knots, with fast evaluation at a position."""

    def __init__(self, polynomial: PPoly) -> None:
        self.knots: list[float] = polynomial.x.tolist()
        self._coefficients: list[list[float]] = polynomial.c.T.tolist()

    def interval(self, at: float) -> int:
        """Return the number of the interval of a position; outside, the nearest interval."""
        return min(max(bisect_right(self.knots, at) - 1, 0), len(self.knots) - 2)

    def at(self, at: float) -> tuple[float, float]:
        """Return the value at a position and the derivative."""
        within = min(max(at, self.knots[0]), self.knots[-1])
        number = self.interval(within)
        a, b, c, d = self._coefficients[number]
        x = within - self.knots[number]
        slope = (3 * a * x + 2 * b) * x + c
        return ((a * x + b) * x + c) * x + d + slope * (at - within), slope


class Orbit(ABC):
    """Closed orbit of a chain as a curve with its arc length as parameter.

    The element of the arc length [rad] is ds = sqrt(sum_n dphi_n^2). All real arguments are
    allowed, because the orbit is periodic. At arc 0 the wall is reflected at the first rotor and
    leg 0 begins. In leg 0 no edge rotor of a flipper has toggled. The wall moves towards the last
    rotor in even legs, and towards the first rotor in odd legs. The uniform right-leaning state is
    theta = theta_bar, not its mirror image phi -> pi - phi, a chain that was assembled upside
    down. Angles are defined up to whole turns.
    """

    chain: Chain
    """Chain of the orbit."""
    number_of_legs: int
    """Number of legs: 4 for flippers, 2 for spinners."""
    site_arc: float
    """Mean arc length per rotor spacing [rad]."""
    _starts: list[float]
    """Arc lengths at which the legs begin [rad], followed by the length of the orbit."""

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
        """Arc length [rad] of the motion of the wall past all rotors that it affects."""

    def leg_arcs(self, leg: int) -> tuple[float, float]:
        """Return the arc lengths [rad] at which a leg begins and ends."""
        return self._starts[leg], self._starts[leg + 1]

    def leg(self, arc: float) -> int:
        """Return the leg at an arc length: 0 to 3 for flippers, 0 or 1 for spinners."""
        starts = self._starts
        return bisect_right(starts, arc % starts[-1], 0, self.number_of_legs) - 1

    @abstractmethod
    def site(self, arc: float) -> float:
        """Return the site coordinate of the wall [rotor spacings], clipped to 0 ... N - 1."""

    @abstractmethod
    def arc_at(self, site: float, leg: int) -> float:
        """Return the arc length [rad] at which the wall is at a site coordinate in a leg."""

    @abstractmethod
    def site_arc_at(self, arc: float) -> float:
        """Return the local arc length per rotor spacing [rad], ds / dsite."""

    @abstractmethod
    def segment(self, arc: float) -> OrbitSegment:
        """Return the rotors near the wall; `background` has the angles of all others."""

    @abstractmethod
    def background(self, arc: float) -> tuple[Array, Array]:
        """Return the angles of the chain left and right of the wall [rad], (N,) each.

        All springs are relaxed. The leg determines which edge rotors of a flipper have toggled.
        """

    def configuration(self, arc: float) -> Array:
        """Return the angles of the whole chain at an arc length [rad], shape (N,)."""
        angles, right = self.background(arc)
        segment = self.segment(arc)
        end = segment.first + len(segment.angles)
        angles[end:] = right[end:]
        angles[segment.first : end] = segment.angles
        return angles

    def tangent(self, arc: float) -> Array:
        """Return the unit tangent at an arc length, the zero mode [1], shape (N,)."""
        tangent = np.zeros(self.chain.number_of_rotors)
        segment = self.segment(arc)
        tangent[segment.first : segment.first + len(segment.tangent)] = segment.tangent
        return tangent

    def curvature(self, arc: float) -> Array:
        """Return the derivative of the tangent by the arc [1/rad], d2Phi/ds2, shape (N,)."""
        ahead, behind = self.tangent(arc + _STEP), self.tangent(arc - _STEP)
        return np.asarray((ahead - behind) / (2 * _STEP))

    def free_rate(self, arc: float) -> float:
        """Return the arc rate of free motion relative to a chain of equal rotors [1].

        It is 1 / sqrt(sum_n (I_n / I) t_n^2) with I = M r^2 from the parameters of the chain,
        because free motion conserves the kinetic energy sum_n (I_n / 2) (t_n ds/dt)^2.
        """
        segment = self.segment(arc)
        end = segment.first + len(segment.tangent)
        moments = self.chain.moments_of_inertia[segment.first : end]
        return math.sqrt(self.chain.moment_of_inertia / float(moments @ segment.tangent**2))
