# SPDX-License-Identifier: Apache-2.0
"""Masses of bars follow from the speed of a wall, and their scale from gravity."""

import math
from dataclasses import replace

import numpy as np
import pytest
from passages import FLIPPER, passage, read, unequal

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.identification.adjustment import observable_basis
from soliton_linkage.identification.bar_motion import bar_motion
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.lengths import chain_lengths
from soliton_linkage.identification.readings import Readings, join_recordings
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity
from soliton_linkage.orbit.deviating_orbit import orbit_of

PERIOD = 0.004
_MADE = unequal(FLIPPER, 7)
CHAIN = replace(
    _MADE, deviations=_MADE.deviations.joined(drawn_deviations(10, 5, mass=0.1)), damping=5e-6
)
SPACING = float(CHAIN.spacings.mean())
LENGTHS = chain_lengths(CHAIN).scaled(1.0)
EXACT = np.zeros((38, 38))
NOISE = 0.005


def recorded(gravity: Gravity, site: float, speed: float, frames: int = 400) -> Readings:
    """Angles of bars whose wall begins at a site with an arc rate [rad/s]."""
    orbit = orbit_of(CHAIN)
    arc = orbit.arc_at(site, 0)
    rates = speed * orbit.tangent(arc)
    start = orbit.configuration(arc)
    simulation = RigidSimulation(CHAIN, start, rates, PERIOD, 1e-9, gravity)
    angles: list[Array] = []
    for _ in range(frames):
        angles.append(simulation.angles.copy())
        simulation.advance()
    return Readings(PERIOD * np.arange(frames), np.array(angles), gravity=gravity)


def noisy(exact: Readings) -> Readings:
    return replace(exact, angles=read(exact.angles, 1, NOISE, 0.0)[0], parts=())


def test_masses_and_damping_follow_from_the_speed_of_a_wall():
    free = recorded(NO_GRAVITY, 0.6, 14.0)
    readings = replace(free, angles=read(free.angles, 1, NOISE)[0])
    found = identify(readings, Chain(spacing=SPACING))
    assert found.rigid
    errors = found.chain.masses / found.chain.mass / (CHAIN.masses / CHAIN.masses.mean()) - 1
    over = errors / found.deviations['mass']
    assert np.sqrt(np.mean(over**2)) < 1.6
    assert np.median(found.deviations['mass']) < 0.05
    error = found.chain.damping * CHAIN.masses.mean() / found.chain.mass - CHAIN.damping
    assert abs(error) < 3 * found.damping_deviation


def test_masses_that_imitate_a_kick_cause_a_warning():
    free = recorded(NO_GRAVITY, 0.6, 14.0)
    # Every fifth frame, then every fourth: the speed of the wall suddenly decreases by 20 %.
    frames = np.concatenate([np.arange(0, 200, 5), np.arange(199, 400, 4)])
    times = 5 * PERIOD * np.arange(len(frames))
    kicked = Readings(times, read(free.angles[frames], 1, 2 * NOISE)[0])
    warnings = identify(kicked, Chain(spacing=SPACING)).warnings
    assert [each for each in warnings if each.startswith('the masses vary by')]
    readings = replace(free, angles=read(free.angles, 1, NOISE)[0])
    free_warnings = identify(readings, Chain(spacing=SPACING)).warnings
    assert not [each for each in free_warnings if each.startswith('the masses vary by')]


def test_gravity_at_two_tilts_determines_the_scale_of_all_lengths():
    """Lengths and offsets are known to 1 %."""
    both = noisy(
        join_recordings([recorded(Gravity(0.5, tilt), 0.6, 14.0, 250) for tilt in (0.3, -0.3)])
    )
    falling = replace(both, gravity=Gravity(0.5 / (1.5 * SPACING), 0.3))
    keeping = observable_basis(LENGTHS)
    root = 0.01 * keeping @ keeping.T
    known = LENGTHS.changed(root @ np.random.default_rng(3).standard_normal(len(root)))
    found = bar_motion(falling, known, root @ root.T, NOISE, gravity_known=False)
    assert found is not None
    error = math.log(found.gravity * SPACING / 0.5)
    assert abs(error) < 3 * found.gravity_deviation < 0.1
    errors = found.masses * CHAIN.masses.mean() / CHAIN.masses - 1
    over = errors / found.mass_deviations
    assert np.sqrt(np.mean(over**2)) < 1.6


def test_a_wall_that_is_moved_by_hand_determines_no_masses():
    angles = passage(CHAIN, 250)
    frames = (250 * np.linspace(0, 0.999, 125) ** 2).astype(int)
    moved = noisy(Readings(PERIOD * np.arange(125), angles[frames]))
    assert bar_motion(moved, LENGTHS, EXACT, NOISE, gravity_known=True) is None


def test_recordings_of_different_joints_are_rejected():
    one = Readings(np.arange(3.0), np.zeros((3, 2)), names=('a', 'b'))
    other = Readings(np.arange(3.0), np.zeros((3, 2)), names=('a', 'c'))
    with pytest.raises(ValueError, match="'a' to 'c', is not of the chain of 2 joints"):
        join_recordings([one, other])
