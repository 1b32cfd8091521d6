# SPDX-License-Identifier: Apache-2.0
"""Time to analyse the frames of records that are easy or hard to analyse."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from comparison import Figure, tracked

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linear.rigidity import mode_towards_last
from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

WALLS = (2, 4, 8)
"""Numbers of walls on a ring [1], which are always even."""
RING, FLIPPER = 200, 40
"""Number of rotors of rings, and of the flipper chains in hard records."""
SPEED = 0.02
"""Speed of the walls [rotor spacings / frame]."""
NOISE = 0.01
KICK = 3.0
"""Kick of an edge that destroys the wall [rad sqrt(k / M)]."""
PERIOD = 4_000_000
"""Frame period [ns]."""
WARM = 50
"""Number of ignored first frames, in which filters start and wall shapes are computed."""


@dataclass(frozen=True)
class Record:
    """Angles of a chain [rad], shape (frames, N), and the number of its walls."""

    name: str
    chain: Chain
    angles: Array
    walls: int | None = None


def records(lengths: Iterable[int], frames: int) -> list[Record]:
    """Return records with one wall in chains, with several walls in rings, and hard cases."""
    made = [_one_wall(Chain(number_of_rotors=rotors), frames) for rotors in lengths]
    made += [_several_walls(count, frames) for count in WALLS]
    flipper, random = Chain(number_of_rotors=FLIPPER), np.random.default_rng(2)
    seen = _one_wall(flipper, frames).angles
    half = np.where(random.random(seen.shape) < 0.5, seen, np.nan)
    anywhere = random.uniform(-math.pi, math.pi, seen.shape)
    return [
        *made,
        Record(f'N = {FLIPPER}, half of the rotors unknown', flipper, half),
        Record(f'N = {FLIPPER}, a soliton that breaks up', flipper, _break_up(flipper, frames)),
        Record(f'N = {FLIPPER}, angles at random', flipper, anywhere),
    ]


def times_of(record: Record) -> list[float]:
    """Return the processor time of each frame [s], except the first frames."""
    analyser, times = Analyser(record.chain), []
    rates = np.gradient(record.angles, 1e-9 * PERIOD, axis=0)
    frames = zip(record.angles, rates, strict=True)
    for number, (angles, rate) in tracked(enumerate(frames), record.name, '{} frames'):
        begin = time.thread_time()
        found = analyser.analyse(number * PERIOD, angles, rate)
        times.append(time.thread_time() - begin)
        counted = len(found.solitons) if found else 0
        if record.walls is not None and counted != record.walls:
            raise RuntimeError(f'{record.name}: {counted} walls were found in frame {number}')
    return times[WARM:]


def figures_of(name: str, times: list[float]) -> list[Figure]:
    """Return median, 99.9th percentile and maximum of the times of a record."""
    work = f'{name}: processor time per frame'
    return [
        Figure(f'{work}, median', 's', [float(np.median(times))]),
        Figure(f'{work}, p99.9', 's', [float(np.quantile(times, 0.999))], 'three medians'),
        Figure(f'{work}, largest', 's', [max(times)]),
    ]


def _noisy(angles: Array) -> Array:
    return angles + NOISE * np.random.default_rng(1).standard_normal(angles.shape)


def _one_wall(chain: Chain, frames: int) -> Record:
    rotors = chain.number_of_rotors
    orbit = UniformOrbit(chain)
    speed = min(SPEED, 0.5 * rotors / (frames + WARM))
    positions = 0.25 * rotors + speed * np.arange(frames + WARM)
    angles = np.array([orbit.configuration(orbit.arc_at(position, 0)) for position in positions])
    return Record(f'N = {rotors}', chain, _noisy(angles), walls=1)


def _several_walls(count: int, frames: int) -> Record:
    chain = Chain(number_of_rotors=RING, rest_angle=0.5, periodic=True)
    shifts = SPEED * np.arange(frames + WARM)
    angles = np.array([_ring_with_walls(chain, count, shift) for shift in shifts])
    name = f'ring of {RING} rotors with {count} walls'
    return Record(name, chain, _noisy(angles), walls=count)


def _ring_with_walls(chain: Chain, count: int, shift: float) -> Array:
    """Return the angles [rad] of a ring with `count` walls at equal distances."""
    rotors = np.arange(chain.number_of_rotors)
    width, apart = chain.wall_width / chain.spacing, chain.number_of_rotors / count
    order = np.ones(len(rotors))
    for wall in range(count):
        position = (wall + 0.5) * apart + shift
        way = rotors - position
        way = way - chain.number_of_rotors * np.rint(way / chain.number_of_rotors)
        near = np.abs(way) <= apart / 2
        order[near] = (-1) ** (wall + 1) * np.tanh(way[near] / width)
    return staggered(np.arcsin(order * math.sin(chain.rest_angle)))


def _break_up(chain: Chain, frames: int) -> Array:
    """Return the angles [rad] after a kick that destroys the soliton, shape (frames, N)."""
    angles, period = chain.uniform_state(-1), 1e-9 * PERIOD
    rates = KICK / chain.time_unit * mode_towards_last(chain, angles)
    duration = (frames + WARM - 1) * period
    return _noisy(simulate(chain, angles, rates, duration, period, tolerance=1e-8).angles)
