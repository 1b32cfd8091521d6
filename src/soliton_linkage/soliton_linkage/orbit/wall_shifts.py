# SPDX-License-Identifier: Apache-2.0
"""How far small deviations that nobody told move a wall, and change its rate, to first order.

With shares p by which rotors and their distances differ, bars keep their lengths where the angles
change by dphi with R dphi + E p = 0, dphi orthogonal to the zero mode t. A wall is where it was if
the share S_b of |t|^2 on the left of its bond b is what it was (`DeviatingOrbit`). With the shares
S_n on the left of all bonds and t_{n+1} / t_n = -A_n / B_n, that share is changed by

    dQ = -sum_n w_n d ln|A_n / B_n|,   w_n = min(S_n / S_b, (1 - S_n) / (1 - S_b)),

through the angles and the lengths, dQ = Q_phi . dphi + Q_p . p, and the arc is off by ds_b with
Q_phi . t ds_b = -dQ. From bond to bond a wall in free motion then takes longer by the share

    (ds_{b+1} - ds_b) / Lambda - Phi'' . dphi + sum_n t_n^2 (p_n + m_n / 2),

of the nearest point's way Lambda, of the arc's length over that, and of inertia, with shares p_n
of the lengths and m_n of the masses of rotors. R^+ E has not to be known: for any q,
q . R^+ E = u . E with (R R^T) u = R q. Stiffnesses change neither.
"""

from __future__ import annotations

import math
from dataclasses import replace
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
"""Places between two bonds at which the length of the arc and inertia are looked at [1]."""


class Shifts(NamedTuple):
    """Standard deviations of what deviations do, over what they add to a rotor far from it."""

    arc: float
    """Of the shift of the arc [1]."""
    rate: float
    """Of the relative change of the rate [1/rad]."""


class WallShifts:
    """Shifts of the wall of a chain by deviations, over what these add to a rotor far from it.

    That is what the angle has beside the tail of the next rotor towards the wall.
    """

    def __init__(self, orbit: Orbit) -> None:
        """Take a chain without deviations for one with those that were told."""
        chain = replace(orbit.chain, deviations=NO_DEVIATIONS)
        self._orbit = orbit if orbit.chain == chain else UniformOrbit(chain)
        self._known: dict[tuple[int, int], tuple[float, float, float]] = {}
        self._far = 0.0

    def at(self, place: float, leg: int) -> Shifts:
        """Shifts by deviations of all lengths and masses that are as large [1].

        Variances at a place [rotor spacings] are between those of the bonds on either side, which
        are worked out where first wanted.
        """
        bonds = self._orbit.chain.number_of_rotors - 1
        before = min(max(place - 0.5, 0.0), bonds - 1)
        bond = min(math.floor(before), bonds - 2)
        if (leg, bond) not in self._known:
            self._known[leg, bond] = self._variances(bond, leg)
        here, there, slower = self._known[leg, bond]
        return Shifts(math.sqrt(here + (before - bond) * (there - here)), math.sqrt(slower))

    def _variances(self, bond: int, leg: int) -> tuple[float, float, float]:
        """Of the arc at a bond and at the next [1], and of the rate between them [1/rad^2]."""
        orbit = self._orbit
        if not self._far:
            middle = _BarsAboutWall(orbit.chain, orbit.segment(orbit.arc_at(orbit.middle, 0)))
            self._far = float(np.linalg.norm(middle.of_far_rotor(tail_ratio(orbit.chain))))
        here, there = self._arc_at(bond, leg), self._arc_at(bond + 1, leg)
        slower = (there - here) / orbit.site_arc * (-1) ** leg
        masses = np.zeros(orbit.chain.number_of_rotors)
        for sample in range(_SAMPLES):
            arc = orbit.arc_at(bond + 0.5 + (sample + 0.5) / _SAMPLES, leg)
            about = orbit.segment(arc)
            within = slice(about.first, about.first + len(about.tangent))
            longer = _BarsAboutWall(orbit.chain, about).of_length(orbit.curvature(arc)[within])
            slower += self._whole(about.first, longer) / _SAMPLES
            masses[within] += about.tangent**2 / (2 * _SAMPLES)
        of_rate = slower @ slower + masses @ masses
        scale = self._far**2
        return float(here @ here) / scale, float(there @ there) / scale, float(of_rate) / scale

    def _arc_at(self, bond: int, leg: int) -> Array:
        """Shift of the arc at a bond by each rotor and each spacing in turn, shape (2 N - 1,)."""
        about = self._orbit.segment(self._orbit.arc_at(bond + 0.5, leg))
        return self._whole(
            about.first, _BarsAboutWall(self._orbit.chain, about).of_arc(bond - about.first)
        )

    def _whole(self, first: int, by_lengths: Array) -> Array:
        """What lengths about a wall do, among all of the chain."""
        whole = np.zeros(2 * self._orbit.chain.number_of_rotors - 1)
        whole[2 * first : 2 * first + len(by_lengths)] = by_lengths
        return whole


class _BarsAboutWall:
    """Bars between the n rotors about a wall: what shares of their lengths do, shape (2 n - 1,).

    Of rotors and spacings in turn. With c = h v' - v h' of the masses that a bar joins, its levers
    are l A = c - a v and l B = a v' - c, so that all derivatives are products of positions.
    """

    def __init__(self, chain: Chain, about: OrbitSegment) -> None:
        h = chain.rotor_length * np.sin(about.angles)
        v = chain.rotor_length * np.cos(about.angles)
        a, left, right = chain.spacing, (h[:-1], v[:-1]), (h[1:], v[1:])
        self._tangent = about.tangent
        self._across, self._up = a + right[0] - left[0], right[1] - left[1]
        self._left, self._right, self._spacing = left, right, a
        self._turned = left[0] * right[1] - left[1] * right[0]
        self._along = left[0] * right[0] + left[1] * right[1]
        self._first = self._turned - a * left[1]
        self._second = a * right[1] - self._turned

    def of_far_rotor(self, tail: float) -> Array:
        """What they add to the second rotor beside the tail of the third [rad].

        The first may lean any way.
        """
        rotor = np.zeros(len(self._tangent))
        rotor[1:3] = 1.0, -tail
        return self._by_angles(rotor)

    def of_length(self, bend: Array) -> Array:
        """What they do to the arc's length [1], bent by Phi'' [1/rad], (n,), and inertia."""
        longer = -self._by_angles(bend)
        longer[::2] += self._tangent**2
        return longer

    def of_arc(self, bond: int) -> Array:
        """What they do to the arc that has its share of the mode on the left of a bond [rad]."""
        left = np.cumsum(self._tangent**2)[:-1]
        right = np.cumsum(self._tangent[::-1] ** 2)[-2::-1]
        weights = np.minimum(left / left[bond], right / right[bond])
        on_first, on_second = (
            np.divide(weights, lever, out=np.zeros(len(lever)), where=lever != 0)
            for lever in (self._first, self._second)
        )
        both = on_first + on_second
        (h, v), (h_next, v_next), a = self._left, self._right, self._spacing
        by_angles = _gathered(
            both * self._along + on_first * a * h,
            on_second * a * h_next - both * self._along,
        )
        changed = self._by_angles(by_angles)
        changed[1::2] -= on_first * a * v + on_second * a * v_next
        changed[::2] += _gathered(
            on_first * self._first + on_second * self._turned,
            on_first * self._turned - on_second * self._second,
        )
        return -changed / float(by_angles @ self._tangent)

    def _by_angles(self, each: Array) -> Array:
        """What they do to a sum of so much of each angle, shape (n,)."""
        pulled = self._first * each[:-1] + self._second * each[1:]
        bars = solveh_banded(gram_matrix_bands(self._first, self._second), pulled)
        (h, v), (h_next, v_next) = self._left, self._right
        by_lengths = np.empty(2 * len(each) - 1)
        by_lengths[1::2] = -bars * self._spacing * self._across
        by_lengths[::2] = _gathered(
            bars * (self._across * h + self._up * v),
            -bars * (self._across * h_next + self._up * v_next),
        )
        return by_lengths


def _gathered(lefts: Array, rights: Array) -> Array:
    """Sums of what bars do to the rotors on their left and right, shape (n,)."""
    sums = np.append(lefts, 0.0)
    sums[1:] += rights
    return sums
