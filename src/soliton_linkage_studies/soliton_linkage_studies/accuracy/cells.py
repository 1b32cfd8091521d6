# SPDX-License-Identifier: Apache-2.0
"""Cells: which chain, which walls, and what is done to the readings of its encoders."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage.solitons.static_wall import site_arc
from soliton_linkage_studies.accuracy.walls import reach

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


def random_cells(seed: int, count: int) -> list[AccuracyCell]:
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
        wanted = 2 * reach(chain) * (1 if walls == 1 else _APART * walls)
        if chain.rotor_length <= _LONGEST * chain.spacing and rotors >= wanted:
            return chain


def chain_of(rotors: int, rest_angle: float, lean_ratio: float) -> Chain:
    """Chain with a lean ratio d, otherwise that of the suite's default."""
    length = lean_ratio * Chain.spacing / (2 * math.sin(rest_angle))
    return Chain(rotors, Chain.spacing, length, rest_angle)


def _between(ends: tuple[float, float], random: np.random.Generator) -> float:
    """A number between two, its logarithm evenly spread."""
    return float(np.exp(random.uniform(*np.log(ends))))


_LEANS = {'flipper': (33, 0.9, 0.7), 'wobbler': (33, 0.8, 1.6), 'spinner': (33, 1.1, 3.4)}
"""Rotors, rest angle [rad] and lean ratio d of a chain of each class."""
_OTHER = 1.3
"""Rotors of another chain, over those of this one [1]."""
_DISORDERS = (0.01, 0.03, 0.05, 0.1)
"""Standard deviations of r, a, k and M, relative."""


def hard_cells() -> list[AccuracyCell]:
    """All of them, by names that say what is hard."""
    chains = {name: chain_of(*lean) for name, lean in _LEANS.items()}
    each = [cell for name, chain in chains.items() for cell in _of_class(name, chain)]
    return each + _of_few()


def _of_class(name: str, chain: Chain) -> list[AccuracyCell]:
    plain = AccuracyCell(name, chain, 0.01, 0.15, 0.2, 150)
    other = chain_of(chain.number_of_rotors, chain.rest_angle, _OTHER * chain.lean_ratio)
    cases: dict[str, dict[str, Any]] = {
        'nudged': {'nudged': True, 'run': 2000},
        'outliers_1': {'outliers': 0.01},
        'outliers_5': {'outliers': 0.05},
        'wrong_reading': {'wrong': 3.0, 'run': 15},
        'edges_unseen': {'unseen': 'edges'},
        'three_seen': {'unseen': 'all but three'},
        'one_seen': {'unseen': 'all but one'},
        'noise_alone': {'nothing': True},
        'degrees': {'degrees': True},
        'other_chain': {'told_chain': other},
        'pushed': {'pushes': 50, 'run': 600},
        'pushes_told': {'pushes': 50, 'run': 600, 'told': True},
        **{f'disorder_{100 * share:g}': {'disorder': share} for share in _DISORDERS},
    }
    cells = [replace(plain, name=f'{case}_{name}', **given) for case, given in cases.items()]
    return [plain, *cells]


def _of_few() -> list[AccuracyCell]:
    """Cases of one class."""
    flipper, wobbler, spinner = (chain_of(*lean) for lean in _LEANS.values())
    pair = chain_of(60, 0.9, 0.7)
    cells = [
        AccuracyCell('broken_flipper', flipper, 0.01, 0.15, 0.2, 150, kick=3.0),
        AccuracyCell('broken_spinner', spinner, 0.01, 0.15, 0.2, 150, kick=6.0),
        AccuracyCell('pair_flipper', pair, 0.01, 0.15, 0.2, 150, walls=2),
        AccuracyCell(
            'pair_wobbler', replace(wobbler, number_of_rotors=60), 0.01, 0.1, 0.2, 150, walls=2
        ),
    ]
    for number, (rotors, speed) in enumerate(((16, 0.14), (20, 0.18), (25, 0.23))):
        chain = chain_of(rotors, 1.1, (1.7 + 0.3 * number) * 2 / math.sin(1.1))
        name = f'short_spinner_{rotors}'
        cells.append(AccuracyCell(name, chain, 0.005, speed, 0.2, 150, nudged=True))
    for share, speed in ((0.89, 0.25), (0.96, 0.33)):
        chain = chain_of(30, 0.9, share * 2 / math.sin(0.9))
        sound = speed_of_sound(chain) / chain.spacing * chain.time_unit
        kick = speed * sound * site_arc(chain)
        cells.append(
            AccuracyCell(f'fast_wobbler_{share:g}', chain, 0.01, speed, 0.2, 150, kick=kick)
        )
    for rotors, lean, noise in ((17, 1.4, 0.05), (33, 1.87, 0.01), (33, 2.3, 0.01)):
        chain = chain_of(rotors, 0.77, lean)
        name = f'slow_wobbler_{rotors}_{lean:g}'
        cells.append(AccuracyCell(name, chain, noise, 0.03, 0.3, 400, nudged=True))
    return cells


_GIVEN: dict[str, Callable[[AccuracyCell], object]] = {
    'class': lambda cell: cell.chain.motion.value,
    'rotors': lambda cell: cell.chain.number_of_rotors,
    'rotor_length_ratio': lambda cell: cell.chain.rotor_length / cell.chain.spacing,
    'rest_angle': lambda cell: cell.chain.rest_angle,
    'd': lambda cell: cell.chain.lean_ratio,
    'd_over_critical': lambda cell: cell.chain.lean_ratio / cell.chain.critical_lean_ratio,
    'noise': lambda cell: cell.noise,
    'speed_wanted': lambda cell: cell.speed,
    'period': lambda cell: cell.period,
    'run': lambda cell: cell.run,
    'phonons': lambda cell: cell.phonons,
    'walls': lambda cell: cell.walls,
}
GIVEN = tuple(_GIVEN)
"""Columns of a cell: noise [rad], speed over that of sound, period [time units], frames of a
record, phonons [rad / time unit]."""


def given_of(cell: AccuracyCell) -> list[str]:
    """Return the columns `GIVEN` of a cell, as text."""
    values = (of(cell) for of in _GIVEN.values())
    return [f'{each:.6g}' if isinstance(each, float) else str(each) for each in values]
