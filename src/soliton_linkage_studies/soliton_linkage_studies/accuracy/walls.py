# SPDX-License-Identifier: Apache-2.0
"""Where walls truly are in noiseless frames: the nearest point of their static path.

A kink costs nothing anywhere: its path is that of static walls, hung bar by bar. That of an
anti-kink are states of least energy, `anti_kink_path`. Where it is pinned instead, it rests in
balance, and its place is that of the sum of the field, `resting_anti_kink`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from soliton_linkage.linear.bands import penetration_depth, speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.anti_kink import (
    anti_kink_path,
    continuum_anti_kink,
    resting_anti_kink,
)
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies.accuracy.springs import Springs

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
        about = orbit.segment(arc)
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


_SETTLING = (60.0, 400.0)
"""Time in which a wall loses its phonons [time units]."""
_ABSORPTION = 0.5
"""Damping of rotors that a settling wall does not reach [1 / time unit]."""
_BROKEN = 0.15
"""Misfit of what is no wall any more, over the swing of a rotor [1]."""
_STEP = 0.5
"""From place to place of a settling wall [time units]."""
_SLOWER = 0.8
"""Factor of the speed that is tried where a wall breaks up."""
_TRIES = 25
"""Speeds that are tried, the last 1 / 200 of the first [1]."""


@dataclass(frozen=True)
class Dressed:
    """A wall that moves without phonons: what it has beside the static one."""

    place: float
    """In a long chain [rotor spacings]."""
    first: int
    """Rotor of it from which on it is known."""
    beside: Array
    """Angles beside those of the static wall [rad], shape (M,)."""
    rates: Array
    """Of the same rotors [rad/s], shape (M,)."""
    speed: float
    """Of the wall [rotor spacings / s]."""


def launch_speed(chain: Chain, share: float) -> float:
    """Speed [rotor spacings / s] of a static wall that ends at a share of that of sound."""
    sound = speed_of_sound(chain) / chain.spacing
    return sound * math.sqrt(2 * (1 / math.sqrt(1 - share**2) - 1))


@lru_cache(maxsize=8)
def dressed(chain: Chain, leg: int, share: float) -> Dressed:
    """A wall in motion in a long chain, as fast as asked for or as it stays whole."""
    speed = launch_speed(chain, share)
    for _ in range(_TRIES):
        found = _settled(chain, wall_path(chain, 1, leg), speed)
        if found is not None:
            return found
        speed *= _SLOWER
    raise ArithmeticError(f'no wall stays whole in a chain with d = {chain.lean_ratio:.4g}')


def _settled(chain: Chain, path: WallPath, speed: float) -> Dressed | None:
    """The wall after its phonons have left it, None where it breaks up."""
    near, unit = reach(chain), chain.time_unit
    shortest, longest = _SETTLING
    time = min(max(2 * near / (speed * unit), shortest), longest)
    rotors = math.ceil(6 * near + 1.3 * speed * unit * time)
    long = replace(chain, number_of_rotors=rotors + rotors % 2)
    springs = _launched(long, path, 3 * near, speed)
    way = _way(springs, path, 3 * near, near, round(time / _STEP))
    if way is None:
        return None
    late = np.array(way[-len(way) // 3 :])
    found = float(np.polyfit(np.arange(len(late)), late, 1)[0]) / springs.period
    if found <= 0:
        return None
    first = 2 * (round(way[-1] - 1.5 * near) // 2)
    window = slice(first, first + 2 * round(1.5 * near) + 1)
    static = left_of(long, 1) + path.added(long.number_of_rotors, way[-1])
    beside = wrapped(springs.angles - static)[window]
    return Dressed(way[-1], first, beside, springs.rates[window].copy(), found)


def _launched(chain: Chain, path: WallPath, place: float, speed: float) -> Springs:
    rotors = chain.number_of_rotors
    static = left_of(chain, 1) + path.added(rotors, place)
    return Springs(chain, static, speed * path.moving(rotors, place), _STEP * chain.time_unit)


def _way(
    springs: Springs, path: WallPath, place: float, near: float, frames: int
) -> list[float] | None:
    """Places of a wall while its phonons are absorbed, None where it breaks up."""
    chain = springs.chain
    rotors = np.arange(chain.number_of_rotors)
    way = [place]
    for _ in range(frames):
        springs.advance(_ABSORPTION / chain.time_unit * (np.abs(rotors - place) > near))
        ahead = way[-1] - way[-2] if len(way) > 1 else 0.0
        place = path.nearest(springs.angles, way[-1] + ahead, near)
        way.append(place)
        inside = near < place < chain.number_of_rotors - 1 - near
        if not inside or is_broken(path, chain, springs.angles, place, near):
            return None
    return way


def dress(wall: Dressed, shift: int, angles: Array, rates: Array, sense: int) -> None:
    """Add to a static wall what it has in motion, its rotors shifted."""
    numbers = np.arange(len(wall.beside)) + wall.first + shift
    inside = (numbers >= 0) & (numbers < len(angles))
    angles[numbers[inside]] += wall.beside[inside]
    rates[numbers[inside]] += sense * wall.rates[inside]


def left_of(chain: Chain, charge: int) -> Array:
    """Domain on the left of a wall of a charge, shape (N,) [rad]."""
    if charge > 0:
        return chain.uniform_state(1)
    if chain.motion is Motion.SPINNER:
        return chain.uniform_state(1) + math.pi
    return chain.uniform_state(-1)


def is_broken(path: WallPath, chain: Chain, angles: Array, place: float, within: float) -> bool:
    """Whether the rotors so far from a place make no wall any more."""
    swing = math.pi if chain.motion is Motion.SPINNER else 2 * chain.rest_angle
    return path.misfit(angles, place, within) > _BROKEN * swing
