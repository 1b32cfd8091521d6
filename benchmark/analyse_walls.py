# SPDX-License-Identifier: Apache-2.0
"""Frames of rings with several walls, and what it costs to analyse them."""

from __future__ import annotations

import math
import time

import numpy as np
from comparison import Figure

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linkage.chain import Array, Chain, staggered

COUNTS = (2, 4, 8)
"""Of walls; on a ring they are even."""
ROTORS = 200
SPEED = 0.02
"""Of the walls [rotors a frame]."""
NOISE = 0.01
PERIOD = 4_000_000
"""From frame to frame [ns]."""
WARM = 50
"""Frames that do not count: filters begin, shapes are made."""


def ring_with_walls(chain: Chain, count: int, shift: float) -> Array:
    """Angles of a ring with so many walls at equal distances [rad]."""
    rotors = np.arange(chain.number_of_rotors)
    width, apart = chain.wall_width / chain.spacing, chain.number_of_rotors / count
    order = np.ones(len(rotors))
    for wall in range(count):
        place = (wall + 0.5) * apart + shift
        way = rotors - place
        way = way - chain.number_of_rotors * np.rint(way / chain.number_of_rotors)
        near = np.abs(way) <= apart / 2
        order[near] = (-1) ** (wall + 1) * np.tanh(way[near] / width)
    return staggered(np.arcsin(order * math.sin(chain.rest_angle)))


def times_of_walls(count: int, frames: int) -> list[float]:
    """Processor time of each frame [s] with so many walls."""
    chain = Chain(number_of_rotors=ROTORS, rest_angle=0.5, periodic=True)
    analyser, rng, times = Analyser(chain), np.random.default_rng(1), []
    rates = np.zeros(ROTORS)
    for number in range(frames + WARM):
        angles = ring_with_walls(chain, count, SPEED * number)
        angles += NOISE * rng.standard_normal(ROTORS)
        begin = time.thread_time()
        found = analyser.analyse(number * PERIOD, angles, rates)
        times.append(time.thread_time() - begin)
        if found is None or len(found.solitons) != count:
            raise RuntimeError(f'of {count} walls {found and len(found.solitons)} were found')
    return times[WARM:]


def figures_of_walls(times: dict[int, list[float]]) -> list[Figure]:
    """Medians and largest times of frames by their number of walls."""
    made = []
    for count, seen in times.items():
        work = f'ring of {ROTORS} rotors with {count} walls'
        made += [
            Figure(f'{work}: processor time a frame, median', 's', [float(np.median(seen))], ''),
            Figure(
                f'{work}: processor time a frame, p99.9',
                's',
                [float(np.quantile(seen, 0.999))],
                'three times the median',
            ),
        ]
    return made
