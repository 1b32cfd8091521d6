# SPDX-License-Identifier: Apache-2.0
"""The observer estimates a wall under known and unknown forces."""

import math

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, WIDE_FLIPPER
from orbits import uniform_orbit
from scipy import linalg

from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.steering.settings import SteeringSettings
from soliton_linkage.steering.wall_observer import WallObserver

PERIOD = 0.004
BANDWIDTH = 25.0


def middle(orbit: UniformOrbit) -> float:
    return orbit.arc_at(orbit.middle, 0)


def watched(
    observer: WallObserver, arcs: Array, acceleration: float = 0.0, noise: float = 0.0
) -> Array:
    """Return arcs, rates and disturbances estimated from frames, shape (3, T)."""
    random, inertia = np.random.default_rng(7), observer.orbit.chain.moment_of_inertia
    seen = []
    for frame, arc in enumerate(arcs.tolist()):
        angles = observer.orbit.configuration(arc)
        angles = angles + noise * random.standard_normal(len(angles))
        torques = inertia * acceleration * observer.orbit.tangent(arc)
        estimate = observer.update(frame * PERIOD, angles, torques)
        assert estimate is not None
        seen.append((estimate.arc, estimate.rate, estimate.disturbance))
    return np.array(seen).T


@pytest.mark.parametrize('example', CLASSES)
def test_known_torques_cause_no_error_and_unknown_ones_no_steady_error(example):
    orbit = uniform_orbit(example, 12)
    times = PERIOD * np.arange(250)
    for disturbance in (0.0, -3.0):
        arcs = middle(orbit) - 1 + 1.5 * times + (2 + disturbance) / 2 * times**2
        rates = 1.5 + (2 + disturbance) * times
        arc, rate, seen = watched(WallObserver(orbit, BANDWIDTH), arcs, acceleration=2.0)
        late = times > 0.6
        assert np.abs(arc - arcs)[late].max() < 1e-5
        assert np.abs(rate - rates)[late].max() < 1e-3
        assert np.abs(seen - disturbance)[late].max() < 0.05


def test_the_observer_has_its_bandwidth_for_any_noise():
    orbit = uniform_orbit(FLIPPER, 12)
    step = np.array([[1, PERIOD, PERIOD**2 / 2], [0, 1, PERIOD], [0, 0, 1]])
    wandered = (BANDWIDTH * PERIOD) ** 2 * np.diag([3, 3 * BANDWIDTH**2, BANDWIDTH**4])
    wandered = step @ wandered @ step.T
    looked = np.array([[1.0, 0.0, 0.0]])
    spread = linalg.solve_discrete_are(step.T, looked.T, wandered, np.eye(1))
    gain = spread @ looked.T / (1 + spread[0, 0])
    kept = (np.eye(3) - gain @ looked) @ step
    by_noise = np.sqrt(np.diag(linalg.solve_discrete_lyapunov(kept, gain @ gain.T)))
    # In continuous time, noise of density 1 gives d the variance 3 / 16 W^5.
    assert by_noise[2] == pytest.approx(math.sqrt(BANDWIDTH**5 * 3 / 16 * PERIOD), rel=0.2)
    for sigma in (0.005, 0.05):
        arcs = np.full(3000, middle(orbit) + 0.1)
        found = watched(WallObserver(orbit, BANDWIDTH), arcs, noise=sigma)
        found[0] -= arcs
        settled = found[:, 300:]
        assert settled.std(axis=1) == pytest.approx(sigma * by_noise, rel=0.15)
        assert abs(settled[0].mean()) < 0.1 * sigma


def test_the_first_frames_have_equal_weight():
    orbit = uniform_orbit(FLIPPER, 12)
    times = PERIOD * np.arange(15)
    arcs = middle(orbit) + 2.0 * times
    _, rate, _ = watched(WallObserver(orbit, 5.0), arcs)
    # A filter memory of 1 / 5 s alone would reach only a third by then.
    assert rate[-1] == pytest.approx(2.0, abs=0.02)


def test_missing_and_invalid_frames_are_bridged():
    orbit = uniform_orbit(FLIPPER, 12)
    observer = WallObserver(orbit, BANDWIDTH)
    times = PERIOD * np.arange(200)
    arcs = middle(orbit) - 1 + 1.5 * times
    watched(observer, arcs)
    unknown = np.full(12, np.nan)
    elsewhere = orbit.configuration(middle(orbit) + 4)
    last = arcs[-1]
    for frame, angles in enumerate([unknown, elsewhere, unknown], start=200):
        estimate = observer.update(frame * PERIOD, angles)
        assert estimate is not None
        assert estimate.seen == pytest.approx(times[-1])
        assert estimate.arc == pytest.approx(last + 1.5 * (frame - 199) * PERIOD, abs=1e-3)
    estimate = observer.update(0.9, orbit.configuration(last + 1.5 * (0.9 - times[-1])))
    assert estimate is not None
    assert estimate.seen == 0.9


def test_one_outlier_moves_the_estimate_by_less_than_noise():
    for off in [0.3, 3.0]:
        for example in CLASSES:
            orbit = uniform_orbit(example, 12)
            observer = WallObserver(orbit, BANDWIDTH)
            arcs = np.full(50, middle(orbit) + 0.3)
            watched(observer, arcs, noise=0.01)
            frame = orbit.configuration(arcs[-1])
            frame[np.argmax(np.abs(orbit.tangent(arcs[-1])))] += off
            estimate = observer.update(50 * PERIOD, frame)
            assert estimate is not None
            assert estimate.arc == pytest.approx(arcs[-1], abs=0.01)


def test_an_undetected_wall_is_lost_and_found_again():
    orbit = uniform_orbit(FLIPPER, 12)
    observer = WallObserver(orbit, BANDWIDTH, SteeringSettings(detection_timeout=0.1))
    watched(observer, np.full(50, middle(orbit)))
    found = [
        observer.update(0.2 + frame * PERIOD, np.full(12, np.nan)) is not None
        for frame in range(60)
    ]
    assert found.count(False) == pytest.approx(60 - 0.1 / PERIOD, abs=2)
    assert found == sorted(found, reverse=True)
    there = middle(orbit) + 4
    for frame in range(60, 120):
        estimate = observer.update(0.2 + frame * PERIOD, orbit.configuration(there))
    assert estimate is not None
    assert estimate.arc == pytest.approx(there, abs=1e-5)


@pytest.mark.parametrize('example', CLASSES)
def test_a_chain_upside_down_is_recognised(example):
    orbit = uniform_orbit(example, 12)
    arc = orbit.arc_at(4.2, 1)
    observer = WallObserver(orbit, BANDWIDTH)
    frame = orbit.configuration(arc)
    for number in range(3):
        estimate = observer.update(number * PERIOD, math.pi - frame)
    assert estimate is not None
    # An upside-down spinner is also a spinner on its other leg.
    back = orbit.configuration(estimate.arc)
    back = math.pi - back if estimate.upside_down else back
    assert np.abs(np.sin((back - (math.pi - frame)) / 2)).max() < 1e-5


def test_configurations_without_a_wall_give_no_estimate():
    orbit = uniform_orbit(WIDE_FLIPPER, 40)
    observer = WallObserver(orbit, BANDWIDTH)
    chain = orbit.chain
    anti_kink = chain.uniform_state(-1)
    anti_kink[20:] = chain.uniform_state(1)[20:]
    random = np.random.default_rng(3)
    for angles in (random.uniform(-3, 3, 40), np.full(40, np.nan), anti_kink * 0 + 2.0):
        assert observer.update(0.0, angles) is None


def test_late_and_repeated_frames_are_ignored_and_a_new_clock_restarts():
    orbit = uniform_orbit(FLIPPER, 12)
    observer = WallObserver(orbit, BANDWIDTH)
    here = middle(orbit)
    for frame in range(50):
        observer.update(10 + frame * PERIOD, orbit.configuration(here))
    estimate = observer.estimate
    for time in (10 + 49 * PERIOD, 10 + 40 * PERIOD):
        assert observer.update(time, orbit.configuration(here + 0.3)) == estimate
    fresh = observer.update(1.0, orbit.configuration(here + 3))
    assert fresh is not None
    assert (fresh.time, fresh.rate) == (1.0, 0.0)
    assert fresh.arc == pytest.approx(here + 3, abs=1e-5)


def test_a_wrong_number_of_angles_is_rejected():
    observer = WallObserver(uniform_orbit(FLIPPER, 12), BANDWIDTH)
    with pytest.raises(ValueError, match='one per rotor'):
        observer.update(0.0, np.zeros(11))
