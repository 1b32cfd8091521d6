# SPDX-License-Identifier: Apache-2.0
"""Noiseless frames of elastic chains, and the true positions of the walls in them.

The position of a wall in a frame is the position of the static wall nearest to this frame. The
position is averaged over the shorter of two times: a period of the slowest phonon, and the time in
which the wall moves by one rotor spacing. An anti-kink may oscillate in a well of the energy.
Therefore its averaging time is at most 1/16 of the period of this oscillation. The velocity is the
slope of a line that is fitted to the positions over three times the averaging time. No average and
no fit extends across an impulse.

Scenes with a single wall use a cubic instead of the line in three cases: walls so slow that their
speed varies between rotors, cells with `AccuracyCell.damping`, and chains with force terms. Force
terms are all torques of a `Chain` other than the spring torques, such as `Chain.damping`, friction
or motors. `AccuracyCell.damping` is no force term, because `Springs` multiplies the rates by the
decay instead. No cell has several walls and force terms. `averages_and_slopes` describes how force
terms change averages and slopes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import savgol_coeffs

from soliton_linkage.linear.bands import gap, speed_of_sound
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies.accuracy import walls
from soliton_linkage_studies.accuracy.cells import AccuracyCell
from soliton_linkage_studies.accuracy.springs import ForcedSprings, Springs, springs_of

_SLOW = 0.25
"""A wall is slow if it moves by less than this in a period of the slowest phonon [spacings]."""
_SETTLED = (20, 400)
"""Range of the number of frames between a kick that destroys the wall (`AccuracyCell.kick`) and
the start of the scene [1]."""
# Scenes with one wall:
_FROM_EDGE = 1.0
"""A moving wall that is nearer to an edge than this does not count in the statistics (see
`WallScene.scored`) [rotor spacings], because a wall disappears at an edge before it returns."""
_BEGIN = 2.0
"""Smallest distance of a moving wall from both edges at the start [rotor spacings]."""
_SAMPLES = 200
"""Number of orbit points with the wall near the first edge [1]. With `AccuracyCell.nudged`, the
search for the orbit point of the initial uniform state begins at the nearest of these points."""
_LEGS = 2.0
"""Longest random path between the kick of a wall with `AccuracyCell.nudged` and the start of the
scene [edge-to-edge passages]."""
_WINDOWS, _FORCED_WINDOWS = 3, 6
"""Length of the window for the fit of a slope, divided by the length of the averaging window [1].
The second value is for chains with force terms."""
_PERIOD_SHARE = 1 / 16
"""Longest averaging time, divided by the oscillation period of an anti-kink in a well [1]. The
fitted slope then is the velocity with an error of 4 %."""
_STOPPED = 0.02
"""With force terms, a wall counts as stopped if its speed is below this fraction of its largest
speed [1]."""
_CHAINS = 200
"""Largest number of random chains that are tried to find one that a wall can pass [1]."""
_IMPULSE_REACH = 1.5
"""Largest distance between the wall and a rotor that receives an impulse [rotor spacings]."""
# Scenes with several walls:
_FEWEST = 20
"""Smallest number of frames of a scene with several walls [1]."""
_DRAWS = 20
"""Largest number of random scenes that are tried until all walls stay intact and apart [1]."""
_SLOWER = 0.7
"""After each failed draw of a scene, the initial speed of anti-kinks is multiplied by this [1]."""
_JITTER = 0.05
"""Largest random shift of a wall from its regular initial position [distances between walls]."""
_CORE = 3.0
"""Only the rotors within this distance of a wall show whether it is intact [rotor spacings]."""


@dataclass(frozen=True)
class WallScene:
    """Noiseless frames and the true walls in them: K walls in T frames."""

    angles: Array
    """Angles without encoder errors [rad], shape (T, N)."""
    kinetic: Array
    """Kinetic energy [J], shape (T,)."""
    positions: Array
    """Wall positions, averaged over time [rotor spacings], shape (T, K)."""
    instants: Array
    """Wall positions without the average over time [rotor spacings], shape (T, K)."""
    site_rates: Array
    """Velocities of the walls [rotor spacings / s], shape (T, K)."""
    charges: tuple[int, ...]
    legs: Array
    """Orbit leg (index of the passage from edge to edge), shape (T,); -1 unless K = 1."""
    scored: NDArray[np.bool_]
    """Whether a wall counts in the statistics of errors and of lost walls, shape (T, K); moving
    walls near an edge do not count. False walls and wrong legs are counted only in frames in which
    all walls count."""
    impulse_frames: tuple[int, ...] = ()
    """Index of the first frame after each impulse."""
    impulses: tuple[Array, ...] = ()
    """Angular impulses of all rotors [N m s], shape (N,), for each element of `impulse_frames`."""


def scene_of(cell: AccuracyCell, frames: int, random: Generator) -> WallScene:
    """Simulate a scene of `frames` frames.

    A scene with several walls is shorter if a wall breaks up, or nears another wall or an edge.
    """
    chain = cell.chain
    if cell.noise_only:
        angles = random.uniform(-math.pi, math.pi, (frames, chain.number_of_rotors))
        return _without_walls(angles, np.full(frames, math.nan))
    if cell.kick:
        angles = chain.uniform_state(-1)
        rates = cell.kick / chain.time_unit * mode_towards_last(chain, angles)
        springs = springs_of(chain, angles, rates, cell.period * chain.time_unit)
        for _ in range(int(random.integers(*_SETTLED))):
            springs.advance()
        motion = springs.record(frames)
        return _without_walls(motion.angles, np.asarray(chain.kinetic_energy(motion.rates)))
    if cell.walls > 1:
        return _several_walls(cell, frames, random)
    return _single_wall(cell, frames, random)


def _without_walls(angles: Array, kinetic: Array) -> WallScene:
    none = np.empty((len(angles), 0))
    legs = np.full(len(angles), -1)
    return WallScene(angles, kinetic, none, none, none, (), legs, none.astype(bool))


def frames_beside(speed: float, cell: AccuracyCell, barrier_speed: float = 0.0) -> int:
    """Return b: the average position of a frame includes the b frames before and after it.

    `speed` is the wall speed [rotor spacings/s]. For `barrier_speed`, see `WallPath`.
    """
    # An anti-kink in a well oscillates with the period 2 / barrier_speed.
    well = barrier_speed / (2 * _PERIOD_SHARE)
    time = 1 / max(abs(speed), gap(cell.chain) / (2 * math.pi), well)
    return max(round(time / (cell.period * cell.chain.time_unit) / 2), 1)


def averages_and_slopes(
    values: Array,
    beside: int,
    breaks: Sequence[int] = (),
    cubic: bool = False,
    forced: bool = False,
) -> tuple[Array, Array]:
    """Return a moving average and a slope for each value.

    The average is over 2 b + 1 values around each index, with b = `beside`. The slope is the slope
    of a line, or of a cubic if `cubic` is true, that is fitted to 3 b values before and 3 b values
    after the index. No average and no fit extends across an index in `breaks`.

    `forced`, which requires `cubic`, is for chains with force terms. The fit then extends over 6 b
    values before and after the index. If the second derivative of the cubic is x'', the average is
    too large by x'' b (b + 1) / 6; this error is subtracted. If the wall starts or stops within
    the fit, the average is replaced by the value itself, and the slope by half the difference of
    both neighbours. The wall counts as stopped at values whose slope is below 2 % of the largest
    slope.
    """
    means, slopes = np.empty_like(values), np.empty_like(values)
    for begin, end in pairwise([0, *breaks, len(values)]):
        if end > begin:
            piece = values[begin:end]
            about = min(beside, len(piece) - 1)
            wide = min((_FORCED_WINDOWS if forced else _WINDOWS) * beside, len(piece) - 1)
            means[begin:end] = _convolved(piece, np.full(2 * about + 1, 1 / (2 * about + 1)))
            order = min(3 if cubic else 1, max(2 * wide - 1, 0))
            weights = savgol_coeffs(2 * wide + 1, order, deriv=1, use='dot')
            slopes[begin:end] = _convolved(piece, weights)
            if forced:
                curvature = savgol_coeffs(2 * wide + 1, order, deriv=2, use='dot')
                means[begin:end] -= _convolved(piece, curvature) * about * (about + 1) / 6
                near, differences = _near_stop(piece, wide)
                means[begin:end][near] = piece[near]
                slopes[begin:end][near] = differences[near]
    return means, slopes


def _near_stop(values: Array, beside: int) -> tuple[NDArray[np.bool_], Array]:
    differences = np.gradient(values)
    still = np.abs(differences) < _STOPPED * np.abs(differences).max()
    window = 2 * beside + 1
    stopped = still.astype(np.float64)
    changes = minimum_filter1d(stopped, window) < maximum_filter1d(stopped, window)
    return changes, differences


def _convolved(values: Array, weights: Array) -> Array:
    beside = len(weights) // 2
    if not beside:
        return np.asarray(weights[0] * values)
    before = 2 * values[0] - values[beside:0:-1]
    after = 2 * values[-1] - values[-2 : -beside - 2 : -1]
    padded = np.concatenate([before, values, after])
    return np.convolve(padded, weights[::-1], 'valid')


@dataclass(frozen=True)
class _Start:
    """Initial state of a scene with a single wall."""

    springs: Springs
    """Simulation at the start of the scene; its chain includes the random deviations."""
    orbit: Orbit
    arc: float
    """Arc length of the orbit point near the initial state [rad], a guess for the first frame."""
    speed: float
    """Speed of the wall [rotor spacings / s]."""


def _single_wall(cell: AccuracyCell, frames: int, random: Generator) -> WallScene:
    start = _started(cell, random)
    springs, orbit = start.springs, start.orbit
    chain, last = cell.chain, cell.chain.number_of_rotors - 1
    springs.rates += cell.phonons / chain.time_unit * random.standard_normal(last + 1)
    beside = frames_beside(start.speed, cell)
    # A force changes the speed within the fit, so that the slope of a fitted line would be wrong.
    forced = isinstance(springs, ForcedSprings)
    margin = (_FORCED_WINDOWS if forced else _WINDOWS) * beside
    total = frames + 2 * margin
    count = math.ceil(total / cell.impulse_interval) if cell.impulse_interval else 0
    at = sorted(random.choice(np.arange(1, total - 1), count, replace=False).tolist())
    angles: list[Array] = []
    kinetic: list[float] = []
    raw: list[float] = []
    impulses: list[Array] = []
    damping = np.full(last + 1, cell.damping / chain.time_unit) if cell.damping else None
    for frame in range(total):
        if frame:
            springs.advance(damping)
        guess = 2 * raw[-1] - raw[-2] if frame > 1 else raw[0] if frame else start.arc
        arc = walls.nearest_arc(orbit, springs.angles, guess)
        if frame in at:
            impulses.append(_apply_impulse(start, arc, cell.largest_impulse, random))
        angles.append(springs.angles.copy())
        kinetic.append(float(springs.chain.kinetic_energy(springs.rates)))
        raw.append(arc)
    slow = abs(start.speed) < _SLOW * gap(chain) / (2 * math.pi)
    cubic = slow or cell.damping > 0 or forced
    means, slopes = averages_and_slopes(np.array(raw), beside, at, cubic, forced)
    kept = slice(margin, total - margin)
    arcs, arc_rates = means[kept], slopes[kept] / springs.period
    positions = np.array([orbit.site(arc) for arc in arcs])
    instants = np.array([orbit.site(arc) for arc in raw[kept]])
    legs = np.array([orbit.leg(arc) for arc in arcs])
    spacing = np.array([orbit.site_arc_at(arc) for arc in arcs])
    outer = 0.0 if start.speed == 0 else _FROM_EDGE
    inner = np.minimum(positions, instants) > outer
    inner &= np.maximum(positions, instants) < last - outer
    in_scene = [
        (frame - margin, impulse)
        for frame, impulse in zip(at, impulses, strict=True)
        if 0 < frame - margin < frames
    ]
    return WallScene(
        angles=np.array(angles[kept]),
        kinetic=np.array(kinetic[kept]),
        positions=positions[:, None],
        instants=instants[:, None],
        site_rates=(np.where(legs % 2 == 0, 1, -1) * arc_rates / spacing)[:, None],
        charges=(1,),
        legs=legs,
        scored=inner[:, None],
        impulse_frames=tuple(frame for frame, _ in in_scene),
        impulses=tuple(impulse for _, impulse in in_scene),
    )


def _started(cell: AccuracyCell, random: Generator) -> _Start:
    chain, period = cell.chain, cell.period * cell.chain.time_unit
    orbit = _orbit(cell, random)
    last = chain.number_of_rotors - 1
    leg = int(random.integers(orbit.number_of_legs))
    sense = 1 if random.integers(2) else -1
    position = float(random.uniform(_BEGIN, max(last - _BEGIN, _BEGIN)))
    if not math.isnan(cell.start):
        arc = orbit.arc_at(cell.start, leg)
        wall_at_rest = static_wall(chain, cell.start, leg)
        return _Start(springs_of(chain, wall_at_rest, np.zeros(last + 1), period), orbit, arc, 0.0)
    if cell.nudged:
        return _nudged(cell, orbit, random)
    if cell.disorder:
        speed, arc = walls.launch_speed(chain, cell.speed), orbit.arc_at(position, leg)
        rates = sense * speed * orbit.site_arc * orbit.tangent(arc)
        springs = springs_of(orbit.chain, orbit.configuration(arc), rates, period)
        return _Start(springs, orbit, arc, speed)
    wall = walls.steady_wall(chain, leg if chain.motion is Motion.SPINNER else 0, cell.speed)
    shift = 2 * round((position - wall.position) / 2)
    arc = orbit.arc_at(wall.position + shift, leg)
    angles, rates = orbit.configuration(arc), np.zeros(last + 1)
    walls.add_motion(wall, shift, angles, rates, sense if leg % 2 == 0 else -sense)
    return _Start(springs_of(chain, angles, rates, period), orbit, arc, wall.speed)


def _nudged(cell: AccuracyCell, orbit: Orbit, random: Generator) -> _Start:
    chain = cell.chain
    left = chain.uniform_state(1) + math.pi
    angles = left if chain.motion is Motion.SPINNER else chain.uniform_state(-1)
    speed = walls.launch_speed(chain, cell.speed)
    rates = speed * orbit.site_arc * mode_towards_last(chain, angles)
    springs = springs_of(chain, angles, rates, cell.period * chain.time_unit)
    sampled = np.linspace(-orbit.site_arc, orbit.arc_at(1.0, 0), _SAMPLES)
    apart = [np.cos(angles - orbit.configuration(arc)).sum() for arc in sampled]
    arcs = [walls.nearest_arc(orbit, angles, float(sampled[int(np.argmax(apart))]))] * 2
    leg = (chain.number_of_rotors - 1) / (speed * springs.period)
    for _ in range(int(random.uniform(0.0, _LEGS) * leg)):
        springs.advance()
        arcs = [arcs[1], walls.nearest_arc(orbit, springs.angles, 2 * arcs[1] - arcs[0])]
    return _Start(springs, orbit, arcs[1], speed)


def _apply_impulse(start: _Start, arc: float, largest: float, random: Generator) -> Array:
    orbit = start.orbit
    near = np.abs(np.arange(orbit.chain.number_of_rotors) - orbit.site(arc)) < _IMPULSE_REACH
    change = start.speed * random.uniform(-largest, largest)
    rates = near * orbit.tangent(arc) * orbit.site_arc * change
    start.springs.rates += rates
    return np.asarray(orbit.chain.moments_of_inertia * rates)


def _orbit(cell: AccuracyCell, random: Generator) -> Orbit:
    if not cell.disorder:
        return _uniform_orbit(cell.chain)
    for _ in range(_CHAINS):
        shares = dict.fromkeys(('spacing', 'rotor_length', 'stiffness', 'mass'), cell.disorder)
        seed = int(random.integers(2**31))
        drawn = drawn_deviations(cell.chain.number_of_rotors, seed, periodic=False, **shares)
        try:
            return orbit_of(replace(cell.chain, deviations=drawn))
        except (ValueError, ArithmeticError):
            continue
    raise ArithmeticError(
        f'cell {cell.name}: disorder {cell.disorder:g} blocks the wall in all {_CHAINS} draws; '
        'lower it'
    )


_uniform_orbit = cache(orbit_of)


def _several_walls(cell: AccuracyCell, frames: int, random: Generator) -> WallScene:
    for draw in range(_DRAWS):
        begins = 1 if random.integers(2) else -1
        charges = tuple(begins * (-1) ** number for number in range(cell.walls))
        moving = _placed(cell, charges, _SLOWER**draw, random)
        noise = random.standard_normal(cell.chain.number_of_rotors)
        moving.springs.rates += cell.phonons / cell.chain.time_unit * noise
        scene = _followed(cell, frames, charges, moving)
        if len(scene.angles) >= min(_FEWEST, frames):
            return scene
    raise ArithmeticError(
        f'cell {cell.name}: walls meet within {_FEWEST} frames; use a longer chain'
    )


@dataclass(frozen=True)
class _MovingWalls:
    springs: Springs
    paths: list[walls.WallPath]
    positions: list[float]
    speeds: list[float]
    """Speeds of the walls [rotor spacings / s]."""


def _placed(
    cell: AccuracyCell, charges: tuple[int, ...], slower: float, random: Generator
) -> _MovingWalls:
    chain, near = cell.chain, walls.reach(cell.chain)
    rotors = chain.number_of_rotors
    angles, rates = walls.left_of(chain, charges[0]), np.zeros(rotors)
    paths, positions, speeds = [], [], []
    distance = (rotors - 1 - near) / len(charges)
    for number, charge in enumerate(charges):
        leg = int(random.integers(2)) if chain.motion is Motion.SPINNER else 0
        path = walls.wall_path(chain, charge, leg if charge > 0 else 0)
        aside = float(random.uniform(-_JITTER, _JITTER))
        position = near / 2 + distance * (number + 0.5 + aside)
        sense = 1 if random.integers(2) else -1
        if charge > 0:
            wall = walls.steady_wall(chain, leg, cell.speed)
            shift = 2 * round((position - wall.position) / 2)
            position, speed = wall.position + shift, wall.speed
            walls.add_motion(wall, shift, angles, rates, sense)
        else:
            allowed = path.nearest_allowed if slower == 1 else path.nearest_minimum
            position = allowed(position)
            speed = slower * cell.speed * speed_of_sound(chain) / chain.spacing
            rates += sense * speed * path.derivative(rotors, position)
        angles += path.relative_angles(rotors, position)
        paths.append(path)
        positions.append(position)
        speeds.append(speed)
    springs = springs_of(chain, angles, rates, cell.period * chain.time_unit)
    return _MovingWalls(springs, paths, positions, speeds)


def _followed(
    cell: AccuracyCell, frames: int, charges: tuple[int, ...], moving: _MovingWalls
) -> WallScene:
    chain, near, springs = cell.chain, walls.reach(cell.chain), moving.springs
    last = chain.number_of_rotors - 1
    angles: list[Array] = []
    kinetic: list[float] = []
    raw: list[Array] = []
    positions = moving.positions
    for frame in range(frames):
        if frame:
            springs.advance()
        guesses = positions if len(raw) < 2 else (2 * raw[-1] - raw[-2]).tolist()
        both = zip(moving.paths, guesses, strict=True)
        positions = [path.nearest(springs.angles, guess, near) for path, guess in both]
        apart = np.diff([-near, *positions, last + near])
        both = zip(moving.paths, positions, strict=True)
        broken = any(walls.is_broken(path, chain, springs.angles, x, _CORE) for path, x in both)
        if broken or apart.min() < 2 * near:
            break
        angles.append(springs.angles.copy())
        kinetic.append(float(chain.kinetic_energy(springs.rates)))
        raw.append(np.array(positions))
    track = np.array(raw).reshape(-1, len(charges))
    beside = [
        frames_beside(speed, cell, path.barrier_speed)
        for speed, path in zip(moving.speeds, moving.paths, strict=True)
    ]
    means = [
        averages_and_slopes(column, count) for column, count in zip(track.T, beside, strict=True)
    ]
    return WallScene(
        angles=np.array(angles),
        kinetic=np.array(kinetic),
        positions=np.stack([mean for mean, _ in means], axis=1),
        instants=track,
        site_rates=np.stack([slope / springs.period for _, slope in means], axis=1),
        charges=charges,
        legs=np.full(len(angles), -1),
        scored=np.ones(track.shape, dtype=bool),
    )
