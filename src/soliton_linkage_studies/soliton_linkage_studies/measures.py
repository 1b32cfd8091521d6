# SPDX-License-Identifier: Apache-2.0
"""Measurements on a chain for a sweep; each measurement returns the values of one table row."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import Edge, edge_mode, mode_centre, rigidity_bands, zero_mode
from soliton_linkage.linear.statics import rest_state
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.quantities import CheckedQuantities, quantity
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.passage import blocked_bonds, find_obstacles, motion_of_bonds
from soliton_linkage.solitons.track import Crossing, Track, find_crossings, follow
from soliton_linkage_studies.experiments import kick_rates

_TOLERANCE = 1e-8
"""Largest integration error of an angle in one step [rad]."""
_FRAMES_A_SPACING = 4.0
"""Approximate number of frames in which a wall moves by one rotor spacing [1]."""
_FRAMES_A_SWING = 40.0
"""Approximate number of frames in which an edge rotor turns by 1 rad, or by a / r if r > a [1]."""
_DEPARTED = 1.5
"""The wall of a spinner has left the edge if it has moved by more than this [rotor spacings]."""


@dataclass(frozen=True)
class Leg:
    """Motion of a wall from one edge of the chain towards the other edge."""

    direction: int
    """+1 towards the last rotor, -1 towards rotor 0."""
    crossed: bool
    """Whether the wall reached the other edge."""
    furthest: float
    """Wall position farthest from the edge at which the leg began [rotor spacings]."""
    arc: float
    """Arc length of the leg in configuration space, with the Euclidean norm [rad]."""


def follow_wall(chain: Chain, edge: Edge = Edge.FIRST, legs: int = 2) -> tuple[Leg, ...]:
    """Simulate a chain with rigid bars until the wall has crossed the chain `legs` times.

    The wall position is the centre of the zero mode. The simulation starts in the left-leaning
    rest state if `edge` is the first edge, otherwise in the right-leaning one. In this state of a
    flipper, the wall may be some rotors away from the edge. Therefore the simulation first moves
    it to the edge; in chains with deviations, the wall may instead reach the other edge. This
    first motion is not counted as a leg. The simulation ends early if the wall turns back, or if
    the arc length of a leg exceeds 4 pi N [rad] for N rotors.

    The wall of a flipper reaches an edge when the edge rotor and its spring are in line, because
    then the zero mode is localised on this rotor. The wall of a spinner reaches an edge when the
    edge rotor has the largest component of the zero mode. Raises ValueError if the chain is
    periodic or has no rest state, or if `legs` is below 1. Raises ArithmeticError if the bars jam.
    """
    _check_ends(chain)
    if legs < 1:
        raise ValueError(f'legs = {legs} must be 1 or more; give 2 for a crossing and a return')
    lean, start = (1, chain.number_of_rotors - 1) if edge is Edge.LAST else (-1, 0)
    angles = rest_state(chain, lean)
    mode = edge_mode(chain, angles, edge, anywhere=True)
    spinner = chain.motion is Motion.SPINNER
    rates = mode if spinner else -mode
    simulation = RigidSimulation(chain, angles, rates, _frame_arc(chain), _TOLERANCE)
    if not spinner:
        start, _ = _leg(simulation, start)
    ways: list[Leg] = []
    while len(ways) < legs and (not ways or ways[-1].crossed):
        start, way = _leg(simulation, start)
        ways.append(way)
    return tuple(ways)


def check_passable(chain: Chain) -> None:
    """Raise ValueError if the chain is periodic, or if a wall cannot cross it and return."""
    _check_ends(chain)
    obstacles = find_obstacles(chain)
    if not obstacles:
        return
    last = follow_wall(chain)[-1]
    if last.crossed:
        return
    obstacle = min(obstacles, key=lambda one: abs(one.bond + 0.5 - last.furthest))
    first, second = obstacle.rotor_lengths
    raise ValueError(
        f'the wall turns back at rotor {last.furthest:.1f} of 0 to {chain.number_of_rotors - 1}: '
        f'on bond {obstacle.bond} between rotors of {first:.6g} m and {second:.6g} m, '
        f'{obstacle.spacing:.6g} m apart, the spring of {obstacle.rest_length:.6g} m '
        f'{obstacle.reason}; lower the deviations of the chain there'
    )


def _leg(simulation: RigidSimulation, left: int) -> tuple[int, Leg]:
    """Simulate a leg from the edge rotor `left`; return the edge rotor at its end, and the leg.

    `left` is the edge rotor at which the leg begins: 0 or N - 1. If the arc length exceeds its
    limit before the wall reaches an edge, `left` is also returned as the edge at the end.
    """
    chain, first = simulation.chain, simulation.frame
    last, direction = chain.number_of_rotors - 1, -1 if left else 1
    centre, peak, toggled = _wall(chain, simulation.angles)
    departure = furthest = centre
    arc, longest = 0.0, 4 * math.pi * chain.number_of_rotors
    while arc <= longest:
        before = toggled
        simulation.advance()
        centre, peak, toggled = _wall(chain, simulation.angles)
        furthest = direction * max(direction * furthest, direction * centre)
        departed = direction * (furthest - departure) > _DEPARTED
        arc = (simulation.frame - first) * simulation.period
        if chain.motion is Motion.SPINNER:
            arrived = [peak] if peak in (0, last) and (peak != left or departed) else []
        else:
            passed = zip((0, last), before, toggled, strict=True)
            arrived = [rotor for rotor, was, now in passed if was != now]
        if arrived:
            return arrived[0], Leg(direction, arrived[0] == last - left, furthest, arc)
    return left, Leg(direction, False, furthest, arc)


def _wall(chain: Chain, angles: Array) -> tuple[float, int, tuple[bool, bool]]:
    """Return centre and peak of the zero mode, and whether the lever of each edge is positive.

    The lever of an edge is the derivative of the length of its spring with respect to the angle of
    its rotor. It is 0 if rotor and spring are in line.
    """
    mode = zero_mode(chain, angles)
    first, second = rigidity_bands(chain, angles)
    toggled = bool(first[0] > 0), bool(second[-1] > 0)
    return mode_centre(mode), int(np.argmax(np.abs(mode))), toggled


def _frame_arc(chain: Chain) -> float:
    """Return the arc length per frame [rad]: the frame period [s] times rates of norm 1 rad/s."""
    spacings = 1 + chain.wall_width / chain.spacing
    of_wall = chain.rest_angle / (_FRAMES_A_SPACING * math.sqrt(spacings))
    swing = min(1.0, chain.spacing / chain.rotor_length)
    return max(of_wall, swing / _FRAMES_A_SWING)


def _check_ends(chain: Chain) -> None:
    if chain.periodic:
        raise ValueError(
            f'Chain.periodic = True joins rotor {chain.number_of_rotors - 1} to rotor 0, so that '
            'no wall can run from edge to edge; free the ends of the chain'
        )


BLOCKED = 'blocked'
MECHANICS = ('elastic', 'rigid')
OUTCOMES = ('returns', 'crosses', 'lost')
_PIECE = 20
"""Interval at which the simulation checks whether the wall has returned [sqrt(M / k_e)]."""
_WALL_REACH = 4
"""Energy belongs to a wall if its distance from the wall, divided by the larger of wall width and
penetration depth, is at most this [1]. Within this distance is 98 % of the energy of a wall."""
_JUMP = 5
"""If a track jumps by this or more between frames, it follows another wall [rotor spacings]."""

Value = float | int | str


@dataclass(frozen=True)
class SweepTrial(CheckedQuantities):
    """Parameters of the simulation of a wall that moves through a chain."""

    kick: float = quantity(0.1, 'norm of r phi_dot after the kick', 'a sqrt(k_e / M)', 1e-9, 1e3)
    mechanics: str = quantity('elastic', 'connection between rotors', choices=MECHANICS)
    time_limit: float = quantity(2e3, 'time limit of the return', 'sqrt(M / k_e)', 1.0, 1e6)
    tolerance: float = quantity(
        1e-7, 'largest error of an angle per time unit', 'rad', 1e-13, 1e-2
    )


class SentWall(NamedTuple):
    """Recorded motion of a chain, the track of its wall, and the crossings in this track."""

    recording: Recording
    track: Track
    crossings: tuple[Crossing, ...]


@dataclass(frozen=True)
class Measure:
    """Measurement on a chain, whose results fill one or more columns of the table."""

    take: Callable[[Chain, SweepTrial], dict[str, Value]]
    columns: tuple[str, ...]
    """Names of the values that `take` returns."""
    shown: str
    """Name of the column that the picture shows."""
    label: str
    classes: tuple[str, ...] = ()
    """Possible values of the column `shown`, best first; empty if this column contains numbers."""


def measure_motion(chain: Chain, _trial: SweepTrial) -> dict[str, Value]:
    """Return the motion class, and the number of bonds that may stop a wall."""
    motion, obstacles = motion_of_bonds(chain), int(blocked_bonds(chain).sum())
    return {'motion': motion.value if motion else BLOCKED, 'obstacles': obstacles}


def measure_speed(chain: Chain, trial: SweepTrial) -> dict[str, Value]:
    """Measure the outcome, the speed and the phonon energy of a wall kicked off the right edge.

    `speed` [a sqrt(k_e / M)] is the mean over the middle three fifths of the chain. `phonons` is
    the result of `phonon_share`. Both are NaN if the wall does not cross the chain.
    """
    recording, track, crossings = send_wall(chain, trial)
    speed = phonons = math.nan
    if crossings:
        speed = crossings[0].site_rate * chain.time_unit
        phonons = phonon_share(chain, recording, track, crossings[0])
    return {'outcome': _outcome(len(crossings)), 'speed': speed, 'phonons': phonons}


def measure_survival(chain: Chain, trial: SweepTrial) -> dict[str, Value]:
    """Measure whether a wall crosses a chain of springs or bars and returns."""
    if trial.mechanics == 'elastic':
        crossed = len(send_wall(chain, trial).crossings)
    else:
        crossed = sum(leg.crossed for leg in follow_wall(chain, Edge.LAST))
    return {'outcome': _outcome(crossed), 'obstacles': int(blocked_bonds(chain).sum())}


def send_wall(chain: Chain, trial: SweepTrial) -> SentWall:
    """Kick the wall of an elastic chain off the right edge; simulate until it returns.

    The frame period is `Chain.time_unit`. The simulation also ends at the time limit of the trial.
    A crossing is discarded if the track jumps by five rotor spacings or more between two frames.
    Raises ArithmeticError or ValueError if the chain cannot be simulated.
    """
    angles = rest_state(chain, 1)
    rates = kick_rates(chain, angles, trial.kick, anywhere=True)
    simulation = ElasticSimulation(chain, angles, rates, chain.time_unit, trial.tolerance)
    recording = simulation.record(0.0)
    sent = SentWall(recording, follow(chain, recording), ())
    while len(sent.crossings) < 2 and len(sent.recording.times) <= trial.time_limit:
        sent = _continued(chain, sent, simulation.record(_PIECE * chain.time_unit))
    return sent


def _continued(chain: Chain, sent: SentWall, piece: Recording) -> SentWall:
    recording = Recording(*_joined(sent.recording, piece, ('times', 'angles', 'rates')))
    later = follow(chain, piece)
    track = Track(*_joined(sent.track, later, ('times', 'sites', 'site_rates')))
    crossings = find_crossings(chain, track)
    return SentWall(recording, track, tuple(one for one in crossings if _unbroken(track, one)))


def phonon_share(chain: Chain, recording: Recording, track: Track, crossing: Crossing) -> float:
    """Return the fraction of the energy outside the wall, half way through a crossing [1].

    A rotor is outside if its distance from the wall exceeds four times the larger of wall width
    and penetration depth. The result is NaN if fewer than half of the rotors are outside.
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
    passage = (track.times >= crossing.start) & (track.times <= crossing.end)
    positions = track.sites[passage]
    steps = np.diff(positions[np.isfinite(positions)])
    return bool((np.abs(steps) < _JUMP).all())


def _joined(first: object, second: object, names: tuple[str, ...]) -> list[Array]:
    return [np.concatenate([getattr(first, name), getattr(second, name)[1:]]) for name in names]


def _outcome(crossings: int) -> str:
    return OUTCOMES[2 - min(crossings, 2)]


_MOTIONS = (*(motion.value for motion in Motion), BLOCKED)
_OF_MOTION, _OF_SURVIVAL = ('motion', 'obstacles'), ('outcome', 'obstacles')
_OF_SPEED = ('outcome', 'speed', 'phonons')
MEASURES = {
    'motion': Measure(measure_motion, _OF_MOTION, 'motion', 'class of motion', _MOTIONS),
    'speed': Measure(measure_speed, _OF_SPEED, 'speed', 'speed of the wall [$a\\sqrt{k_e/M}$]'),
    'survival': Measure(
        measure_survival, _OF_SURVIVAL, 'outcome', 'outcome of the wall', OUTCOMES
    ),
}
