# SPDX-License-Identifier: Apache-2.0
"""Errors of the position and rate of a wall due to small unmodelled deviations of the chain.

The errors are computed to first order. Let p be the relative deviations of the rotor lengths and
of the spacings from the uniform chain. Because the bars keep their lengths, the angles change by
dphi with R dphi + E p = 0, where R and E are the derivatives of the bar lengths with respect to
the angles and to p. Of all solutions, dphi is the one that is orthogonal to the zero mode t.

Let S_n be the sum of t_j^2 over the rotors j to the left of bond n, and A_n and B_n the levers of
the bar of bond n. In the uniform chain, S_b = 1/2 if the wall is at bond b, the site b + 1/2;
near the edges, S_b differs from 1/2. In a chain with deviations, the wall is at bond b if S_b has
the same value as in the uniform chain. Let F = ln(S_b / (1 - S_b)). Because
t_{n+1} / t_n = -A_n / B_n, the deviations change F by

    dF = -sum_n w_n d ln|A_n / B_n|,   w_n = min(S_n / S_b, (1 - S_n) / (1 - S_b)).

With the derivatives F_phi by the angles and F_p by p, dF = F_phi^T dphi + F_p^T p. Let s_b be the
arc length at which the wall is at bond b. The error ds_b of s_b is the solution of
F_phi^T t ds_b = -dF.

With the curvature Phi'' of the orbit, the time that a wall in free motion takes from bond b to
bond b + 1 has the relative change

    (ds_{b+1} - ds_b) / (s_{b+1} - s_b) - Phi''^T dphi + sum_n t_n^2 (p_n + m_n / 2),

where p_n is the relative deviation of the length of rotor n, and m_n the relative deviation of its
mass. The three terms are the change of the arc length between the bonds, the change of the arc
element, and the change of the inertia.

With the pseudo-inverse R^+ of R, dphi = -R^+ E p. The code computes products q^T R^+ E with a
vector q as u^T E, where u is the solution of (R R^T) u = R q. Deviations of the stiffnesses have
no effect, because all springs have their rest lengths in the whole orbit.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from soliton_linkage.linear.bands import tail_ratio
from soliton_linkage.linear.statics import gram_matrix_bands
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

_SAMPLES = 4
"""Number of points between two bonds at which the arc element and the inertia are computed [1]."""


class Shifts(NamedTuple):
    """Standard deviations of errors of a wall, each divided by sigma.

    Here sigma [rad] is the standard deviation of the error of a far rotor (see `WallShifts`).
    """

    arc: float
    """Standard deviation of the error of the arc length, divided by sigma [1]."""
    rate: float
    """Standard deviation of the relative error of the rate, divided by sigma [1/rad]. The rate is
    the inverse of the time that the wall takes from one bond to the next."""


class WallShifts:
    """Errors of a wall due to unmodelled deviations, relative to the error of a far rotor.

    Far from the wall, the change of the angle of a rotor contains `tail_ratio` (see
    `linear.bands`) times the change of the angle of the next rotor towards the wall. The error of
    a far rotor is the rest of this change: the part that does not follow from the change of the
    next rotor. All lengths and masses are assumed to have independent relative deviations of equal
    variance.
    """

    def __init__(self, orbit: Orbit) -> None:
        chain = replace(orbit.chain, deviations=NO_DEVIATIONS)
        self._orbit = orbit if orbit.chain == chain else UniformOrbit(chain)
        self._known = cache(self._variances)
        self._far = 0.0

    def at(self, site: float, leg: int) -> Shifts:
        """Return the `Shifts` of a wall at a site [rotor spacings]."""
        bonds = self._orbit.chain.number_of_rotors - 1
        before = min(max(site - 0.5, 0.0), bonds - 1)
        bond = min(math.floor(before), bonds - 2)
        here, there, rate = self._known(bond, leg)
        return Shifts(math.sqrt(here + (before - bond) * (there - here)), math.sqrt(rate))

    def _variances(self, bond: int, leg: int) -> tuple[float, float, float]:
        orbit = self._orbit
        if not self._far:
            middle = _BarsNearWall(orbit.chain, orbit.segment(orbit.arc_at(orbit.middle, 0)))
            self._far = float(np.linalg.norm(middle.far_rotor_effect(tail_ratio(orbit.chain))))
        here, there = self._arc_effects(bond, leg), self._arc_effects(bond + 1, leg)
        begin, end = (orbit.arc_at(each + 0.5, leg) for each in (bond, bond + 1))
        time = (there - here) / (end - begin)
        masses = np.zeros(orbit.chain.number_of_rotors)
        for sample in range(_SAMPLES):
            arc = begin + (end - begin) * (sample + 0.5) / _SAMPLES
            segment = orbit.segment(arc)
            bars = _BarsNearWall(orbit.chain, segment)
            effects = bars.arc_element_effect(orbit.curvature(arc)[segment.within])
            time += self._whole(segment.first, effects) / _SAMPLES
            masses[segment.within] += segment.tangent**2 / (2 * _SAMPLES)
        rate = time @ time + masses @ masses
        scale = self._far**2
        return float(here @ here) / scale, float(there @ there) / scale, float(rate) / scale

    def _arc_effects(self, bond: int, leg: int) -> Array:
        segment = self._orbit.segment(self._orbit.arc_at(bond + 0.5, leg))
        bars = _BarsNearWall(self._orbit.chain, segment)
        return self._whole(segment.first, bars.arc_effect(bond - segment.first))

    def _whole(self, first: int, effects: Array) -> Array:
        whole = np.zeros(2 * self._orbit.chain.number_of_rotors - 1)
        whole[2 * first : 2 * first + len(effects)] = effects
        return whole


class _BarsNearWall:
    """Effects of relative deviations of n rotor lengths and n - 1 spacings near a wall.

    Each method returns the derivatives of a quantity with respect to the relative deviations,
    shape (2 n - 1,). The order is rotor 0, spacing 0, rotor 1 and so on. A bar of length l joins
    masses at (h, v) and (h', v') relative to their pivots, which are the spacing a apart. With
    c = h v' - v h', the levers A and B of the bar satisfy l A = c - a v and l B = a v' - c.
    """

    def __init__(self, chain: Chain, segment: OrbitSegment) -> None:
        h = chain.rotor_length * np.sin(segment.angles)
        v = chain.rotor_length * np.cos(segment.angles)
        a, left, right = chain.spacing, (h[:-1], v[:-1]), (h[1:], v[1:])
        self._tangent = segment.tangent
        self._across, self._up = a + right[0] - left[0], right[1] - left[1]
        self._left, self._right, self._spacing = left, right, a
        self._cross = left[0] * right[1] - left[1] * right[0]
        self._dot = left[0] * right[0] + left[1] * right[1]
        self._first = self._cross - a * left[1]
        self._second = a * right[1] - self._cross

    def far_rotor_effect(self, tail: float) -> Array:
        """Return the effects on the error of a far rotor [rad]; `tail` is the `tail_ratio`."""
        weights = np.zeros(len(self._tangent))
        weights[1:3] = 1.0, -tail
        return self._angle_effect(weights)

    def arc_element_effect(self, curvature: Array) -> Array:
        """Return the effects on sum_n t_n^2 p_n - Phi''^T dphi [1]; `curvature` is Phi''."""
        effects = -self._angle_effect(curvature)
        effects[::2] += self._tangent**2
        return effects

    def arc_effect(self, bond: int) -> Array:
        """Return the effects on the arc length at which the wall is at a bond [rad]."""
        left = np.cumsum(self._tangent**2)[:-1]
        right = np.cumsum(self._tangent[::-1] ** 2)[-2::-1]
        weights = np.minimum(left / left[bond], right / right[bond])
        first, second = (
            np.divide(weights, lever, out=np.zeros(len(lever)), where=lever != 0)
            for lever in (self._first, self._second)
        )
        both = first + second
        (h, v), (h_next, v_next), a = self._left, self._right, self._spacing
        turned = both * self._dot
        by_angles = _rotor_sums(turned + first * a * h, second * a * h_next - turned)
        effects = self._angle_effect(by_angles)
        effects[1::2] -= first * a * v + second * a * v_next
        of_left = first * self._first + second * self._cross
        of_right = first * self._cross - second * self._second
        effects[::2] += _rotor_sums(of_left, of_right)
        return -effects / float(by_angles @ self._tangent)

    def _angle_effect(self, weights: Array) -> Array:
        products = self._first * weights[:-1] + self._second * weights[1:]
        bars = solveh_banded(gram_matrix_bands(self._first, self._second), products)
        (h, v), (h_next, v_next) = self._left, self._right
        effects = np.empty(2 * len(weights) - 1)
        effects[1::2] = -bars * self._spacing * self._across
        of_left = bars * (self._across * h + self._up * v)
        of_right = -bars * (self._across * h_next + self._up * v_next)
        effects[::2] = _rotor_sums(of_left, of_right)
        return effects


def _rotor_sums(lefts: Array, rights: Array) -> Array:
    sums = np.append(lefts, 0.0)
    sums[1:] += rights
    return sums
