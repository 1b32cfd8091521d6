# SPDX-License-Identifier: Apache-2.0
"""Measurements of a sweep on one chain; each returns the values of a table row."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linear.statics import rest_state
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.quantities import check_quantities, quantity
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.passage import blocked_bonds, motion_of_bonds
from soliton_linkage.solitons.track import Crossing, Track, find_crossings, follow
from soliton_linkage_studies.experiments import kick_rates
from soliton_linkage_studies.traversal import follow_wall

BLOCKED = 'blocked'
MECHANICS = ('elastic', 'rigid')
OUTCOMES = ('returns', 'crosses', 'lost')
_PIECE = 20
"""Interval between checks whether the wall has returned [time units]."""
_WALL_REACH = 4
"""Half-width of the wall region, in wall widths or penetration depths [1].

At most 2 % of the wall energy is outside.
"""
_JUMP = 5
"""Displacement between two frames above which the track has changed to another wall [rotors]. The
fastest walls move by 2."""

Value = float | int | str


@dataclass(frozen=True)
class SweepTrial:
    """Parameters of a trial that sends a wall through a chain."""

    kick: float = quantity(
        0.1,
        'norm of the velocities r phi_dot of all masses after the kick',
        'a sqrt(k_e / M)',
        1e-9,
        1e3,
    )
    mechanics: str = quantity('elastic', 'connection between rotors', choices=MECHANICS)
    time_limit: float = quantity(
        2000.0, 'time limit for the return of the wall', 'sqrt(M / k_e)', 1.0, 1e6
    )
    tolerance: float = quantity(1e-7, 'tolerance of the angles in a time unit', 'rad', 1e-13, 1e-2)

    def __post_init__(self) -> None:
        """Check the parameter ranges."""
        check_quantities(self)


@dataclass(frozen=True)
class Measure:
    """Measurement of a chain, and the column that its picture shows."""

    take: Callable[[Chain, SweepTrial], dict[str, Value]]
    columns: tuple[str, ...]
    """Names of the values that `take` returns."""
    shown: str
    """Name of the drawn column."""
    label: str
    classes: tuple[str, ...] = ()
    """Values of the drawn column, best first; empty for a numeric column."""


def measure_motion(chain: Chain, _trial: SweepTrial) -> dict[str, Value]:
    """Return the motion class from the bonds, and the number of bonds that may stop a wall."""
    motion = motion_of_bonds(chain)
    return {
        'motion': motion.value if motion else BLOCKED,
        'obstacles': int(blocked_bonds(chain).sum()),
    }


def measure_speed(chain: Chain, trial: SweepTrial) -> dict[str, Value]:
    """Measure outcome, speed and phonon energy fraction of a wall kicked from the right edge.

    The speed [a sqrt(k_e / M)] is the slope of the wall's path between the outer fifths of the
    chain. `phonons` is the result of `phonon_share`. Both are NaN without a crossing.
    """
    recording, track, crossings = send_wall(chain, trial)
    return {
        'outcome': _outcome(len(crossings)),
        'speed': crossings[0].site_rate * chain.time_unit if crossings else math.nan,
        'phonons': phonon_share(chain, recording, track, crossings[0]) if crossings else math.nan,
    }


def measure_survival(chain: Chain, trial: SweepTrial) -> dict[str, Value]:
    """Measure whether a wall crosses a chain of springs or rigid bars and returns."""
    if trial.mechanics == 'elastic':
        crossed = len(send_wall(chain, trial)[2])
    else:
        crossed = sum(leg.crossed for leg in follow_wall(chain, Edge.LAST))
    return {'outcome': _outcome(crossed), 'obstacles': int(blocked_bonds(chain).sum())}


def send_wall(chain: Chain, trial: SweepTrial) -> tuple[Recording, Track, tuple[Crossing, ...]]:
    """Kick the wall of an elastic chain off its right edge; simulate until it returns.

    The frame period is one time unit, in which a wall moves by at most two spacings. A larger jump
    means that the track has changed to another wall, and the crossing is discarded. If the wall
    does not return, the simulation ends at the time limit.
    """
    angles = rest_state(chain, 1)
    rates = kick_rates(chain, angles, trial.kick, anywhere=True)
    simulation = ElasticSimulation(chain, angles, rates, chain.time_unit, trial.tolerance)
    recording = simulation.record(0)
    track = follow(chain, recording)
    crossings: tuple[Crossing, ...] = ()
    while len(crossings) < 2 and simulation.frame < trial.time_limit:
        piece = simulation.record(_PIECE * chain.time_unit)
        later = follow(chain, piece)
        recording = Recording(*_joined(recording, piece, ('times', 'angles', 'rates')))
        track = Track(*_joined(track, later, ('times', 'sites', 'site_rates')))
        crossings = tuple(
            crossing for crossing in find_crossings(chain, track) if _unbroken(track, crossing)
        )
    return recording, track, crossings


def phonon_share(chain: Chain, recording: Recording, track: Track, crossing: Crossing) -> float:
    """Return the fraction of the energy outside the wall in the middle of a crossing [1].

    Rotors and springs are outside the wall if their distance exceeds four times the wall width and
    four times the penetration depth. Returns NaN if less than half of the rotors are outside.
    """
    under_way = (track.times >= crossing.start) & (track.times <= crossing.end)
    half_way = np.abs(track.sites - (chain.number_of_rotors - 1) / 2)
    frame = int(np.nanargmin(np.where(under_way, half_way, np.nan)))
    angles, rates = recording.angles[frame], recording.rates[frame]
    kinetic = 0.5 * chain.moments_of_inertia * rates**2
    elastic = 0.5 * chain.stiffnesses * chain.spring_extensions(angles) ** 2
    reach = _WALL_REACH * max(chain.wall_width, penetration_depth(chain)) / chain.spacing
    if 2 * reach > chain.number_of_rotors / 2:
        return math.nan
    distances = np.abs(np.arange(chain.number_of_rotors) - track.sites[frame])
    outside = float(kinetic[distances > reach].sum())
    outside += float(elastic[distances[:-1] > reach].sum())
    return outside / float(kinetic.sum() + elastic.sum())


def _unbroken(track: Track, crossing: Crossing) -> bool:
    """Return whether the track of a crossing has no jump to another wall."""
    passage = (track.times >= crossing.start) & (track.times <= crossing.end)
    places = track.sites[passage]
    steps = np.diff(places[np.isfinite(places)])
    return bool((np.abs(steps) < _JUMP).all())


def _joined(first: object, second: object, names: tuple[str, ...]) -> list[Array]:
    """Concatenate two recordings or tracks; the second repeats the last frame of the first."""
    return [np.concatenate([getattr(first, name), getattr(second, name)[1:]]) for name in names]


def _outcome(crossings: int) -> str:
    return OUTCOMES[2 - min(crossings, 2)]


MEASURES = {
    'motion': Measure(
        measure_motion,
        ('motion', 'obstacles'),
        'motion',
        'class of motion',
        (*(motion.value for motion in Motion), BLOCKED),
    ),
    'speed': Measure(
        measure_speed,
        ('outcome', 'speed', 'phonons'),
        'speed',
        'speed of the wall [$a\\sqrt{k_e/M}$]',
    ),
    'survival': Measure(
        measure_survival, ('outcome', 'obstacles'), 'outcome', 'outcome of the wall', OUTCOMES
    ),
}
