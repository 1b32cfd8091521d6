# SPDX-License-Identifier: Apache-2.0
"""Known impulses determine the mean mass, for any given value."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, read, unequal

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.readings import Readings, RecordedImpulse
from soliton_linkage.identification.result import Identification
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain

PERIOD = 0.004
FIRST = 110
"""Frame of the first impulse."""
CHAIN = unequal(replace(FLIPPER, number_of_rotors=8), 7)


def kicked(after: int = FIRST, parts: int = 1, every: int = 1) -> tuple[Array, Array, Array]:
    """Times, angles, and impulses, which act in parts every few frames."""
    start = leaning(CHAIN, -1).angles
    impulses = 10.0 * edge_mode(CHAIN, start, Edge.FIRST) * CHAIN.moments_of_inertia
    simulation = ElasticSimulation(CHAIN, start, period=PERIOD, tolerance=1e-8)
    frames = []
    arrivals = range(after, after + parts * every, every)
    for frame in range(332 + parts * every):
        if frame in arrivals:
            simulation.kick(impulses / parts)
        frames.append(simulation.angles.copy())
        simulation.advance()
    return PERIOD * np.arange(len(frames)), np.array(frames), impulses


@pytest.mark.parametrize(
    ('parts', 'every', 'noise'), [(8, 1, 0.01), (38, 5, 0.0005)], ids=['at once', 'for long']
)
def test_the_mean_mass_follows_from_a_sequence_of_impulses(parts, every, noise):
    times, angles, impulses = kicked(parts=parts, every=every)
    readings, _ = read(angles, 2, noise)
    given = Chain(spacing=float(CHAIN.spacings.mean()), mass=5 * CHAIN.mass)
    commanded = PERIOD * (FIRST + every * np.arange(parts)) - 0.006
    sequence = [RecordedImpulse(time, impulses / parts) for time in commanded.tolist()]
    found = identify(Readings(times, readings, impulses=sequence), given)
    error = math.log(found.chain.masses.mean() / CHAIN.masses.mean())
    assert abs(error) < 3 * found.mass_deviation < 0.2
    assert found.chain.stiffness == pytest.approx(CHAIN.stiffness, rel=0.2)


def errors_over_deviations(found: Identification) -> float:
    """Root mean square error of stiffnesses and rotor lengths over the stated deviations."""
    true = CHAIN.stiffnesses / CHAIN.masses.mean()
    shown = found.chain.stiffnesses / found.chain.masses.mean()
    lengths = found.chain.rotor_lengths / found.chain.spacings.mean()
    errors = np.log(lengths / CHAIN.rotor_lengths * CHAIN.spacings.mean())
    over = [np.log(shown / true) / found.deviations['stiffness']]
    over.append(errors / found.deviations['rotor_length'])
    return float(np.sqrt(np.mean(np.concatenate(over) ** 2)))


def test_errors_of_stamps_are_stated_and_included_in_the_deviations():
    times, angles, _ = kicked(0)
    late = times + np.random.default_rng(3).uniform(-1, 1, len(times)) * PERIOD
    found = identify(Readings(np.sort(late), read(angles, 2)[0]), Chain())
    named = re.search(r'stamps have errors of (\S+) ms', found.warnings[0])
    assert named
    assert float(named[1]) == pytest.approx(1e3 * np.std(np.sort(late) - times), rel=0.2)
    assert found.noise == pytest.approx(0.01, rel=0.04)
    assert errors_over_deviations(found) < 1.8


def test_an_unknown_impulse_between_windows_has_no_effect():
    times, angles, _ = kicked(100)
    found = identify(Readings(times, read(angles, 2)[0]), Chain())
    assert found.noise == pytest.approx(0.01, rel=0.02)
    assert errors_over_deviations(found) < 1.8
    assert math.isnan(found.mass_deviation)
