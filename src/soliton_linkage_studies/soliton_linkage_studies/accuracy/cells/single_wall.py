# SPDX-License-Identifier: Apache-2.0
"""One wall on its way round its orbit, reflections, disorder and pushes included."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage_studies.accuracy.cells.cells import AccuracyCell
from soliton_linkage_studies.accuracy.cells.launching import dress, dressed, launch_speed
from soliton_linkage_studies.accuracy.cells.scene import (
    WallScene,
    frames_beside,
    is_slow,
    smoothed,
)
from soliton_linkage_studies.accuracy.cells.springs import Springs
from soliton_linkage_studies.accuracy.cells.walls import nearest_arc

_FROM_EDGE = 1.0
"""Places nearer to an edge are not judged [rotor spacings]: there a wall is swallowed."""
_BEGIN = 2.0
"""Least distance from an edge at the start [rotor spacings]."""
_SAMPLES = 200
"""Of the orbit next to the first edge, to find a chain at rest on it [1]."""
_LEGS = 2.0
"""That a wall that was nudged runs at most before it is looked at [1]."""
_DRAWS = 200
"""Of deviations, until there are some that a wall passes."""
_PUSHED = 1.5
"""Rotors beside a wall that a hand pushes [rotor spacings]."""
_HARDEST = 0.5
"""Largest change of the speed by a push, over the speed [1]."""


@dataclass(frozen=True)
class _Start:
    chain: Chain
    """With its deviations."""
    orbit: Orbit
    angles: Array
    rates: Array
    arc: float
    """About where it is on its orbit [rad]."""
    speed: float
    """Of the wall [rotor spacings / s]."""


@dataclass
class _Way:
    """What was seen on the way, frame by frame."""

    angles: list[Array]
    kinetic: list[float]
    arcs: list[float]
    impulses: list[Array]


def single_wall(
    cell: AccuracyCell, frames: int, random: np.random.Generator, pushes: int
) -> WallScene:
    """A wall anywhere on its orbit; so many pushes are spread over the scene and its margins."""
    start = _started(cell, random)
    rotors = cell.chain.number_of_rotors
    rates = start.rates + cell.phonons / cell.chain.time_unit * random.standard_normal(rotors)
    beside = frames_beside(start.speed, cell)
    margin = 3 * beside
    total = frames + 2 * margin
    at = sorted(random.choice(np.arange(1, total - 1), pushes, replace=False).tolist())
    springs = Springs(start.chain, start.angles, rates, cell.period * cell.chain.time_unit)
    way = _followed(springs, start, total, at, random)
    mean, slope = smoothed(np.array(way.arcs), beside, at, is_slow(start.speed, cell.chain))
    kept = slice(margin, total - margin)
    told = [
        (frame - margin, impulses)
        for frame, impulses in zip(at, way.impulses, strict=True)
        if 0 < frame - margin < frames
    ]
    return _scene(start.orbit, way, mean[kept], slope[kept] / springs.period, kept, told)


def _scene(
    orbit: Orbit,
    way: _Way,
    arcs: Array,
    arc_rates: Array,
    kept: slice,
    pushes: list[tuple[int, Array]],
) -> WallScene:
    """The frames that are kept, with means of the arc [rad] and its rate [rad/s]."""
    places = np.array([orbit.place(arc) for arc in arcs])
    instants = np.array([orbit.place(arc) for arc in way.arcs[kept]])
    legs = np.array([orbit.leg(arc) for arc in arcs])
    spacing = np.array([orbit.site_arc_at(arc) for arc in arcs])
    last = orbit.chain.number_of_rotors - 1
    inner = np.minimum(places, instants) > _FROM_EDGE
    inner &= np.maximum(places, instants) < last - _FROM_EDGE
    return WallScene(
        angles=np.array(way.angles[kept]),
        kinetic=np.array(way.kinetic[kept]),
        places=places[:, None],
        instants=instants[:, None],
        place_rates=(np.where(legs % 2 == 0, 1, -1) * arc_rates / spacing)[:, None],
        charges=(1,),
        legs=legs,
        judged=inner[:, None],
        pushes=tuple(frame for frame, _ in pushes),
        impulses=tuple(impulses for _, impulses in pushes),
    )


def _started(cell: AccuracyCell, random: np.random.Generator) -> _Start:
    chain = cell.chain
    true, orbit = _orbit(cell, random)
    last = chain.number_of_rotors - 1
    leg = int(random.integers(orbit.number_of_legs))
    sense = 1 if random.integers(2) else -1
    place = float(random.uniform(_BEGIN, last - _BEGIN))
    if cell.nudged:
        return _nudged(cell, orbit, random)
    if cell.disorder:
        speed, arc = launch_speed(chain, cell.speed), orbit.arc_at(place, leg)
        rates = sense * speed * orbit.site_arc * orbit.tangent(arc)
        return _Start(true, orbit, orbit.configuration(arc), rates, arc, speed)
    wall = dressed(chain, leg if chain.motion is Motion.SPINNER else 0, cell.speed)
    shift = 2 * round((place - wall.place) / 2)
    arc = orbit.arc_at(wall.place + shift, leg)
    angles, rates = orbit.configuration(arc), np.zeros(last + 1)
    dress(wall, shift, angles, rates, sense if leg % 2 == 0 else -sense)
    return _Start(true, orbit, angles, rates, arc, wall.speed)


def _nudged(cell: AccuracyCell, orbit: Orbit, random: np.random.Generator) -> _Start:
    """A wall that was kicked off the first edge and has run for up to two legs."""
    chain = cell.chain
    left = chain.uniform_state(1) + math.pi
    angles = left if chain.motion is Motion.SPINNER else chain.uniform_state(-1)
    speed = launch_speed(chain, cell.speed)
    rates = speed * orbit.site_arc * mode_towards_last(chain, angles)
    springs = Springs(chain, angles, rates, cell.period * chain.time_unit)
    sampled = np.linspace(-orbit.site_arc, orbit.arc_at(1.0, 0), _SAMPLES)
    apart = [np.cos(angles - orbit.configuration(arc)).sum() for arc in sampled]
    arcs = [nearest_arc(orbit, angles, float(sampled[int(np.argmax(apart))]))] * 2
    leg = (chain.number_of_rotors - 1) / (speed * springs.period)
    for _ in range(int(random.uniform(0.0, _LEGS) * leg)):
        springs.advance()
        arcs = [arcs[1], nearest_arc(orbit, springs.angles, 2 * arcs[1] - arcs[0])]
    return _Start(chain, orbit, springs.angles, springs.rates, arcs[1], speed)


def _followed(
    springs: Springs, start: _Start, total: int, at: list[int], random: np.random.Generator
) -> _Way:
    """Go on frame by frame, pushing at given ones; the first is the start."""
    way, arc = _Way([], [], [], []), start.arc
    for frame in range(total):
        if frame:
            springs.advance()
            arc = way.arcs[-1] if frame == 1 else 2 * way.arcs[-1] - way.arcs[-2]
        arc = nearest_arc(start.orbit, springs.angles, arc)
        if frame in at:
            way.impulses.append(_push(springs, start, arc, random))
        way.angles.append(springs.angles.copy())
        way.kinetic.append(float(start.chain.kinetic_energy(springs.rates)))
        way.arcs.append(arc)
    return way


def _push(springs: Springs, start: _Start, arc: float, random: np.random.Generator) -> Array:
    """Push the rotors next to the wall; returns the impulses [N m s]."""
    orbit = start.orbit
    near = np.abs(np.arange(orbit.chain.number_of_rotors) - orbit.place(arc)) < _PUSHED
    change = start.speed * random.uniform(-_HARDEST, _HARDEST)
    rates = near * orbit.tangent(arc) * orbit.site_arc * change
    springs.rates += rates
    return np.asarray(springs.chain.moments_of_inertia * rates)


def _orbit(cell: AccuracyCell, random: np.random.Generator) -> tuple[Chain, Orbit]:
    """The chain as it is, and its orbit; deviations are drawn until a wall passes them."""
    if not cell.disorder:
        return cell.chain, _uniform_orbit(cell.chain)
    for _ in range(_DRAWS):
        drawn = drawn_deviations(
            cell.chain.number_of_rotors,
            int(random.integers(2**31)),
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
