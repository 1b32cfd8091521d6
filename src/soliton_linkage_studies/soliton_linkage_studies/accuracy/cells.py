# SPDX-License-Identifier: Apache-2.0
"""Test cells of the analyser: each combines a chain, its walls and the errors of its encoders.

The time unit is sqrt(M / k_e) with the mass M of a rotor and the stiffness k_e of a spring. The
lean ratio is d = 2 r sin(theta_bar) / a for the rotor length r, the rest angle theta_bar and the
rotor spacing a. A chain is a spinner if d is above the critical value d_c = 2 / sin(theta_bar),
a wobbling flipper if d is between 1 and d_c, and a flipper without wobble if d is at most 1. A
kink is a wall of charge +1, and an anti-kink is a wall of charge -1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage.linkage.feedback import Feedback
from soliton_linkage.solitons.static_wall import site_arc
from soliton_linkage_studies.accuracy.walls import reach

_MOTIONS = tuple(Motion)
_PERIODS = (0.05, 0.5)
"""Range of the frame period [time units]: 1000 to 100 Hz for M = 0.02 kg and k_e = 50 N/m."""
_NEAREST = 0.02
"""Smallest |d - d_c| / d_c of a random wobbling flipper or spinner [1]."""
_WIDEST = 3.0
"""Largest lean ratio d of spinners, divided by the critical value d_c [1]."""
_LONGEST = 4.0
"""Largest ratio of the rotor length r to the rotor spacing a, as in the paper [1]."""
_APART = 1.6
"""Smallest number of rotors per wall in a random cell with several walls, divided by
2 `reach(chain)` [1]. At the distance `reach` from a wall, its tails have decayed to 1 %."""


@dataclass(frozen=True)
class AccuracyCell:
    """Test cell (one row of the table): a chain, its walls and the errors of its encoders."""

    name: str
    chain: Chain
    """Simulated chain, without the random deviations that `disorder` adds to it."""
    noise: float
    """Standard deviation of the noise of each angle [rad]."""
    speed: float
    """Wanted wall speed at the start of the scene [speed of sound]. The initial rates of a kink
    follow from continuum theory, so that the true speed of a fast kink is different. If the kink
    would break up, slower kinks are tried until one survives (`steady_wall`); cells with `nudged`
    or `disorder` omit this test. This value has no effect in cells without walls (`noise_only` or
    `kick`), or if the wall is at rest (`start`)."""
    period: float
    """Frame period [time units]."""
    run: int
    """Number of frames of a record [1]; each record is analysed by a new analyser."""
    phonons: float = 0.0
    """Root mean square of the rotor rates due to phonons [rad / time unit]."""
    walls: int = 1
    nudged: bool = False
    """Whether the wall starts with a kick at the first edge, which also excites phonons."""
    outliers: float = 0.0
    """Fraction of readings that are replaced by uniformly random angles [1]."""
    wrong_reading: float = 0.0
    """Error of one random encoder in the last frame of a record [rad]; 0 means no error."""
    disorder: float = 0.0
    """Standard deviation of random relative deviations of spacings, rotor lengths, stiffnesses and
    masses in the simulated chain [1]. The analyser is configured without these deviations."""
    impulse_interval: int = 0
    """Mean number of frames between two impulses on the wall [1]; 0 means no impulses. Cells with
    several walls have no impulses."""
    impulses_known: bool = False
    """Whether each impulse is reported to the analyser."""
    unseen: str = ''
    """Rotors without encoder: none (''), both edge rotors ('edges'), or all rotors except one or
    three random ones ('all but one', 'all but three')."""
    kick: float = 0.0
    """Norm of the rates after a kick that is too strong for a wall [rad / time unit]: the wall is
    destroyed before the scene begins. 0 means no kick."""
    noise_only: bool = False
    """Whether all angles are uniformly random, so that no wall exists."""
    degrees: bool = False
    """Whether the analyser receives angles in degrees instead of radians."""
    start: float = math.nan
    """Position of the wall if it is at rest [rotor spacings]; NaN if the wall moves."""
    jitter: float = 0.0
    """Standard deviation of the errors of time stamps [frame periods]."""
    offsets: float = 0.0
    """Offset of the encoder of every tenth rotor [rad]."""
    damping: float = 0.0
    """Decay rate of the rotor rates due to damping [1 / time unit]."""
    damping_known: bool = False
    """Whether the analyser is configured with the damping."""
    length_error: float = 0.0
    """Relative error of the configured rotor length [1]."""
    largest_impulse: float = 0.5
    """Largest relative change of the wall speed by one impulse [1]."""
    configured_chain: Chain | None = None
    """Wrong chain with which the analyser is configured; None if the configured chain is right."""

    @property
    def invalid_input(self) -> bool:
        """Whether the readings are random, in degrees, or do not fit the configured chain.

        Every reported wall is then false.
        """
        return self.noise_only or self.degrees or self.configured_chain is not None

    @property
    def analysed_chain(self) -> Chain:
        """Chain with which the analyser is configured."""
        if self.configured_chain is not None:
            return self.configured_chain
        chain = self.chain
        decay = self.damping / chain.time_unit if self.damping_known else 0.0
        return replace(
            chain,
            rotor_length=chain.rotor_length * (1 + self.length_error),
            damping=chain.damping + decay * chain.moment_of_inertia,
        )


def random_cells(seed: int, count: int) -> list[AccuracyCell]:
    """Draw random cells, with alternating motion classes."""
    return [_drawn(number, np.random.default_rng([seed, number])) for number in range(count)]


def _drawn(number: int, random: Generator) -> AccuracyCell:
    motion = _MOTIONS[number % len(_MOTIONS)]
    walls = int(random.choice((1, 1, 1, 2, 4)))
    chain = _chain(motion, walls, random)
    lively, phonons = bool(random.integers(2)), _between(0.001, 0.03, random)
    return AccuracyCell(
        name=f'{number}',
        chain=chain,
        noise=_between(0.001, 0.1, random),
        speed=_between(0.02, 0.9, random),
        period=_between(*_PERIODS, random),
        run=round(_between(50, 400, random)),
        phonons=phonons if lively else 0.0,
        walls=walls,
    )


def _chain(motion: Motion, walls: int, random: Generator) -> Chain:
    while True:
        rotors = round(_between(10, 200, random))
        rest_angle = float(random.uniform(0.3, 1.3))
        critical = 2 / math.sin(rest_angle)
        low, high = {
            Motion.FLIPPER: (0.1, 1.0),
            Motion.WOBBLING_FLIPPER: (1.0, (1 - _NEAREST) * critical),
            Motion.SPINNER: ((1 + _NEAREST) * critical, _WIDEST * critical),
        }[motion]
        chain = chain_of(rotors, rest_angle, float(random.uniform(low, high)))
        wanted = 2 * reach(chain) * (1 if walls == 1 else _APART * walls)
        if chain.rotor_length <= _LONGEST * chain.spacing and rotors >= wanted:
            return chain


def chain_of(rotors: int, rest_angle: float, lean_ratio: float) -> Chain:
    """Return a chain with a lean ratio d and the default spacing, mass and stiffness."""
    length = lean_ratio * Chain.spacing / (2 * math.sin(rest_angle))
    return Chain(rotors, Chain.spacing, length, rest_angle)


def _between(low: float, high: float, random: Generator) -> float:
    """Return a random number whose logarithm is uniform."""
    return float(np.exp(random.uniform(*np.log((low, high)))))


_LEANS = {'flipper': (33, 0.9, 0.7), 'wobbler': (33, 0.8, 1.6), 'spinner': (33, 1.1, 3.4)}
"""Number of rotors, rest angle [rad] and lean ratio d of one chain per motion class."""
_FORCED_SPEED = 0.15
"""Initial wall speed in the cells with force terms [speed of sound]."""


def hard_cells() -> list[AccuracyCell]:
    """Return the difficult cells; the name of a cell describes its difficulty."""
    chains = {name: chain_of(*lean) for name, lean in _LEANS.items()}
    each = [cell for name, chain in chains.items() for cell in _of_class(name, chain)]
    return each + _of_few() + _of_model(chains)


def _of_model(chains: dict[str, Chain]) -> list[AccuracyCell]:
    edge, narrow = chain_of(40, 0.9, 0.2), chain_of(30, 1.1, 4.39)
    slow, wide = chain_of(40, 1.1, 1.25 * 2 / math.sin(1.1)), chain_of(30, 0.8, 1.6)
    at_rest = [('35', edge, 35.0), ('37', edge, 37.0), ('spinner', narrow, 27.0)]
    at_rest += [
        (f'{name}_{rotors}', replace(chain, number_of_rotors=rotors), 1.0)
        for name, chain in chains.items()
        for rotors in (3, 4, 5)
    ]
    cells = [
        *(
            AccuracyCell(f'edge_{name}', chain, 0.01, 0.0, 0.2, 150, start=start)
            for name, chain, start in at_rest
        ),
        AccuracyCell('slow_spinner', slow, 0.01, 0.03, 4.0, 150),
        AccuracyCell('slow_spinner_outliers', slow, 0.01, 0.03, 4.0, 150, outliers=0.01),
        AccuracyCell('slow_wobbler_30', wide, 0.05, 0.04, 0.3, 400),
    ]
    cases: dict[str, dict[str, Any]] = {
        'offsets': {'offsets': 0.1},
        'jitter': {'jitter': 0.2, 'noise': 0.003, 'speed': 0.6, 'period': 0.5},
        'friction': {'damping': 0.01},
        'friction_known': {'damping': 0.01, 'damping_known': True},
        'shorter': {'length_error': -0.01},
        'longer': {'length_error': 0.01},
        'pushed_10': {'impulse_interval': 200, 'largest_impulse': 0.1, 'run': 600},
    }
    cells += [
        replace(AccuracyCell(f'{case}_{name}', chain, 0.01, 0.15, 0.2, 400), **given)
        for name, chain in chains.items()
        for case, given in cases.items()
    ]
    cells += [
        AccuracyCell(f'{term}_{name}', forced, 0.01, _FORCED_SPEED, 0.2, 400)
        for name, chain in chains.items()
        for term, forced in _with_forces(chain).items()
    ]
    spinner = replace(chains['spinner'], number_of_rotors=60)
    cells.append(AccuracyCell('pair_spinner', spinner, 0.01, 0.1, 0.2, 150, walls=2))
    for share in (0.77, 0.92):
        chain, name = chain_of(30, 0.9, share * 2 / math.sin(0.9)), f'broken_wobbler_{share:g}'
        cells.append(AccuracyCell(name, chain, 0.01, 0.3, 0.2, 400, kick=4.0))
    return cells


def _with_forces(chain: Chain) -> dict[str, Chain]:
    sites = _FORCED_SPEED * speed_of_sound(chain) / chain.spacing
    drag = 0.01 * chain.moment_of_inertia / chain.time_unit
    rate = sites * site_arc(chain)
    kappa = drag * sites / 2
    terms: dict[str, dict[str, Any]] = {
        'dry_friction': {'dry_friction': 0.3 * drag * rate},
        'quadratic_damping': {'quadratic_damping': drag / rate},
        'non_reciprocal': {'non_reciprocity': kappa, 'damping': drag},
        'on_site': {'on_site_torque': 0.3 * drag * rate, 'on_site_phase': 0.5},
        'feedback': {'feedback': Feedback(0.0, drag, kappa, -kappa, delay=1, limit=1e3)},
    }
    return {name: replace(chain, **given) for name, given in terms.items()}


def _of_class(name: str, chain: Chain) -> list[AccuracyCell]:
    plain = AccuracyCell(name, chain, 0.01, 0.15, 0.2, 150)
    other = chain_of(chain.number_of_rotors, chain.rest_angle, 1.3 * chain.lean_ratio)
    cases: dict[str, dict[str, Any]] = {
        'nudged': {'nudged': True, 'run': 2000},
        'outliers_1': {'outliers': 0.01},
        'outliers_5': {'outliers': 0.05},
        'wrong_reading': {'wrong_reading': 3.0, 'run': 15},
        'edges_unseen': {'unseen': 'edges'},
        'three_seen': {'unseen': 'all but three'},
        'one_seen': {'unseen': 'all but one'},
        'noise_alone': {'noise_only': True},
        'degrees': {'degrees': True},
        'other_chain': {'configured_chain': other},
        'pushed': {'impulse_interval': 200, 'run': 600},
        'pushes_told': {'impulse_interval': 200, 'run': 600, 'impulses_known': True},
        **{f'disorder_{100 * share:g}': {'disorder': share} for share in (0.01, 0.03, 0.05, 0.1)},
    }
    cells = [replace(plain, name=f'{case}_{name}', **given) for case, given in cases.items()]
    return [plain, *cells]


def _of_few() -> list[AccuracyCell]:
    flipper, wobbler, spinner = (chain_of(*lean) for lean in _LEANS.values())
    pair, wobblers = chain_of(60, 0.9, 0.7), replace(wobbler, number_of_rotors=60)
    cells = [
        AccuracyCell('broken_flipper', flipper, 0.01, 0.15, 0.2, 150, kick=3.0),
        AccuracyCell('broken_spinner', spinner, 0.01, 0.15, 0.2, 150, kick=6.0),
        AccuracyCell('pair_flipper', pair, 0.01, 0.15, 0.2, 150, walls=2),
        AccuracyCell('pair_wobbler', wobblers, 0.01, 0.1, 0.2, 150, walls=2),
    ]
    for number, (rotors, speed) in enumerate(((16, 0.14), (20, 0.18), (25, 0.23))):
        chain = chain_of(rotors, 1.1, (1.7 + 0.3 * number) * 2 / math.sin(1.1))
        name = f'short_spinner_{rotors}'
        cells.append(AccuracyCell(name, chain, 0.005, speed, 0.2, 150, nudged=True))
    for share, speed in ((0.89, 0.25), (0.96, 0.33)):
        chain = chain_of(30, 0.9, share * 2 / math.sin(0.9))
        sound = speed_of_sound(chain) / chain.spacing * chain.time_unit
        kick, name = speed * sound * site_arc(chain), f'fast_wobbler_{share:g}'
        cells.append(AccuracyCell(name, chain, 0.01, speed, 0.2, 150, kick=kick))
    for rotors, lean, noise in ((17, 1.4, 0.05), (33, 1.87, 0.01), (33, 2.3, 0.01)):
        chain = chain_of(rotors, 0.77, lean)
        name = f'slow_wobbler_{rotors}_{lean:g}'
        cells.append(AccuracyCell(name, chain, noise, 0.03, 0.3, 400, nudged=True))
    return cells


_CELL_VALUES: dict[str, Callable[[AccuracyCell], object]] = {
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
CELL_COLUMNS = tuple(_CELL_VALUES)
"""Columns of the table that describe a cell. Units: noise [rad], speed [speed of sound], period
[time units], run [frames per record], phonons [rad / time unit]."""


def cell_values(cell: AccuracyCell) -> list[str]:
    """Return the values of the columns `CELL_COLUMNS` for a cell, as text."""
    values = (of(cell) for of in _CELL_VALUES.values())
    return [f'{each:.6g}' if isinstance(each, float) else str(each) for each in values]
