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
terms are all torques of `AccuracyCell.chain` other than the spring torques, such as
`Chain.damping`, friction or motors. `AccuracyCell.damping` does not count as a force term. No cell
has several walls and force terms. `walls.averages_and_slopes` describes how force terms change
averages and slopes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.terms import of_chain
from soliton_linkage.linear.bands import gap, speed_of_sound
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies.accuracy import walls
from soliton_linkage_studies.accuracy.cells import AccuracyCell

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
_PERIOD_SHARE = 1 / 16
"""Longest averaging time, divided by the oscillation period of an anti-kink in a well [1]. The
fitted slope then is the velocity with an error of 4 %."""
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
        simulation = _simulation(cell, chain, angles, rates)
        for _ in range(int(random.integers(*_SETTLED))):
            simulation.advance()
        motion = simulation.record((frames - 1) * simulation.period)
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


@dataclass(frozen=True)
class _Start:
    """Initial state of a scene with a single wall."""

    simulation: ElasticSimulation
    """Simulation at the start of the scene; its chain includes the random deviations."""
    orbit: Orbit
    arc: float
    """Arc length of the orbit point near the initial state [rad], a guess for the first frame."""
    speed: float
    """Speed of the wall [rotor spacings / s]."""


def _single_wall(cell: AccuracyCell, frames: int, random: Generator) -> WallScene:
    start = _started(cell, random)
    simulation, orbit = start.simulation, start.orbit
    chain, last = cell.chain, cell.chain.number_of_rotors - 1
    _excite(simulation, cell, random)
    beside = frames_beside(start.speed, cell)
    # A force changes the speed within the fit, so that the slope of a fitted line would be wrong.
    forced = bool(of_chain(chain)) or chain.feedback.acts
    margin = (walls.FORCED_WINDOWS if forced else walls.WINDOWS) * beside
    total = frames + 2 * margin
    count = math.ceil(total / cell.impulse_interval) if cell.impulse_interval else 0
    at = sorted(random.choice(np.arange(1, total - 1), count, replace=False).tolist())
    angles: list[Array] = []
    kinetic: list[float] = []
    raw: list[float] = []
    impulses: list[Array] = []
    for frame in range(total):
        if frame:
            simulation.advance()
        guess = 2 * raw[-1] - raw[-2] if frame > 1 else raw[0] if frame else start.arc
        arc = walls.nearest_arc(orbit, simulation.angles, guess)
        if frame in at:
            impulses.append(_apply_impulse(start, arc, cell.largest_impulse, random))
        angles.append(simulation.angles)
        kinetic.append(float(simulation.chain.kinetic_energy(simulation.rates)))
        raw.append(arc)
    slow = abs(start.speed) < _SLOW * gap(chain) / (2 * math.pi)
    cubic = slow or cell.damping > 0 or forced
    means, slopes = walls.averages_and_slopes(np.array(raw), beside, at, cubic, forced)
    kept = slice(margin, total - margin)
    arcs, arc_rates = means[kept], slopes[kept] / simulation.period
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
    chain, orbit = cell.chain, _orbit(cell, random)
    last = chain.number_of_rotors - 1
    leg = int(random.integers(orbit.number_of_legs))
    sense = 1 if random.integers(2) else -1
    position = float(random.uniform(_BEGIN, max(last - _BEGIN, _BEGIN)))
    if not math.isnan(cell.start):
        arc = orbit.arc_at(cell.start, leg)
        wall_at_rest = static_wall(chain, cell.start, leg)
        simulation = _simulation(cell, chain, wall_at_rest, np.zeros(last + 1))
        return _Start(simulation, orbit, arc, 0.0)
    if cell.nudged:
        return _nudged(cell, orbit, random)
    if cell.disorder:
        speed, arc = walls.launch_speed(chain, cell.speed), orbit.arc_at(position, leg)
        rates = sense * speed * orbit.site_arc * orbit.tangent(arc)
        simulation = _simulation(cell, orbit.chain, orbit.configuration(arc), rates)
        return _Start(simulation, orbit, arc, speed)
    wall = walls.steady_wall(chain, leg if chain.motion is Motion.SPINNER else 0, cell.speed)
    shift = 2 * round((position - wall.position) / 2)
    arc = orbit.arc_at(wall.position + shift, leg)
    angles, rates = orbit.configuration(arc), np.zeros(last + 1)
    walls.add_motion(wall, shift, angles, rates, sense if leg % 2 == 0 else -sense)
    return _Start(_simulation(cell, chain, angles, rates), orbit, arc, wall.speed)


def _simulation(
    cell: AccuracyCell, chain: Chain, angles: Array, rates: Array
) -> ElasticSimulation:
    """Return the simulation of a chain with the frame period and the damping of a cell."""
    damping = chain.damping + cell.damping * chain.moment_of_inertia / chain.time_unit
    chain, period = replace(chain, damping=damping), cell.period * chain.time_unit
    return ElasticSimulation(chain, angles, rates, period, walls.TOLERANCE)


def _excite(simulation: ElasticSimulation, cell: AccuracyCell, random: Generator) -> None:
    chain = simulation.chain
    noise = random.standard_normal(chain.number_of_rotors)
    simulation.kick(cell.phonons / chain.time_unit * chain.moments_of_inertia * noise)


def _nudged(cell: AccuracyCell, orbit: Orbit, random: Generator) -> _Start:
    chain = cell.chain
    left = chain.uniform_state(1) + math.pi
    angles = left if chain.motion is Motion.SPINNER else chain.uniform_state(-1)
    speed = walls.launch_speed(chain, cell.speed)
    rates = speed * orbit.site_arc * mode_towards_last(chain, angles)
    simulation = _simulation(cell, chain, angles, rates)
    sampled = np.linspace(-orbit.site_arc, orbit.arc_at(1.0, 0), _SAMPLES)
    apart = [np.cos(angles - orbit.configuration(arc)).sum() for arc in sampled]
    arcs = [walls.nearest_arc(orbit, angles, float(sampled[int(np.argmax(apart))]))] * 2
    leg = (chain.number_of_rotors - 1) / (speed * simulation.period)
    for _ in range(int(random.uniform(0.0, _LEGS) * leg)):
        simulation.advance()
        arcs = [arcs[1], walls.nearest_arc(orbit, simulation.angles, 2 * arcs[1] - arcs[0])]
    return _Start(simulation, orbit, arcs[1], speed)


def _apply_impulse(start: _Start, arc: float, largest: float, random: Generator) -> Array:
    orbit = start.orbit
    near = np.abs(np.arange(orbit.chain.number_of_rotors) - orbit.site(arc)) < _IMPULSE_REACH
    change = start.speed * random.uniform(-largest, largest)
    rates = near * orbit.tangent(arc) * orbit.site_arc * change
    impulse = np.asarray(orbit.chain.moments_of_inertia * rates)
    start.simulation.kick(impulse)
    return impulse


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
        _excite(moving.simulation, cell, random)
        scene = _followed(cell, frames, charges, moving)
        if len(scene.angles) >= min(_FEWEST, frames):
            return scene
    raise ArithmeticError(
        f'cell {cell.name}: walls meet within {_FEWEST} frames; use a longer chain'
    )


@dataclass(frozen=True)
class _MovingWalls:
    simulation: ElasticSimulation
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
    simulation = _simulation(cell, chain, angles, rates)
    return _MovingWalls(simulation, paths, positions, speeds)


def _followed(
    cell: AccuracyCell, frames: int, charges: tuple[int, ...], moving: _MovingWalls
) -> WallScene:
    chain, near, simulation = cell.chain, walls.reach(cell.chain), moving.simulation
    last = chain.number_of_rotors - 1
    angles: list[Array] = []
    kinetic: list[float] = []
    raw: list[Array] = []
    positions = moving.positions
    for frame in range(frames):
        if frame:
            simulation.advance()
        guesses = positions if len(raw) < 2 else (2 * raw[-1] - raw[-2]).tolist()
        both = zip(moving.paths, guesses, strict=True)
        positions = [path.nearest(simulation.angles, guess, near) for path, guess in both]
        apart = np.diff([-near, *positions, last + near])
        both = zip(moving.paths, positions, strict=True)
        broken = any(walls.is_broken(path, chain, simulation.angles, x, _CORE) for path, x in both)
        if broken or apart.min() < 2 * near:
            break
        angles.append(simulation.angles)
        kinetic.append(float(chain.kinetic_energy(simulation.rates)))
        raw.append(np.array(positions))
    track = np.array(raw).reshape(-1, len(charges))
    beside = [
        frames_beside(speed, cell, path.barrier_speed)
        for speed, path in zip(moving.speeds, moving.paths, strict=True)
    ]
    means = [
        walls.averages_and_slopes(column, count)
        for column, count in zip(track.T, beside, strict=True)
    ]
    return WallScene(
        angles=np.array(angles),
        kinetic=np.array(kinetic),
        positions=np.stack([mean for mean, _ in means], axis=1),
        instants=track,
        site_rates=np.stack([slope / simulation.period for _, slope in means], axis=1),
        charges=charges,
        legs=np.full(len(angles), -1),
        scored=np.ones(track.shape, dtype=bool),
    )
