# SPDX-License-Identifier: Apache-2.0
"""First-order errors of the position and rate of a wall due to small unmodelled deviations.

Let p be the relative deviations of the rotor lengths and spacings. Bars keep their lengths if the
angles change by dphi with R dphi + E p = 0, dphi orthogonal to the zero mode t. The part S_b of
|t|^2 on the left of the bond b of a wall determines its site coordinate (`DeviatingOrbit`). With
the parts S_n on the left of bonds n and t_{n+1} / t_n = -A_n / B_n, ln(S_b / (1 - S_b)) changes by

    dQ = -sum_n w_n d ln|A_n / B_n|,   w_n = min(S_n / S_b, (1 - S_n) / (1 - S_b)),

through the angles and the lengths, dQ = Q_phi . dphi + Q_p . p. The arc error ds_b solves
Q_phi . t ds_b = -dQ. The relative change of the time that a wall in free motion takes from bond to
bond is

    (ds_{b+1} - ds_b) / (s_{b+1} - s_b) - Phi'' . dphi + sum_n t_n^2 (p_n + m_n / 2),

with the relative deviations p_n of rotor lengths and m_n of masses. The three terms are the
changes of the arc between the bonds, of the arc element, and of the inertia. R^+ E need not be
computed: for any q, q . R^+ E = u . E with (R R^T) u = R q. Stiffnesses have no effect.
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
"""Number of samples of the arc element and of the inertia between two bonds [1]."""


class Shifts(NamedTuple):
    """Standard deviations of a wall, divided by the standard deviation of a far rotor."""

    arc: float
    """Ratio for the arc [1]."""
    rate: float
    """Ratio for the relative rate [1/rad]."""


class WallShifts:
    """Errors of a wall due to deviations, in units of the effect on a rotor far from the wall.

    This effect is the angle of the rotor without the part that continues the tail of the next
    rotor towards the wall. All lengths and masses have independent relative deviations of equal
    variance. Known deviations of the chain of the orbit are ignored.
    """

    def __init__(self, orbit: Orbit) -> None:
        chain = replace(orbit.chain, deviations=NO_DEVIATIONS)
        self._orbit = orbit if orbit.chain == chain else UniformOrbit(chain)
        self._known = cache(self._variances)
        self._far = 0.0

    def at(self, site: float, leg: int) -> Shifts:
        """Return the errors at a site coordinate [rotor spacings].

        Variances of the arc are interpolated between the bonds on either side of the site. The
        values of a bond are computed when they are first needed.
        """
        bonds = self._orbit.chain.number_of_rotors - 1
        before = min(max(site - 0.5, 0.0), bonds - 1)
        bond = min(math.floor(before), bonds - 2)
        here, there, rate = self._known(bond, leg)
        return Shifts(math.sqrt(here + (before - bond) * (there - here)), math.sqrt(rate))

    def _variances(self, bond: int, leg: int) -> tuple[float, float, float]:
        """Return the variances of the arc at a bond and the next [1] and of the rate [1/rad^2]."""
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
            within = slice(segment.first, segment.first + len(segment.tangent))
            bars = _BarsNearWall(orbit.chain, segment)
            effects = bars.arc_element_effect(orbit.curvature(arc)[within])
            time += self._whole(segment.first, effects) / _SAMPLES
            masses[within] += segment.tangent**2 / (2 * _SAMPLES)
        rate = time @ time + masses @ masses
        scale = self._far**2
        return float(here @ here) / scale, float(there @ there) / scale, float(rate) / scale

    def _arc_effects(self, bond: int, leg: int) -> Array:
        """Return the effect of each rotor and spacing, alternately, on the arc, (2 N - 1,)."""
        segment = self._orbit.segment(self._orbit.arc_at(bond + 0.5, leg))
        bars = _BarsNearWall(self._orbit.chain, segment)
        return self._whole(segment.first, bars.arc_effect(bond - segment.first))

    def _whole(self, first: int, effects: Array) -> Array:
        """Extend effects of lengths near a wall to all lengths of the chain, with zeros."""
        whole = np.zeros(2 * self._orbit.chain.number_of_rotors - 1)
        whole[2 * first : 2 * first + len(effects)] = effects
        return whole


class _BarsNearWall:
    """Effects of the lengths of the n rotors near a wall and of their spacings, (2 n - 1,).

    Rotors and spacings alternate. With c = h v' - v h' of the masses that a bar joins, its levers
    are l A = c - a v and l B = a v' - c, so that all derivatives are products of positions.
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
        """Return the effects on the second rotor, without the tail of the third rotor [rad].

        The first rotor may be an edge rotor and is not used.
        """
        weights = np.zeros(len(self._tangent))
        weights[1:3] = 1.0, -tail
        return self._angle_effect(weights)

    def arc_element_effect(self, curvature: Array) -> Array:
        """Return the effects on arc element and inertia [1], given Phi'' [1/rad], (n,)."""
        effects = -self._angle_effect(curvature)
        effects[::2] += self._tangent**2
        return effects

    def arc_effect(self, bond: int) -> Array:
        """Return the effects on the arc [rad] at a fixed share of |t|^2 left of a bond."""
        left = np.cumsum(self._tangent**2)[:-1]
        right = np.cumsum(self._tangent[::-1] ** 2)[-2::-1]
        weights = np.minimum(left / left[bond], right / right[bond])
        first, second = (
            np.divide(weights, lever, out=np.zeros(len(lever)), where=lever != 0)
            for lever in (self._first, self._second)
        )
        both = first + second
        (h, v), (h_next, v_next), a = self._left, self._right, self._spacing
        by_angles = _rotor_sums(
            both * self._dot + first * a * h,
            second * a * h_next - both * self._dot,
        )
        effects = self._angle_effect(by_angles)
        effects[1::2] -= first * a * v + second * a * v_next
        effects[::2] += _rotor_sums(
            first * self._first + second * self._cross,
            first * self._cross - second * self._second,
        )
        return -effects / float(by_angles @ self._tangent)

    def _angle_effect(self, weights: Array) -> Array:
        """Return the effects on a weighted sum of the angles, weights of shape (n,)."""
        products = self._first * weights[:-1] + self._second * weights[1:]
        bars = solveh_banded(gram_matrix_bands(self._first, self._second), products)
        (h, v), (h_next, v_next) = self._left, self._right
        effects = np.empty(2 * len(weights) - 1)
        effects[1::2] = -bars * self._spacing * self._across
        effects[::2] = _rotor_sums(
            bars * (self._across * h + self._up * v),
            -bars * (self._across * h_next + self._up * v_next),
        )
        return effects


def _rotor_sums(lefts: Array, rights: Array) -> Array:
    """Add the contributions of bars to the rotors on their left and right, shape (n,)."""
    sums = np.append(lefts, 0.0)
    sums[1:] += rights
    return sums
