# SPDX-License-Identifier: Apache-2.0
"""The whole cycle of a chain of any length, put together from the orbit of a short one.

Away from the edges a wall looks the same at every second rotor. The closed orbit of a chain that
is just long enough for a wall to know nothing of either edge therefore holds all that a long
chain does: its swings at the edges, and in the middle of each leg a passage that is repeated,
shifted by an even number of rotors. Time and memory to make it do not depend on N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from soliton_linkage.bands import penetration_depth
from soliton_linkage.chain import Array, Chain, Motion
from soliton_linkage.orbit import Orbit, closed_orbit
from soliton_linkage.static_wall import site_arc, static_wall

_DEPTHS_BESIDE = 12
_ROTORS_BESIDE = 6


@dataclass(frozen=True)
class Stretch:
    """Rotors first ... first + n - 1 of a configuration, and how they move along the orbit."""

    first: int
    """Number of the first rotor."""
    angles: Array
    """Actual angles [rad], shape (n,)."""
    tangent: Array
    """Change of the angles with the arc length [1], shape (n,); below rounding on all others."""


class Cycle:
    """The closed orbit of a chain without deviations, as a curve in its arc length.

    The arc [rad] is 0 where the wall is reflected at the first rotor and leg 0 begins, in which
    no edge rotor of a flipper has toggled; it grows towards the last rotor in even legs and back
    in odd ones, up to the length of the whole cycle, and may be any number. The chain is the
    one whose uniform right-leaning state is theta = theta_bar; that which was assembled upside
    down is its image phi -> pi - phi. Raises ValueError as `static_wall` and `closed_orbit` do.
    """

    def __init__(self, chain: Chain, spacing: float = 0.1) -> None:
        """Follow the short chain once round its orbit, in samples of arc length [rad]."""
        self.chain = chain
        self.number_of_legs = 2 if chain.motion is Motion.SPINNER else 4
        self.site_arc = site_arc(chain)
        depth = penetration_depth(chain) / chain.spacing
        beside = math.ceil(_DEPTHS_BESIDE * depth) + _ROTORS_BESIDE
        fewest = 2 * beside + chain.number_of_rotors % 2
        self._short = replace(chain, number_of_rotors=min(chain.number_of_rotors, fewest))
        self._repeats = (chain.number_of_rotors - self._short.number_of_rotors) // 2
        self._orbit = _from_the_middle(self._short, spacing)
        self._middles = self._arcs_of_middles()
        self._begins = self._arcs_of_reflections()
        extra = 2 * self._repeats * self.site_arc
        inner = np.diff([*self._begins, self._begins[0] + self._orbit.length])
        self._starts = np.concatenate([[0.0], np.cumsum(inner + extra)])

    @property
    def length(self) -> float:
        """Arc length of the whole cycle [rad]."""
        return float(self._starts[-1])

    @property
    def middle(self) -> float:
        """Place in the middle of the chain [rotor spacings]."""
        return (self.chain.number_of_rotors - 1) / 2

    @property
    def reach(self) -> float:
        """Arc length [rad] of a way past all the rotors that know of a wall."""
        rotors = self._short.number_of_rotors
        return rotors * self.site_arc + self._edge_swing

    def leg_arcs(self, leg: int) -> tuple[float, float]:
        """Arc lengths [rad] at which a leg begins and ends."""
        return float(self._starts[leg]), float(self._starts[leg + 1])

    def leg(self, arc: float) -> int:
        """Leg of the cycle at an arc length: 0 to 3 for flippers, 0 or 1 for spinners."""
        within = arc % self.length
        return min(
            int(np.searchsorted(self._starts, within, 'right')) - 1, self.number_of_legs - 1
        )

    def place(self, arc: float) -> float:
        """Place of the wall [rotor spacings], from 0 to N - 1; at the edges it waits there."""
        leg = self.leg(arc)
        halfway = self._starts[leg] + self._middles[leg] - self._begins[leg]
        beyond = float(arc % self.length - halfway) / self.site_arc - self._repeats
        place = self.middle + beyond if leg % 2 == 0 else self.middle - beyond
        return min(max(place, 0.0), self.chain.number_of_rotors - 1.0)

    def arc_at(self, place: float, leg: int) -> float:
        """Arc length at which the wall is at a place [rotor spacings] in the middle of a leg."""
        beyond = place - self.middle if leg % 2 == 0 else self.middle - place
        halfway = self._starts[leg] + self._middles[leg] - self._begins[leg]
        return float(halfway + (beyond + self._repeats) * self.site_arc)

    def stretch(self, arc: float) -> Stretch:
        """Rotors about the wall at an arc length; all others are as in `background`."""
        leg = self.leg(arc)
        beyond = arc % self.length - self._starts[leg]
        before = self._middles[leg] - self._begins[leg]
        repeats = (beyond - before) / (2 * self.site_arc)
        whole = min(max(math.floor(repeats), 0), self._repeats)
        within = self._begins[leg] + beyond - 2 * whole * self.site_arc
        offset = 2 * (whole if leg % 2 == 0 else self._repeats - whole)
        # Edge rotors of the short chain stand where the long one has none, but at its ends.
        low = 0 if offset == 0 else 1
        rotors = self._short.number_of_rotors
        high = rotors if offset == 2 * self._repeats else rotors - 1
        angles, tangent = self._orbit.sample(within)
        return Stretch(offset + low, angles[low:high], tangent[low:high])

    def background(self, arc: float) -> tuple[Array, Array]:
        """Angles of the chain as it is on the left and on the right of the wall [rad], (N,) each.

        Uniform, but for the edge rotors of flippers, which have toggled or not.
        """
        leg = self.leg(arc)
        sides = [self.chain.uniform_state(1), self._left_leaning.copy()]
        edges = self._orbit.configuration(self._middles[leg])
        sides[0][0], sides[1][-1] = edges[0], edges[-1]
        return sides[0], sides[1]

    def configuration(self, arc: float) -> Array:
        """Angles of the whole chain at an arc length [rad], shape (N,)."""
        angles, right = self.background(arc)
        about = self.stretch(arc)
        beyond = about.first + len(about.angles)
        angles[beyond:] = right[beyond:]
        angles[about.first : beyond] = about.angles
        return angles

    @cached_property
    def _edge_swing(self) -> float:
        """Arc length of a leg beyond that from the first rotor to the last [rad], delta."""
        leg = float(self._starts[1] - self._starts[0])
        return leg - (self.chain.number_of_rotors - 1) * self.site_arc

    @cached_property
    def _left_leaning(self) -> Array:
        if self.chain.motion is Motion.SPINNER:
            return self.chain.uniform_state(1) + math.pi
        return self.chain.uniform_state(-1)

    def _arcs_of_middles(self) -> Array:
        """Arc of the short orbit at which each leg has its wall in the middle, (legs,)."""
        middle = (self._short.number_of_rotors - 1) / 2
        walls = [static_wall(self._short, middle, leg) for leg in range(self.number_of_legs)]
        arcs = [_arc_of(self._orbit, wall) for wall in walls]
        arcs[0] = 0.0
        return np.array(arcs)

    def _arcs_of_reflections(self) -> Array:
        """Arc of the short orbit at which each leg begins, the first below 0, (legs,)."""
        turns = [arc for arc, _ in self._orbit.reflections]
        return np.array([turns[-1] - self._orbit.length, *turns[:-1]])


def _from_the_middle(chain: Chain, spacing: float) -> Orbit:
    """Orbit that starts with the wall in the middle of leg 0, towards the last rotor."""
    start = static_wall(chain, (chain.number_of_rotors - 1) / 2)
    orbit = closed_orbit(chain, start, spacing)
    return orbit if orbit.directions[0] > 0 else orbit.reversed()


def _arc_of(orbit: Orbit, angles: Array) -> float:
    """Arc length [rad] at which an orbit has a configuration that is on it, up to turns."""
    nearest = int(np.argmax(np.cos(orbit.angles - angles).sum(axis=1)))
    spacing = float(orbit.arcs[1])

    def ahead(arc: float) -> float:
        there, tangent = orbit.sample(arc)
        return float(np.sin(angles - there) @ tangent)

    return float(brentq(ahead, orbit.arcs[nearest] - spacing, orbit.arcs[nearest] + spacing))
