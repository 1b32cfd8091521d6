# SPDX-License-Identifier: Apache-2.0
"""How far small deviations of lengths that nobody told move a wall, to first order.

With shares p by which rotors and their distances differ, bars keep their lengths where the angles
change by dphi with R dphi + E p = 0, dphi orthogonal to the zero mode t. A wall is where it was if
the share S_b of |t|^2 on the left of its bond b is what it was (`DeviatingOrbit`). With the shares
S_n on the left of all bonds and t_{n+1} / t_n = -A_n / B_n, that share is changed by

    dQ = sum_n w_n d ln|A_n / B_n|,   w_n = min(S_n / S_b, (1 - S_n) / (1 - S_b)),

through the angles and the lengths, dQ = Q_phi . dphi + Q_p . p, and the arc is off by ds with
Q_phi . t ds = dQ. R^+ E has not to be known: Q_phi . R^+ E = u . E with (R R^T) u = R Q_phi.
Stiffnesses and masses move no wall at rest.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.linalg import solveh_banded

from soliton_linkage.linear.statics import banded_products
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit, Stretch
from soliton_linkage.orbit.uniform_orbit import UniformOrbit


class WallShifts:
    """Shifts of the wall of a chain by deviations, over what these do to rotors far from it."""

    def __init__(self, orbit: Orbit) -> None:
        """Take a chain without deviations for one with those that were told."""
        chain = replace(orbit.chain, deviations=NO_DEVIATIONS)
        self._orbit = orbit if orbit.chain == chain else UniformOrbit(chain)
        self._known: dict[tuple[int, int], float] = {}
        self._far: float | None = None

    def ratio(self, place: float, leg: int) -> float:
        """Standard deviation of the shift of the arc over that of a rotor far from it [1].

        Of deviations of lengths that are as large for all. Variances at a place [rotor spacings]
        are between those of the bonds on either side, which are worked out where first wanted.
        """
        last = self._orbit.chain.number_of_rotors - 2
        before = min(max(place - 0.5, 0.0), last)
        bond = min(math.floor(before), last - 1)
        here, there = (self._variance(each, leg) for each in (bond, bond + 1))
        return math.sqrt(here + (before - bond) * (there - here))

    def _variance(self, bond: int, leg: int) -> float:
        if (leg, bond) not in self._known:
            if self._far is None:
                middle = self._orbit.stretch(self._orbit.arc_at(self._orbit.middle, 0))
                self._far = _BarsAboutWall(self._orbit.chain, middle).of_far_rotor()
            about = self._orbit.stretch(self._orbit.arc_at(bond + 0.5, leg))
            bars = _BarsAboutWall(self._orbit.chain, about)
            self._known[leg, bond] = (bars.of_arc(bond - about.first) / self._far) ** 2
        return self._known[leg, bond]


class _BarsAboutWall:
    """Bars between the rotors about a wall: what moves by deviations of lengths, of 1 each.

    With c = h v' - v h' of the masses that a bar joins, its levers are l A = c - a v and
    l B = a v' - c, so that all derivatives are products of positions.
    """

    def __init__(self, chain: Chain, about: Stretch) -> None:
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

    def of_far_rotor(self) -> float:
        """Deviation of the angle of the rotor next to the first, which may lean any way [rad]."""
        rotor = np.zeros(len(self._tangent))
        rotor[1] = 1.0
        return self._size(rotor, *np.zeros((3, len(self._first))))

    def of_arc(self, bond: int) -> float:
        """Deviation of the arc that has its share of the mode on the left of a bond [rad]."""
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
        by_lengths = (
            -on_first * a * v - on_second * a * v_next,
            on_first * self._first + on_second * self._turned,
            on_first * self._turned - on_second * self._second,
        )
        return self._size(by_angles, *by_lengths) / abs(float(by_angles @ self._tangent))

    def _size(self, by_angles: Array, by_spacing: Array, by_left: Array, by_right: Array) -> float:
        """Deviation of what changes so much with angles, shape (n,), and with lengths.

        These are of each bar its spacing and the rotors on its left and right, shape (n - 1,).
        """
        pulled = self._first * by_angles[:-1] + self._second * by_angles[1:]
        bars = solveh_banded(banded_products(self._first, self._second), pulled)
        (h, v), (h_next, v_next) = self._left, self._right
        of_spacings = by_spacing - bars * self._spacing * self._across
        of_rotors = _gathered(
            by_left + bars * (self._across * h + self._up * v),
            by_right - bars * (self._across * h_next + self._up * v_next),
        )
        return math.sqrt(float(of_spacings @ of_spacings + of_rotors @ of_rotors))


def _gathered(lefts: Array, rights: Array) -> Array:
    """Sums of what bars do to the rotors on their left and right, shape (n,)."""
    sums = np.append(lefts, 0.0)
    sums[1:] += rights
    return sums
