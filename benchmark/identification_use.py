# SPDX-License-Identifier: Apache-2.0
"""Errors of identified masses and stiffnesses, and of walls analysed or steered on such chains."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from comparison import Figure
from identification_draws import CHAINS, NOISE, RATE, SPREAD, chain_of, passage, read

from soliton_linkage.dynamics.elastic import ElasticSimulation, simulate
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.relocalisation import fit_anywhere
from soliton_linkage.identification.adjustment import adjust
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.lengths import initial_lengths
from soliton_linkage.identification.readings import Readings
from soliton_linkage.identification.result import Identification
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.steering.steering import Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation

KICKS = {'flipper': 10.0, 'wobbler': 4.0, 'spinner': 12.5}
"""Kicks of spring chains [rad/s], as in config/*.yaml."""
PLURALS = {
    'rotor_length': 'rotor_lengths',
    'spacing': 'spacings',
    'rest_length': 'rest_lengths',
    'stiffness': 'stiffnesses',
    'mass': 'masses',
}
ROTORS = 20
"""Number of rotors of spring chains [1]; more rotors take minutes."""
WAY = (12.3, 24.7)
"""Start and goal of moved walls [rotor spacings]."""
SEEN = 50
"""Number of frames before a move [1]."""
HELD = 250
"""Number of frames after a move [1]."""
LONGEST = 15_000
"""Largest number of frames of a move [1]: one minute."""


def figures_of_springs(name: str, count: int) -> list[Figure]:
    """Return the errors of chains that were identified from the motion after a kick."""
    errors, stated = ({part: [] for part in PLURALS} for _ in range(2))
    for number in range(count):
        chain, found = _springs(name, number)
        for part, spreads in found.deviations.items():
            shown, true = (np.array(getattr(each, PLURALS[part])) for each in (found.chain, chain))
            wrong = np.log(shown / true)
            wrong += np.log(_scale(chain, part) / _scale(found.chain, part))
            errors[part].append(wrong)
            stated[part].append(wrong / spreads)
        print(f'{name} {number}: noise {found.noise:.5f} rad, rigid {found.rigid}', flush=True)
    figures = []
    for part in PLURALS:
        shown = [100 * _rms(errors[part])]
        figures.append(Figure(f'{name}, springs: error of {part}', '%', shown))
        what = f'{name}, springs: the same / stated deviation'
        figures.append(Figure(what, '', [_rms(stated[part])]))
    return figures


def figures_of_use(name: str, count: int) -> list[Figure]:
    """Return the position errors of analyser and steering on identified chains."""
    found, true, moved, moved_true = zip(*_uses(name, count), strict=True)
    return [
        Figure(f'{name}: position error of the analyser / bound of one frame', '', found),
        Figure(f'{name}: the same on the true chain', '', true),
        Figure(f'{name}: final error of a moved wall [spacings]', '', moved, '0.05'),
        Figure(f'{name}: the same on the true chain', '', moved_true),
    ]


def _uses(name: str, count: int) -> Iterator[tuple[float, float, float, float]]:
    nominal, speed = CHAINS[name]
    for number in range(count):
        chain = chain_of(nominal, number)
        random = np.random.default_rng([number, 9])
        orbit = orbit_of(chain)
        angles = passage(orbit, speed)
        offsets, readings = read(angles, random)
        lengths = adjust(readings, initial_lengths(readings)).lengths
        used = lengths.scaled(float(chain.spacings.mean())).chain(nominal)
        again = angles + offsets + NOISE * random.standard_normal(angles.shape)
        yield (
            _position_error(used, orbit, again - lengths.offsets),
            _position_error(chain, orbit, again - offsets),
            _move_error(orbit_of(used), orbit, offsets - lengths.offsets, random),
            _move_error(orbit, orbit, np.zeros_like(offsets), random),
        )
        print(f'{name} {number}: analysed and moved', flush=True)


def _position_error(used: Chain, orbit: Orbit, readings: Array) -> float:
    """Return the rms position error of the analyser, divided by the bound of one frame."""
    analyser = Analyser(used)
    over = []
    for frame, arc in enumerate(np.linspace(*orbit.leg_arcs(0), len(readings))):
        shown = analyser.analyse(round(1e9 * frame / RATE), readings[frame])
        position = orbit.site(arc)
        if 4 < position < len(readings[0]) - 5 and shown is not None and shown.solitons:
            over.append((shown.solitons[0].rotor - position) * orbit.site_arc_at(arc) / NOISE)
    return _rms(np.array(over))


def _move_error(used: Orbit, orbit: Orbit, left: Array, random: np.random.Generator) -> float:
    """Steer a wall by an orbit; return the final distance of the wall from the goal [spacings].

    `left` are the remaining encoder offsets [rad], shape (N,).
    """
    steering = Steering(used, TorqueAllocation(used))
    start = orbit.configuration(orbit.arc_at(WAY[0], 0))
    simulation = ElasticSimulation(orbit.chain, start, period=1 / RATE, tolerance=1e-8)
    ended, torques = math.inf, np.zeros(len(start))
    for frame in range(LONGEST):
        noise = NOISE * random.standard_normal(len(start))
        end = steering.observe(simulation.time, simulation.angles + left + noise)
        if frame == SEEN:
            end = steering.move(WAY[1])
        if end is not None:
            ended = min(ended, frame)
        if frame > ended + HELD:
            break
        simulation.hold(torques)
        torques = steering.torques()
        simulation.advance()
    return abs(orbit.site(fit_anywhere(orbit, simulation.angles).arc) - WAY[1])


def _springs(name: str, number: int) -> tuple[Chain, Identification]:
    """Return a kicked chain and its identification."""
    nominal, speed = CHAINS[name]
    made = chain_of(replace(nominal, number_of_rotors=ROTORS), number)
    random = np.random.default_rng([number, 8])
    drawn = drawn_deviations(ROTORS, number, mass=SPREAD, stiffness=SPREAD)
    chain = replace(made, deviations=made.deviations.joined(drawn))
    start = leaning(chain, -1).angles
    rates = KICKS[name] * edge_mode(chain, start, Edge.FIRST)
    record = simulate(chain, start, rates, 1.3 * ROTORS / speed, 1 / RATE)
    _, readings = read(record.angles, random)
    return chain, identify(Readings(record.times, readings), Chain())


def _scale(chain: Chain, part: str) -> float:
    """Return the mean of all lengths or of all masses, a scale that angles do not determine."""
    whole = chain.masses if part in ('stiffness', 'mass') else chain.spacings
    return float(whole.mean())


def _rms(values: list[Array] | Array) -> float:
    return math.sqrt(float(np.mean(np.concatenate([np.ravel(each) for each in values]) ** 2)))
