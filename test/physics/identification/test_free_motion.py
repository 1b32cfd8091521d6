# SPDX-License-Identifier: Apache-2.0
"""Free motion is that of the simulation, and its changes with the unknowns are true."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from passages import FLIPPER, read, unequal

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.identification.free_motion import FreeMotion, frames, frames_with_changes
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.lengths import lengths_of
from soliton_linkage.identification.readings import Readings
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations

PERIOD = 0.004


def kicked(rotors: int, speed: float, duration: float) -> tuple[Chain, Array, Array, FreeMotion]:
    """Chain of springs that all differ, times and angles after a kick, and that as a motion."""
    chain = unequal(replace(FLIPPER, number_of_rotors=rotors), 7)
    drawn = drawn_deviations(rotors, 5, mass=0.05, stiffness=0.05)
    chain = replace(chain, deviations=chain.deviations.joined(drawn))
    start = leaning(chain, -1).angles
    rates = speed * edge_mode(chain, start, Edge.FIRST)
    record = simulate(chain, start, rates, duration, PERIOD)
    masses = chain.masses.mean()
    motion = FreeMotion(
        lengths_of(chain), chain.stiffnesses / masses, chain.masses / masses, 0.0, start, rates
    )
    return chain, record.times, record.angles, motion


def test_motion_is_that_of_the_simulation() -> None:
    _, times, angles, motion = kicked(6, 10.0, 0.5)
    assert np.abs(frames(motion, times) - angles).max() < 1e-4


def test_changes_are_those_of_the_motion() -> None:
    _, times, _, motion = kicked(5, 10.0, 0.12)
    motion = replace(motion, damping=1e-3)
    changes = list(frames_with_changes(motion, times))[-1][1]
    for unknown in range(motion.size):
        step = np.zeros(motion.size)
        step[unknown] = 1e-5
        ends = [frames(motion.changed(sign * step), times)[-1] for sign in (1, -1)]
        numeric = (ends[0] - ends[1]) / 2e-5
        # A step may fall into one more of the integration, which is good to 1e-7 here.
        np.testing.assert_allclose(numeric, changes[:, unknown], atol=0.02)


def test_strained_springs_show_lengths_stiffnesses_and_masses() -> None:
    chain, times, angles, _ = kicked(8, 10.0, 1.0)
    readings, _ = read(angles, 2)
    found = identify(Readings(times, readings), Chain(), tolerance=0.05)
    assert not found.rigid
    assert math.isnan(found.mass_deviation)
    names = {
        'rotor_length': chain.rotor_lengths / chain.spacings.mean(),
        'spacing': chain.spacings / chain.spacings.mean(),
        'mass': chain.masses / chain.masses.mean(),
        'stiffness': chain.stiffnesses / chain.masses.mean(),
    }
    shown = {
        'rotor_length': found.chain.rotor_lengths / found.chain.spacings.mean(),
        'spacing': found.chain.spacings / found.chain.spacings.mean(),
        'mass': found.chain.masses / found.chain.masses.mean(),
        'stiffness': found.chain.stiffnesses / found.chain.masses.mean(),
    }
    for name, true in names.items():
        errors = (shown[name] / true - 1) / found.deviations[name]
        assert np.sqrt(np.mean(errors**2)) < 1.8, name
