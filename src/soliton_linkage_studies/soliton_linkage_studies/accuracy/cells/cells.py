# SPDX-License-Identifier: Apache-2.0
"""Cells: which chain, which walls, and what is done to the readings of its encoders."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage_studies.accuracy.cells.walls import reach

_MOTIONS = tuple(Motion)
_ROTORS = (10, 200)
"""Of a chain [1]."""
_NOISES = (0.001, 0.1)
"""Standard deviation of an angle [rad]."""
_SPEEDS = (0.02, 0.9)
"""Over that of sound [1]."""
_PERIODS = (0.05, 0.5)
"""Of frames [time units]: 1000 to 100 a second of a chain of 0.02 kg and 50 N/m."""
_RUNS = (50, 400)
"""Frames of a record."""
_PHONONS = (0.001, 0.03)
"""Rates of rotors [rad / time unit], rms."""
_REST_ANGLES = (0.3, 1.3)
"""Of chains [rad]."""
_NEAREST = 0.02
"""Least distance of d from d_c, relative [1]."""
_FLIPPERS = (0.1, 1.0)
"""Lean ratios d of flippers [1]."""
_WIDEST = 3.0
"""Largest d of spinners, over d_c [1]."""
_LONGEST = 4.0
"""Largest r / a, the paper's."""
_APART = 1.6
"""Rotors for each of several walls, over those that it needs alone [1]: they have a way to go."""
_SEVERAL = (1, 1, 1, 2, 4)
"""Numbers of walls, as likely as each other."""


@dataclass(frozen=True)
class AccuracyCell:
    """Chain, walls and readings of one line of the table."""

    name: str
    chain: Chain
    """As the analyser is told."""
    noise: float
    """Standard deviation of an angle [rad]."""
    speed: float
    """Of the walls over that of sound, as wanted [1]."""
    period: float
    """From frame to frame [time units]."""
    run: int
    """Frames of a record, after which an analyser begins anew."""
    phonons: float = 0.0
    """Rates of rotors beside those of the walls [rad / time unit], rms."""
    walls: int = 1
    nudged: bool = False
    """Whether the wall was kicked off the first edge, and runs among the phonons of that."""
    outliers: float = 0.0
    """Share of readings that are anything [1]."""
    wrong: float = 0.0
    """Error of one reading, anywhere, in the last frame of a record [rad]."""
    disorder: float = 0.0
    """Of r, a, k and M, of which the analyser is not told: standard deviation, relative [1]."""
    pushes: int = 0
    """Of the wall by hand in all records together."""
    told: bool = False
    """Whether the analyser is told of the pushes."""
    unseen: str = ''
    """Rotors that give no angle: '', 'edges', 'all but one' or 'all but three'."""
    kick: float = 0.0
    """Rate of a kick of the edge that breaks the wall up [rad / time unit]; 0 for none."""
    nothing: bool = False
    """Whether angles are noise alone."""
    degrees: bool = False
    """Whether angles are in degrees, of which the analyser is not told."""
    told_chain: Chain | None = None
    """Another chain that the analyser is told; then, as with degrees, no place is to be stated."""

    @property
    def misread(self) -> bool:
        """Whether the analyser cannot understand what it gets."""
        return self.nothing or self.degrees or self.told_chain is not None


def drawn_cells(seed: int, count: int) -> list[AccuracyCell]:
    """Cells drawn at random from the ranges, the classes by turns."""
    return [_drawn(number, np.random.default_rng([seed, number])) for number in range(count)]


def _drawn(number: int, random: np.random.Generator) -> AccuracyCell:
    motion = _MOTIONS[number % len(_MOTIONS)]
    walls = int(random.choice(_SEVERAL))
    chain = _chain(motion, walls, random)
    lively = bool(random.integers(2))
    phonons = _between(_PHONONS, random)
    return AccuracyCell(
        name=f'{number}',
        chain=chain,
        noise=_between(_NOISES, random),
        speed=_between(_SPEEDS, random),
        period=_between(_PERIODS, random),
        run=round(_between(_RUNS, random)),
        phonons=phonons if lively else 0.0,
        walls=walls,
    )


def _chain(motion: Motion, walls: int, random: np.random.Generator) -> Chain:
    """Chain that is long enough for its walls, some widths apart."""
    while True:
        rotors = round(_between(_ROTORS, random))
        rest_angle = float(random.uniform(*_REST_ANGLES))
        critical = 2 / math.sin(rest_angle)
        low, high = {
            Motion.FLIPPER: _FLIPPERS,
            Motion.WOBBLING_FLIPPER: (1.0, (1 - _NEAREST) * critical),
            Motion.SPINNER: ((1 + _NEAREST) * critical, _WIDEST * critical),
        }[motion]
        chain = chain_of(rotors, rest_angle, float(random.uniform(low, high)))
        wanted = room(chain) * (1 if walls == 1 else _APART * walls)
        if chain.rotor_length <= _LONGEST * chain.spacing and rotors >= wanted:
            return chain


def room(chain: Chain) -> float:
    """Rotors that a wall needs for itself [1]."""
    return 2 * reach(chain)


def chain_of(rotors: int, rest_angle: float, lean_ratio: float) -> Chain:
    """Chain with a lean ratio d, otherwise that of the suite's default."""
    length = lean_ratio * Chain.spacing / (2 * math.sin(rest_angle))
    return Chain(rotors, Chain.spacing, length, rest_angle)


def _between(ends: tuple[float, float], random: np.random.Generator) -> float:
    """A number between two, its logarithm evenly spread."""
    return float(np.exp(random.uniform(*np.log(ends))))
