# SPDX-License-Identifier: Apache-2.0
"""Walls that move without phonons, made in long chains whose far rotors are damped."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage_studies.accuracy.cells.springs import Springs
from soliton_linkage_studies.accuracy.cells.walls import WallPath, reach, wall_path

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
