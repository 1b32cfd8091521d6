# SPDX-License-Identifier: Apache-2.0
"""The phonon energy beside a wall is estimated from the rates alone."""

import math

import numpy as np
import pytest
from chains import CLASSES, FLIPPER
from orbits import uniform_orbit

from soliton_linkage.linear.normal_modes import normal_modes
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.steering.phonon_energy_estimator import PhononEnergyEstimator

PERIOD = 0.004
ROTORS = 12


def vibrating(orbit: UniformOrbit, arc: float, energy: float, frames: int) -> Array:
    """Return rates of a chain whose energy [J] is in all phonons, shape (T, N)."""
    modes = normal_modes(orbit.chain, orbit.configuration(arc))
    random = np.random.default_rng(5)
    each = energy / (ROTORS - 1)
    speeds = math.sqrt(2 * each) * np.cos(
        modes.frequencies[1:] * PERIOD * np.arange(frames)[:, None]
        + random.uniform(0, 2 * math.pi, ROTORS - 1)
    )
    return np.asarray(speeds @ modes.shapes[:, 1:].T)


def watched(orbit: UniformOrbit, arc: float, rates: Array) -> Array:
    """Return the energy estimated after each frame [J]."""
    watch = PhononEnergyEstimator(orbit)
    energies = []
    for frame, each in enumerate(rates):
        watch.update(frame * PERIOD, each, arc)
        energies.append(watch.energy)
    return np.array(energies)


@pytest.mark.parametrize('example', CLASSES)
def test_the_estimate_is_the_energy_of_the_normal_modes_for_any_wall_motion(example):
    orbit = uniform_orbit(example, ROTORS)
    arc = orbit.arc_at(5.3, 0)
    rates = vibrating(orbit, arc, 2e-6, 800) + 3.0 * orbit.tangent(arc)
    energies = watched(orbit, arc, rates)
    assert np.isnan(energies[:3]).all()
    # The kinetic energy oscillates about half of the total.
    assert energies[300:].mean() == pytest.approx(2e-6, rel=0.05)
    assert energies[300:] == pytest.approx(2e-6, rel=0.3)


def test_white_noise_of_the_rates_does_not_count_as_phonons():
    orbit = uniform_orbit(FLIPPER, ROTORS)
    arc = orbit.arc_at(5.3, 0)
    noise = np.random.default_rng(9).normal(0, 0.1, (3000, ROTORS))
    of_noise = orbit.chain.moment_of_inertia * 0.1**2 * (ROTORS - 1)
    rates = vibrating(orbit, arc, of_noise / 2, 3000) + noise
    # The fastest phonons contribute slightly to third differences.
    assert watched(orbit, arc, rates)[300:].mean() == pytest.approx(of_noise / 2, rel=0.1)
    assert watched(orbit, arc, noise)[300:].mean() < 0.1 * of_noise


def test_frames_without_rates_are_ignored():
    orbit = uniform_orbit(FLIPPER, ROTORS)
    arc = orbit.arc_at(5.3, 0)
    watch = PhononEnergyEstimator(orbit)
    rates = vibrating(orbit, arc, 1e-6, 50)
    for frame, each in enumerate(rates):
        watch.update(frame * PERIOD, each, arc)
    before = watch.energy
    watch.update(1.0, None, arc)
    watch.update(1.1, np.full(ROTORS, np.nan), arc)
    watch.update(0.1, 100 * rates[0], arc)
    assert watch.energy == before
    assert math.isnan(PhononEnergyEstimator(orbit).energy)


def test_decreasing_time_restarts_the_estimate():
    orbit = uniform_orbit(FLIPPER, ROTORS)
    arc = orbit.arc_at(5.3, 0)
    watch = PhononEnergyEstimator(orbit)
    for frame, rates in enumerate(vibrating(orbit, arc, 1e-6, 50)):
        watch.update(100 + frame * PERIOD, rates, arc)
    watch.update(1.0, np.zeros(ROTORS), arc)
    assert math.isnan(watch.energy)
