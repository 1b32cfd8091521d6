# SPDX-License-Identifier: Apache-2.0
"""Walls on their way along chains of springs, and where they truly are.

The place of a wall is that of the nearest point of its static path to the noiseless frame, as it
is on the mean of one period of the slowest phonon, or of the passage of a rotor where that is
shorter: phonons that only shake the wall do not count, what it does more slowly does. Its rate is
the slope of a line through the places of three times as long. Pushes part a record: no mean
reaches across them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import pairwise

import numpy as np

from soliton_linkage.linear.bands import gap, speed_of_sound
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.studies.accuracy.cells.cells import Cell
from soliton_linkage.studies.accuracy.cells.springs import Springs
from soliton_linkage.studies.accuracy.cells.walls import (
    WallPath,
    nearest_arc,
    reach,
    wall_path,
)

Flags = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

_SETTLING = (60.0, 400.0)
"""Time in which a wall loses its phonons [time units]."""
_ABSORPTION = 0.5
"""Damping of rotors that a settling wall does not reach [1 / time unit]."""
_BROKEN = 0.15
"""Misfit of what is no wall any more, over the swing of a rotor [1]."""
_SLOWER = 0.8
"""Factor of the speed that is tried where a wall breaks up."""
_TRIES = 15
_FROM_EDGE = 1.0
"""Places nearer to an edge are not judged [rotor spacings]: there a wall is swallowed."""
_FEWEST = 20
"""Frames of a scene of several walls [1]."""
_DRAWS = 20
"""Of deviations, until there are some that a wall passes."""
_PUSHED = 1.5
"""Rotors beside a wall that a hand pushes [rotor spacings]."""


@dataclass(frozen=True)
class Scene:
    """Noiseless frames and the walls in them."""

    angles: Array
    """Actual angles [rad], shape (T, N)."""
    kinetic: Array
    """Kinetic energy [J], shape (T,)."""
    places: Array
    """Of the walls [rotor spacings], shape (T, K)."""
    instants: Array
    """The same without a mean over time."""
    place_rates: Array
    """Rates of the places [rotor spacings / s], shape (T, K)."""
    charges: tuple[int, ...]
    legs: Array
    """Of the orbit, where a wall is alone, else -1, shape (T,)."""
    judged: Flags
    """Whether a wall is far enough from the edges and from others, shape (T, K)."""
    pushes: tuple[int, ...] = ()
    """Frames at which the wall was pushed, first of the new motion."""
    impulses: tuple[Array, ...] = ()
    """Angular impulses of the pushes [N m s], shape (N,) each."""


@dataclass(frozen=True)
class Dressed:
    """A wall that moves without phonons: what it has beside the static one."""

    place: float
    first: int
    beside: Array
    """Angles beside those of the static wall [rad], of rotors from the first on."""
    rates: Array
    """[rad/s]"""
    speed: float
    """[rotor spacings / s]"""


def scene_of(cell: Cell, frames: int, random: np.random.Generator, pushes: int = 0) -> Scene:
    """A scene of at least so many frames, but where several walls meet."""
    if cell.nothing:
        return _nothing(cell, frames, random)
    if cell.kick:
        return _broken(cell, frames, random)
    if cell.walls > 1:
        return _several(cell, frames, random)
    return _alone(cell, frames, random, pushes)


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
    begin = 3 * near
    rotors = math.ceil(2 * begin + 1.3 * speed * unit * time)
    long = replace(chain, number_of_rotors=rotors + rotors % 2)
    place, step = begin, 0.5
    static = _left(long, 1) + path.added(long.number_of_rotors, place)
    rates = speed * path.moving(long.number_of_rotors, place)
    springs = Springs(long, static, rates, step * unit)
    numbers, swing = np.arange(long.number_of_rotors), _swing(chain)
    way: list[float] = []
    for _ in range(round(time / step)):
        damping = _ABSORPTION / unit * (np.abs(numbers - place) > near)
        springs.advance(damping)
        guess = place + (way[-1] - way[-2] if len(way) > 1 else speed * step * unit)
        place = path.nearest(springs.angles, guess, near)
        way.append(place)
        inside = near < place < long.number_of_rotors - 1 - near
        if not inside or path.misfit(springs.angles, place, near) > _BROKEN * swing:
            return None
    late = np.array(way[-len(way) // 3 :])
    found = float(np.polyfit(np.arange(len(late)), late, 1)[0]) / (step * unit)
    if found <= 0:
        return None
    first = 2 * (round(place - 1.5 * near) // 2)
    window = slice(first, first + 2 * round(1.5 * near) + 1)
    static = _left(long, 1) + path.added(long.number_of_rotors, place)
    beside = wrapped(springs.angles - static)[window]
    return Dressed(place, first, beside, springs.rates[window].copy(), found)


def _dress(wall: Dressed, shift: int, angles: Array, rates: Array, sense: int) -> None:
    """Add to a static wall what it has in motion, its rotors shifted."""
    numbers = np.arange(len(wall.beside)) + wall.first + shift
    inside = (numbers >= 0) & (numbers < len(angles))
    angles[numbers[inside]] += wall.beside[inside]
    rates[numbers[inside]] += sense * wall.rates[inside]


def _alone(cell: Cell, frames: int, random: np.random.Generator, pushes: int) -> Scene:
    """One wall, anywhere on its orbit."""
    chain = cell.chain
    true, orbit = _orbit(cell, random)
    last, period = chain.number_of_rotors - 1, cell.period * chain.time_unit
    leg = int(random.integers(orbit.number_of_legs))
    sense = 1 if random.integers(2) else -1
    place = float(random.uniform(2.0, last - 2.0))
    if cell.disorder:
        speed = launch_speed(chain, cell.speed)
        arc = orbit.arc_at(place, leg)
        angles = orbit.configuration(arc)
        rates = sense * speed * orbit.site_arc * orbit.tangent(arc)
    else:
        wall = dressed(chain, leg if chain.motion is Motion.SPINNER else 0, cell.speed)
        speed = wall.speed
        shift = 2 * round((place - wall.place) / 2)
        arc = orbit.arc_at(wall.place + shift, leg)
        angles, rates = orbit.configuration(arc), np.zeros(last + 1)
        _dress(wall, shift, angles, rates, sense * (1 if leg % 2 == 0 else -1))
    rates += cell.phonons / chain.time_unit * random.standard_normal(last + 1)
    beside = _passage(speed, cell)
    springs = Springs(true, angles, rates, period)
    total = frames + 2 * 3 * beside
    at = sorted(random.choice(np.arange(1, total - 1), pushes, replace=False).tolist())
    shots, kinetic, impulses = [], [], []
    arcs: list[float] = []
    for frame in range(total):
        if frame:
            springs.advance()
            arc = nearest_arc(orbit, springs.angles, 2 * arcs[-1] - arcs[-2] if frame > 1 else arc)
        else:
            arc = nearest_arc(orbit, springs.angles, arc)
        if frame in at:
            impulses.append(_push(springs, orbit, arc, speed, random))
        shots.append(springs.angles.copy())
        kinetic.append(float(true.kinetic_energy(springs.rates)))
        arcs.append(arc)
    kept = slice(3 * beside, total - 3 * beside)
    instants = np.array([orbit.place(each) for each in arcs])[kept, None]
    mean, slope = smoothed(np.array(arcs), beside, at)
    places = np.array([orbit.place(each) for each in mean])[kept, None]
    legs = np.array([orbit.leg(each) for each in mean])[kept]
    spacing = np.array([orbit.site_arc_at(each) for each in mean])[kept]
    place_rates = np.where(legs % 2 == 0, 1, -1) * slope[kept] / (period * spacing)
    inner = np.minimum(places, instants) > _FROM_EDGE
    inner &= np.maximum(places, instants) < last - _FROM_EDGE
    inside = [(number, frame - kept.start) for number, frame in enumerate(at)]
    inside = [(number, frame) for number, frame in inside if 0 < frame < frames]
    return Scene(
        np.array(shots)[kept],
        np.array(kinetic)[kept],
        places,
        instants,
        place_rates[:, None],
        (1,),
        legs,
        inner,
        tuple(frame for _, frame in inside),
        tuple(impulses[number] for number, _ in inside),
    )


def _push(
    springs: Springs, orbit: Orbit, arc: float, speed: float, random: np.random.Generator
) -> Array:
    """Push the rotors next to the wall, by up to half its speed; returns the impulses [N m s]."""
    numbers = np.arange(orbit.chain.number_of_rotors)
    near = np.abs(numbers - orbit.place(arc)) < _PUSHED
    change = near * orbit.tangent(arc) * orbit.site_arc * speed * random.uniform(-0.5, 0.5)
    springs.rates += change
    return np.asarray(springs.chain.moments_of_inertia * change)


def _several(cell: Cell, frames: int, random: np.random.Generator) -> Scene:
    """Kinks and anti-kinks in turn, until some of them meet or come to an edge."""
    for _ in range(_DRAWS):
        scene = _several_drawn(cell, frames, random)
        if scene is not None:
            return scene
    raise ArithmeticError(f'cell {cell.name}: walls have no room for {_FEWEST} frames')


def _several_drawn(cell: Cell, frames: int, random: np.random.Generator) -> Scene | None:
    chain, count = cell.chain, cell.walls
    rotors, period, near = chain.number_of_rotors, cell.period * chain.time_unit, reach(chain)
    begins = 1 if random.integers(2) else -1
    charges = [begins * (1 if number % 2 == 0 else -1) for number in range(count)]
    angles, rates = _left(chain, begins), np.zeros(rotors)
    gap = (rotors - 1 - near) / count
    paths, places, speeds = [], [], []
    for number, charge in enumerate(charges):
        leg = int(random.integers(2)) if chain.motion is Motion.SPINNER else 0
        path = wall_path(chain, charge, leg if charge > 0 else 0)
        place = near / 2 + gap * (number + 0.5 + float(random.uniform(-0.05, 0.05)))
        sense = 1 if random.integers(2) else -1
        if charge > 0:
            wall = dressed(chain, leg, cell.speed)
            shift = 2 * round((place - wall.place) / 2)
            place = wall.place + shift
            angles += path.added(rotors, place)
            _dress(wall, shift, angles, rates, sense)
            speeds.append(wall.speed)
        else:
            place = path.snapped(place)
            angles += path.added(rotors, place)
            speed = cell.speed * speed_of_sound(chain) / chain.spacing
            rates += sense * speed * path.moving(rotors, place)
            speeds.append(speed)
        paths.append(path)
        places.append(place)
    rates += cell.phonons / chain.time_unit * random.standard_normal(rotors)
    springs = Springs(chain, angles, rates, period)
    shots, kinetic = [], []
    way: list[Array] = []
    for frame in range(frames):
        if frame:
            springs.advance()
        guesses = places if len(way) < 2 else (2 * way[-1] - way[-2]).tolist()
        places = [
            path.nearest(springs.angles, place, near)
            for path, place in zip(paths, guesses, strict=True)
        ]
        apart = np.diff([near - 2 * near, *places, rotors - 1 + near])
        off = [path.misfit(springs.angles, x, 3) for path, x in zip(paths, places, strict=True)]
        if apart.min() < 2 * near or max(off) > _BROKEN * _swing(chain):
            break
        shots.append(springs.angles.copy())
        kinetic.append(float(chain.kinetic_energy(springs.rates)))
        way.append(np.array(places))
    if len(shots) < min(_FEWEST, frames):
        return None
    track = np.array(way)
    beside = [_passage(speed, cell) for speed in speeds]
    smooth = [smoothed(column, each) for column, each in zip(track.T, beside, strict=True)]
    return Scene(
        np.array(shots),
        np.array(kinetic),
        np.stack([mean for mean, _ in smooth], axis=1),
        track,
        np.stack([slope / period for _, slope in smooth], axis=1),
        tuple(charges),
        np.full(len(shots), -1),
        np.ones(track.shape, dtype=bool),
    )


def _broken(cell: Cell, frames: int, random: np.random.Generator) -> Scene:
    """What a kick of the edge leaves: frames in which no wall need be."""
    from soliton_linkage.linear.rigidity import mode_towards_last

    chain = cell.chain
    angles = chain.uniform_state(-1)
    rates = cell.kick / chain.time_unit * mode_towards_last(chain, angles)
    springs = Springs(chain, angles, rates, cell.period * chain.time_unit)
    for _ in range(int(random.integers(20, 400))):
        springs.advance()
    motion = springs.record(frames)
    return _empty(motion.angles, np.asarray(chain.kinetic_energy(motion.rates)))


def _nothing(cell: Cell, frames: int, random: np.random.Generator) -> Scene:
    angles = random.uniform(-math.pi, math.pi, (frames, cell.chain.number_of_rotors))
    return _empty(angles, np.full(frames, math.nan))


def _empty(angles: Array, kinetic: Array) -> Scene:
    none = np.empty((len(angles), 0))
    legs = np.full(len(angles), -1)
    return Scene(angles, kinetic, none, none, none, (), legs, none.astype(bool))


def _orbit(cell: Cell, random: np.random.Generator) -> tuple[Chain, Orbit]:
    """The chain as it is, and its orbit; deviations are drawn until a wall passes them."""
    if not cell.disorder:
        return cell.chain, _uniform_orbit(cell.chain)
    for _ in range(_DRAWS):
        seed = int(random.integers(2**31))
        drawn = drawn_deviations(
            cell.chain.number_of_rotors,
            seed,
            spacing=cell.disorder,
            rotor_length=cell.disorder,
            stiffness=cell.disorder,
            mass=cell.disorder,
        )
        chain = replace(cell.chain, deviations=drawn)
        try:
            return chain, orbit_of(chain)
        except (ValueError, ArithmeticError):
            continue
    raise ArithmeticError(f'cell {cell.name}: no wall passes {cell.disorder:g} of disorder')


@cache
def _uniform_orbit(chain: Chain) -> Orbit:
    return orbit_of(chain)


def _passage(speed: float, cell: Cell) -> int:
    """Half the frames of a mean."""
    time = 1 / max(abs(speed), gap(cell.chain) / (2 * math.pi))
    return max(round(time / (cell.period * cell.chain.time_unit) / 2), 1)


def smoothed(values: Array, beside: int, breaks: list[int] | None = None) -> tuple[Array, Array]:
    """Means over so many values beside each, and slopes over thrice as many, between breaks."""
    means, slopes = np.empty_like(values), np.empty_like(values)
    ends = [0, *(breaks or []), len(values)]
    for begin, end in pairwise(ends):
        if end > begin:
            piece = values[begin:end]
            about = min(beside, len(piece) - 1)
            wide = min(3 * beside, len(piece) - 1)
            means[begin:end] = _convolved(piece, np.full(2 * about + 1, 1 / (2 * about + 1)))
            times = np.arange(-wide, wide + 1.0)
            weights = times / max(float(times @ times), 1.0)
            slopes[begin:end] = _convolved(piece, weights)
    return means, slopes


def _convolved(values: Array, weights: Array) -> Array:
    """Weighted sums about each value, of odd reflections at the ends."""
    beside = len(weights) // 2
    if not beside:
        return np.asarray(weights[0] * values)
    before = 2 * values[0] - values[beside:0:-1]
    after = 2 * values[-1] - values[-2 : -beside - 2 : -1]
    padded = np.concatenate([before, values, after])
    return np.convolve(padded, weights[::-1], 'valid')


def _left(chain: Chain, charge: int) -> Array:
    """Domain on the left of a wall of a charge, shape (N,) [rad]."""
    if charge > 0:
        return chain.uniform_state(1)
    if chain.motion is Motion.SPINNER:
        return chain.uniform_state(1) + math.pi
    return chain.uniform_state(-1)


def _swing(chain: Chain) -> float:
    return math.pi if chain.motion is Motion.SPINNER else 2 * chain.rest_angle
