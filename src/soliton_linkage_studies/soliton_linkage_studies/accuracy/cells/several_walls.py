# SPDX-License-Identifier: Apache-2.0
"""Kinks and anti-kinks in turn, until some of them meet or come to an edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage_studies.accuracy.cells.cells import AccuracyCell
from soliton_linkage_studies.accuracy.cells.launching import dress, dressed, is_broken, left_of
from soliton_linkage_studies.accuracy.cells.scene import WallScene, frames_beside, smoothed
from soliton_linkage_studies.accuracy.cells.springs import Springs
from soliton_linkage_studies.accuracy.cells.walls import WallPath, reach, wall_path

_FEWEST = 20
"""Frames of a scene [1]."""
_DRAWS = 20
"""Of places, until walls have so many frames before they meet or break up."""
_SLOWER = 0.7
"""Factor of the speed of anti-kinks, which rest, from draw to draw after one that broke up."""
_JITTER = 0.05
"""Of the places of the walls at the start, over their distance [1]."""
_CORE = 3.0
"""Reach of the rotors that tell whether a wall is broken [rotor spacings]."""


@dataclass
class _MovingWalls:
    """Walls of a chain in motion."""

    angles: Array
    rates: Array
    paths: list[WallPath]
    places: list[float]
    speeds: list[float]
    """[rotor spacings / s]"""


def several_walls(cell: AccuracyCell, frames: int, random: np.random.Generator) -> WallScene:
    """As many frames as are asked for, or until walls meet; raises ArithmeticError for few."""
    for draw in range(_DRAWS):
        begins = 1 if random.integers(2) else -1
        charges = tuple(begins * (-1) ** number for number in range(cell.walls))
        walls = _placed(cell, charges, _SLOWER**draw, random)
        noise = random.standard_normal(cell.chain.number_of_rotors)
        walls.rates += cell.phonons / cell.chain.time_unit * noise
        scene = _followed(cell, frames, charges, walls)
        if len(scene.angles) >= min(_FEWEST, frames):
            return scene
    raise ArithmeticError(f'cell {cell.name}: walls have no room for {_FEWEST} frames')


def _placed(
    cell: AccuracyCell, charges: tuple[int, ...], slower: float, random: np.random.Generator
) -> _MovingWalls:
    chain, near = cell.chain, reach(cell.chain)
    rotors = chain.number_of_rotors
    walls = _MovingWalls(left_of(chain, charges[0]), np.zeros(rotors), [], [], [])
    gap = (rotors - 1 - near) / len(charges)
    for number, charge in enumerate(charges):
        leg = int(random.integers(2)) if chain.motion is Motion.SPINNER else 0
        path = wall_path(chain, charge, leg if charge > 0 else 0)
        aside = float(random.uniform(-_JITTER, _JITTER))
        place = near / 2 + gap * (number + 0.5 + aside)
        sense = 1 if random.integers(2) else -1
        if charge > 0:
            wall = dressed(chain, leg, cell.speed)
            shift = 2 * round((place - wall.place) / 2)
            place, speed = wall.place + shift, wall.speed
            dress(wall, shift, walls.angles, walls.rates, sense)
        else:
            place = path.snapped(place) if slower == 1 else path.at_rest(place)
            speed = slower * cell.speed * speed_of_sound(chain) / chain.spacing
            walls.rates += sense * speed * path.moving(rotors, place)
        walls.angles += path.added(rotors, place)
        walls.paths.append(path)
        walls.places.append(place)
        walls.speeds.append(speed)
    return walls


def _followed(
    cell: AccuracyCell, frames: int, charges: tuple[int, ...], walls: _MovingWalls
) -> WallScene:
    chain, near = cell.chain, reach(cell.chain)
    last, period = chain.number_of_rotors - 1, cell.period * chain.time_unit
    springs = Springs(chain, walls.angles, walls.rates, period)
    shots: list[Array] = []
    kinetic: list[float] = []
    way: list[Array] = []
    places = walls.places
    for frame in range(frames):
        if frame:
            springs.advance()
        guesses = places if len(way) < 2 else (2 * way[-1] - way[-2]).tolist()
        both = zip(walls.paths, guesses, strict=True)
        places = [path.nearest(springs.angles, guess, near) for path, guess in both]
        apart = np.diff([-near, *places, last + near])
        both = zip(walls.paths, places, strict=True)
        broken = any(is_broken(path, chain, springs.angles, x, _CORE) for path, x in both)
        if broken or apart.min() < 2 * near:
            break
        shots.append(springs.angles.copy())
        kinetic.append(float(chain.kinetic_energy(springs.rates)))
        way.append(np.array(places))
    track = np.array(way).reshape(-1, len(charges))
    beside = [frames_beside(speed, cell) for speed in walls.speeds]
    means = [smoothed(column, count) for column, count in zip(track.T, beside, strict=True)]
    return WallScene(
        angles=np.array(shots),
        kinetic=np.array(kinetic),
        places=np.stack([mean for mean, _ in means], axis=1),
        instants=track,
        place_rates=np.stack([slope / period for _, slope in means], axis=1),
        charges=charges,
        legs=np.full(len(shots), -1),
        judged=np.ones(track.shape, dtype=bool),
    )
