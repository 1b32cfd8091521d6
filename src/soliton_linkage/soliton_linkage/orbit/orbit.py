# SPDX-License-Identifier: Apache-2.0
"""The closed orbit of a chain, along which its wall runs to and fro: what every orbit can tell."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_right
from typing import NamedTuple

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain

_STEP = 1e-3
"""Arc over which the tangent is differentiated [rad]: an error of 1e-6."""


class OrbitSegment(NamedTuple):
    """Rotors first ... first + n - 1 of a configuration, and how they move along the orbit.

    first: number of the first rotor.
    angles: actual angles [rad], shape (n,).
    tangent: change of the angles with the arc length [1], shape (n,); below 1e-6 on all others.
    """

    first: int
    angles: Array
    tangent: Array


class Orbit(ABC):
    """The closed orbit of a chain, along which its wall runs to and fro, as a curve in its arc.

    The arc length [rad] is that of all angles, sqrt(sum_n dphi_n^2). It is 0 where the wall is
    reflected at the first rotor and leg 0 begins, in which no edge rotor of a flipper has
    toggled; it grows towards the last rotor in even legs and back in odd ones, up to the length
    of the whole orbit, and may be any number. The chain is the one whose uniform right-leaning
    state is theta = theta_bar; that which was assembled upside down is its image
    phi -> pi - phi. Angles are known up to whole turns.
    """

    chain: Chain
    """The chain whose orbit it is."""
    number_of_legs: int
    """4 for flippers, 2 for spinners."""
    site_arc: float
    """Arc length from one rotor to the next [rad], on the average."""
    _starts: list[float]
    """Arc lengths at which the legs begin [rad], and after them that of the whole orbit."""

    @property
    def length(self) -> float:
        """Arc length of the whole orbit [rad]."""
        return self._starts[-1]

    @property
    def middle(self) -> float:
        """Place in the middle of the chain [rotor spacings]."""
        return (self.chain.number_of_rotors - 1) / 2

    @property
    @abstractmethod
    def wall_extent(self) -> float:
        """Arc length [rad] of a way past all the rotors that know of a wall."""

    def leg_arcs(self, leg: int) -> tuple[float, float]:
        """Arc lengths [rad] at which a leg begins and ends."""
        return self._starts[leg], self._starts[leg + 1]

    def leg(self, arc: float) -> int:
        """Leg of the orbit at an arc length: 0 to 3 for flippers, 0 or 1 for spinners."""
        starts = self._starts
        return bisect_right(starts, arc % starts[-1], 0, self.number_of_legs) - 1

    @abstractmethod
    def site(self, arc: float) -> float:
        """Place of the wall [rotor spacings], from 0 to N - 1; at the edges it waits there."""

    @abstractmethod
    def arc_at(self, place: float, leg: int) -> float:
        """Arc length at which the wall is at a place [rotor spacings] in the middle of a leg."""

    @abstractmethod
    def site_arc_at(self, arc: float) -> float:
        """Arc length from one rotor to the next [rad] as it is at an arc length, ds / dplace."""

    @abstractmethod
    def segment(self, arc: float) -> OrbitSegment:
        """Rotors about the wall at an arc length; all others are as in `background`."""

    @abstractmethod
    def background(self, arc: float) -> tuple[Array, Array]:
        """Angles of the chain as it is on the left and on the right of the wall [rad], (N,) each.

        Relaxed without a wall, but for the edge rotors of flippers, which have toggled or not.
        """

    def configuration(self, arc: float) -> Array:
        """Angles of the whole chain at an arc length [rad], shape (N,)."""
        angles, right = self.background(arc)
        about = self.segment(arc)
        beyond = about.first + len(about.angles)
        angles[beyond:] = right[beyond:]
        angles[about.first : beyond] = about.angles
        return angles

    def tangent(self, arc: float) -> Array:
        """Unit tangent at an arc length, the zero mode there [1], shape (N,)."""
        tangent = np.zeros(self.chain.number_of_rotors)
        about = self.segment(arc)
        tangent[about.first : about.first + len(about.tangent)] = about.tangent
        return tangent

    def curvature(self, arc: float) -> Array:
        """Change of the tangent with the arc [1/rad], d2Phi/ds2, shape (N,)."""
        ahead, behind = self.tangent(arc + _STEP), self.tangent(arc - _STEP)
        return np.asarray((ahead - behind) / (2 * _STEP))

    def free_rate(self, arc: float) -> float:
        """Rate of the arc in free motion, over that of a chain of equal rotors [1].

        1 / sqrt(sum_n (I_n / I) t_n^2): the kinetic energy sum_n (I_n / 2) (t_n ds/dt)^2 is kept,
        with I = M r^2 of the chain's parameters.
        """
        about = self.segment(arc)
        moments = self.chain.moments_of_inertia[about.first : about.first + len(about.tangent)]
        return math.sqrt(self.chain.moment_of_inertia / float(moments @ about.tangent**2))
