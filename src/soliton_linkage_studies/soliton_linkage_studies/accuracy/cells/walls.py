# SPDX-License-Identifier: Apache-2.0
"""Where walls truly are in noiseless frames: the nearest point of their static path.

A kink costs nothing anywhere: its path is that of static walls, hung bar by bar. That of an
anti-kink are states of least energy, `anti_kink_path`. Where it is pinned instead, it rests in
balance, and its place is that of the sum of the field, `resting_anti_kink`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, wrapped
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.anti_kink import (
    anti_kink_path,
    continuum_anti_kink,
    resting_anti_kink,
)
from soliton_linkage.solitons.static_wall import static_wall

_SAMPLES = 65
"""Of a path, over the two spacings after which it repeats: splines of them are good to 1e-6."""
_LONGEST = 0.3
"""Step of the way to the nearest point [rad]."""
_GAUSS_STEPS = 6
"""At most, to the nearest point; from frame to frame two do [1]."""
_CLOSE = 1e-6
"""Step towards the nearest point that is the last [rad]."""


def reach(chain: Chain) -> float:
    """Rotors on either side that a wall bends by more than a hundredth [rotor spacings]."""
    return 2.5 * max(chain.wall_width, penetration_depth(chain)) / chain.spacing + 3


def extent(chain: Chain) -> int:
    """Rotors on either side of a path, beyond which a wall bends nothing [1], even."""
    return 2 * math.ceil((3 * reach(chain)) / 2)


@dataclass(frozen=True)
class WallPath:
    """A wall at any place of an endless chain."""

    charge: int
    beside: int
    """Place in its window from which on to two spacings beyond a wall is [rotor spacings]."""
    spline: CubicSpline | None
    """Angles of the window against the place in it [rotor spacings], shape (M,)."""
    resting: Array
    """Angles of the window at the place `home`."""
    home: float
    left: Array
    """Angles of an even and of an odd rotor far on the left [rad], shape (2,)."""

    @property
    def pinned(self) -> bool:
        """Whether the wall rests at places two spacings apart alone."""
        return self.spline is None

    def window(self, place: float) -> tuple[int, Array, Array]:
        """First rotor, angles [rad] and their change with the place [rad/spacing], (M,) each."""
        if self.spline is None:
            shift = 2 * round((place - self.home) / 2)
            return shift, self.resting, np.zeros_like(self.resting)
        shift = 2 * math.floor((place - self.beside) / 2)
        within = place - shift
        return shift, self.spline(within), self.spline(within, 1)

    def snapped(self, place: float) -> float:
        """The place nearest to a place where the wall can be."""
        return self.at_rest(place) if self.pinned else place

    def at_rest(self, place: float) -> float:
        """The nearest place like `home`, where an anti-kink costs least."""
        return self.home + 2 * round((place - self.home) / 2)

    def added(self, rotors: int, place: float) -> Array:
        """What the wall adds to the domain on its left, shape (rotors,) [rad]."""
        first, angles, _ = self.window(place)
        base = self._left(len(angles))
        added = np.zeros(rotors)
        numbers = np.arange(first, first + len(angles))
        inside = (numbers >= 0) & (numbers < rotors)
        added[numbers[inside]] = (angles - base)[inside]
        beyond = np.arange(max(first + len(angles), 0), rotors)
        ends = (angles - base)[-3:-1]
        added[beyond] = ends[(beyond - first - len(angles) + 1) % 2]
        return added

    def moving(self, rotors: int, place: float) -> Array:
        """How the angles change with the place [rad/spacing], shape (rotors,)."""
        first, _, slope = self.window(place)
        moving = np.zeros(rotors)
        numbers = np.arange(first, first + len(slope))
        inside = (numbers >= 0) & (numbers < rotors)
        moving[numbers[inside]] = slope[inside]
        return moving

    def nearest(self, angles: Array, place: float, within: float) -> float:
        """Place of the nearest static wall, from one close by, by the rotors so far from it."""
        if self.pinned:
            return self.snapped(place)
        numbers = np.arange(len(angles))
        for _ in range(_GAUSS_STEPS):
            first, wall, slope = self.window(place)
            low, high = max(first, 0), min(first + len(wall), len(angles))
            near = np.abs(numbers[low:high] - place) < within
            off = wrapped(angles[low:high] - wall[low - first : high - first])
            about = slope[low - first : high - first]
            size = float(about[near] @ about[near])
            step = float(off[near] @ about[near]) / size
            step = min(max(step, -_LONGEST / math.sqrt(size)), _LONGEST / math.sqrt(size))
            place += step
            if abs(step) * math.sqrt(size) < _CLOSE:
                break
        return place

    def misfit(self, angles: Array, place: float, within: float) -> float:
        """Root mean square of what a static wall leaves of the rotors so far from it [rad]."""
        first, wall, _ = self.window(place)
        low, high = max(first, 0), min(first + len(wall), len(angles))
        near = np.abs(np.arange(low, high) - place) < within
        off = wrapped(angles[low:high] - wall[low - first : high - first])[near]
        return math.sqrt(float(off @ off) / max(len(off), 1))

    def _left(self, count: int) -> Array:
        return np.tile(self.left, count // 2 + 1)[:count]


def nearest_arc(orbit: Orbit, angles: Array, arc: float) -> float:
    """Arc length [rad] of the nearest configuration on an orbit, from one close by."""
    for _ in range(_GAUSS_STEPS):
        about = orbit.stretch(arc)
        off = wrapped(angles[about.first : about.first + len(about.angles)] - about.angles)
        size = float(about.tangent @ about.tangent)
        step = min(max(float(off @ about.tangent) / size, -_LONGEST), _LONGEST)
        arc += step
        if abs(step) < _CLOSE:
            break
    return arc


@cache
def wall_path(chain: Chain, charge: int, leg: int = 0) -> WallPath:
    """Path of a wall of a charge far from the edges; kinks of spinners have one for each leg."""
    beside = extent(chain)
    window = replace(chain, number_of_rotors=2 * beside + 3, deviations=NO_DEVIATIONS)
    places = np.linspace(beside, beside + 2, _SAMPLES)
    if charge > 0:
        walls = np.unwrap([static_wall(window, place, leg) for place in places], axis=0)
        walls[:, 0], walls[:, -1] = walls[:, 2], walls[:, -3]
        left = walls[0, 2:4] - wrapped(walls[0, 2:4] - chain.uniform_state(1)[:2])
        spline = CubicSpline(places, walls)
        return WallPath(1, beside, spline, walls[0], float(places[0]), left)
    left = continuum_anti_kink(window, beside)[:2]
    try:
        counted, found = anti_kink_path(window, beside)
    except ArithmeticError:
        home, rest = resting_anti_kink(window, beside + 0.5)
        return WallPath(-1, beside, None, rest, home, left)
    least = int(np.argmin(window.elastic_energy(found)))
    spline = CubicSpline(counted, found)
    return WallPath(-1, beside, spline, found[least], float(counted[least]), left)
