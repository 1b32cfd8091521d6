# SPDX-License-Identifier: Apache-2.0
"""Corrections for the compliance of springs and for unseen rotors against the full equations."""

import math
from dataclasses import replace

import numpy as np
import pytest
from chains import CLASSES, SPINNER, STRONG_WOBBLER, chain_of
from orbits import uniform_orbit
from scipy.optimize import brentq
from scipy.signal import savgol_filter

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.estimation.estimates import TrackingStatus
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.estimation.orbit_model import (
    ComplianceCorrection,
    UnseenRotorCorrection,
)
from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.linear.bands import gap, speed_of_sound
from soliton_linkage.linear.rigidity import dynamical_matrix, rigidity_matrix
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit

FLIPPER_CHAIN, WOBBLER_CHAIN, SPINNER_CHAIN = (
    Chain(17, rotor_length=length, rest_angle=rest)
    for length, rest in ((0.05, 0.97), (0.1, 0.77), (0.13, 1.3))
)


def bent(orbit: Orbit, arc: float) -> tuple[Array, Array]:
    """Return Phi'' and D^(-1) Phi'' with the dynamical matrix D."""
    step = 1e-3
    bend = (orbit.tangent(arc + step) - orbit.tangent(arc - step)) / (2 * step)
    matrix = dynamical_matrix(orbit.chain, orbit.configuration(arc)).toarray()
    return bend, np.linalg.lstsq(matrix, bend, rcond=1e-9)[0]


@pytest.mark.parametrize('chain', [FLIPPER_CHAIN, WOBBLER_CHAIN, SPINNER_CHAIN])
def test_mu_is_the_compliance_along_the_curvature(chain):
    for leg in [0, 1]:
        orbit = orbit_of(chain)
        compliance = ComplianceCorrection(orbit)
        for site in (8.0, 8.3, 7.55):
            arc = orbit.arc_at(site, leg)
            bend, given = bent(orbit, arc)
            assert compliance.mu(arc) == pytest.approx(bend @ given, rel=0.02)


def test_deviations_do_not_change_the_compliance():
    even = orbit_of(WOBBLER_CHAIN)
    drawn = drawn_deviations(17, 3, spacing=0.03)
    uneven = orbit_of(replace(WOBBLER_CHAIN, deviations=drawn))
    one, other = ComplianceCorrection(even), ComplianceCorrection(uneven)
    for site in (4.0, 9.3):
        found, expected = other.mu(uneven.arc_at(site, 1)), one.mu(even.arc_at(site, 1))
        assert found == pytest.approx(expected, rel=0.1)


def nearest_arc(orbit: Orbit, angles: Array, arc: float) -> float:
    """Return the arc of the nearest point of the orbit, starting near it."""
    for _ in range(8):
        arc += orbit.tangent(arc) @ (angles - orbit.configuration(arc))
    return arc


def test_a_slow_wall_conserves_its_energy():
    orbit = orbit_of(WOBBLER_CHAIN)
    compliance, slow, begin = ComplianceCorrection(orbit), 1.2, orbit.arc_at(5.0, 0)
    angles = orbit.configuration(begin) - slow**2 * bent(orbit, begin)[1]
    period = 0.25 * WOBBLER_CHAIN.time_unit
    run = simulate(WOBBLER_CHAIN, angles, slow * orbit.tangent(begin), 800 * period, period)
    arcs = [begin]
    for frame in run.angles[1:]:
        arcs.append(nearest_arc(orbit, frame, arcs[-1]))
    went = np.gradient(arcs, period)[20:-20]
    reported = [compliance.rate_ratio(arc, slow, begin) for arc in arcs[20:-20]]
    assert np.std(went / reported) < 0.3 * np.std(went)


def test_fast_walls_have_no_compliance_correction():
    """Near d_c the lowest order fails even for slow walls."""
    for share, rate in [(0.5, 100.0), (0.98, 1.0)]:
        length = share / math.sin(0.77) ** 2 * WOBBLER_CHAIN.spacing
        orbit = orbit_of(Chain(17, rotor_length=length, rest_angle=0.77))
        one, other = orbit.arc_at(5.0, 0), orbit.arc_at(5.5, 0)
        compliance = ComplianceCorrection(orbit)
        assert compliance.rate_ratio(other, rate, one) == 1.0
        assert compliance.rate_ratio(other, 1e-3 * rate, one) != 1.0


def test_impulses_add_up():
    compliance = ComplianceCorrection(orbit_of(WOBBLER_CHAIN))
    for added in [-2.0, 0.0, 7.0]:
        for rate in [-3.0, 0.0, 0.5]:
            pushed = compliance.rate_after_impulse(rate, added)
            before, after = (each * compliance.contraction(each)[0] for each in (rate, pushed))
            assert after == pytest.approx(before + added)


ROTORS, RATE = 10, 8.0
ARC_STEP = 1e-4


def stiffness(orbit: Orbit, arc: float) -> Array:
    """Return the dense stiffness matrix K = R^T k R, shape (N, N)."""
    levers = rigidity_matrix(orbit.chain, orbit.configuration(arc)).toarray()
    return np.asarray(levers.T @ (orbit.chain.stiffnesses[:, None] * levers))


def seen_shift(
    orbit: Orbit, arc: float, beside: Array, hidden: list[int], rate: float, noise: float
) -> tuple[float, float]:
    """Return the nearest arc for seen rotors without and with springs [rad]."""
    tangent = orbit.tangent(arc)
    seen = np.delete(np.arange(ROTORS), hidden)
    nearest = float(tangent[seen] @ beside[seen] / (tangent[seen] @ tangent[seen]))
    residuals = beside - nearest * tangent
    residuals[hidden] = np.nan
    at_rest, by_rate = UnseenRotorCorrection(orbit).shift(arc, residuals, 1.0, noise)
    return nearest, nearest + at_rest + by_rate * rate**2


@pytest.mark.parametrize('example', CLASSES)
def test_balanced_rotors_need_not_be_seen(example):
    for hidden in [[5], [4, 5], [3, 6]]:
        orbit = uniform_orbit(example, ROTORS)
        arc = orbit.arc_at(4.7, 0)
        held, beside = stiffness(orbit, arc), np.random.default_rng(1).normal(0, 1e-3, ROTORS)
        others = np.delete(np.arange(ROTORS), hidden)
        pulled = held[hidden][:, others] @ beside[others]
        beside[hidden] = -np.linalg.solve(held[hidden][:, hidden], pulled)
        without, informed = seen_shift(orbit, arc, beside, hidden, 0.0, 1e-12)
        nearest = orbit.tangent(arc) @ beside
        assert informed == pytest.approx(nearest, abs=1e-8)
        assert abs(without - nearest) > 1e-6


@pytest.mark.parametrize('example', CLASSES)
def test_inertial_forces_on_unseen_rotors_do_not_shift_the_arc(example):
    orbit = uniform_orbit(example, ROTORS)
    arc = orbit.arc_at(4.4, 0)
    bend = (orbit.tangent(arc + ARC_STEP) - orbit.tangent(arc - ARC_STEP)) / (2 * ARC_STEP)
    turning = orbit.chain.moment_of_inertia * bend * RATE**2
    beside = -np.linalg.pinv(stiffness(orbit, arc), rcond=1e-9) @ turning
    without, informed = seen_shift(orbit, arc, beside, [5], RATE, 1e-12)
    assert abs(informed) < 0.02 * abs(without)


@pytest.mark.parametrize('begin', [16.1, 20.1])
def test_an_uncertain_rate_causes_no_drift_of_the_corrected_arc(begin):
    orbit = orbit_of(Chain(33, rotor_length=0.17 / math.sin(1.1), rest_angle=1.1))
    rate, noise, period = 0.15 * speed_of_sound(orbit.chain) / 0.1 * orbit.site_arc, 0.01, 0.004
    start = orbit.arc_at(begin, 0)
    errors = []
    for seed in range(20):
        random, follower = np.random.default_rng(seed), OrbitFilter(orbit, noise)
        for frame in range(12):
            arc = start + rate * frame * period
            angles = np.full(33, np.nan)
            seen = [10, round(begin) + 1, 32]
            exact = orbit.configuration(arc) - rate**2 * bent(orbit, arc)[1]
            angles[seen] = exact[seen] + noise * random.standard_normal(3)
            estimate = follower.update(frame * period, angles)
            if estimate.status is TrackingStatus.TRACKING and estimate.leg == 0:
                errors.append(
                    (
                        (estimate.site - orbit.site(arc)) / estimate.site_deviation,
                        (estimate.rate - rate) / estimate.rate_deviation,
                    )
                )
    assert len(errors) > 100
    assert np.sqrt(np.mean(np.square(errors), axis=0)).max() < 1.5
    assert np.abs(errors).max() < 5


def test_the_correction_vanishes_in_noise_and_for_distant_rotors():
    orbit = uniform_orbit(SPINNER, ROTORS)
    arc = orbit.arc_at(4.7, 0)
    beside = np.random.default_rng(2).normal(0, 1e-3, ROTORS)
    without, informed = seen_shift(orbit, arc, beside, [5], 0.0, 1e-12)
    _, noisy = seen_shift(orbit, arc, beside, [5], 0.0, 100.0)
    assert abs(noisy - without) < 0.2 * abs(informed - without)
    far, same = seen_shift(orbit, orbit.arc_at(1.0, 0), beside, [9], 0.0, 1.0)
    assert same == far


@pytest.mark.parametrize('periods', [3.5, 8.0])
def test_the_stated_change_of_the_rate_within_a_site_is_that_of_a_wall_on_springs(periods):
    chain = chain_of(STRONG_WOBBLER, 21)
    orbit = orbit_of(chain)
    compliance, begin = ComplianceCorrection(orbit), orbit.arc_at(5.0, 0)
    phonon = 2 * math.pi / gap(chain)
    rate = orbit.site_arc / (periods * phonon)
    angles = orbit.configuration(begin) - rate**2 * bent(orbit, begin)[1]
    step, passage = phonon / 40, periods * phonon
    run = simulate(chain, angles, rate * orbit.tangent(begin), 4 * passage, step)
    arcs = [begin]
    for frame in run.angles[1:]:
        arcs.append(nearest_arc(orbit, frame, 2 * arcs[-1] - arcs[-2] if arcs[1:] else begin))
    # The slope over three periods; its line would level out the speed of the slower wall.
    slopes = savgol_filter(arcs, 121, 1 if periods < 4 else 3, deriv=1, delta=step)[60:-60]
    predicted = [compliance.rate_ratio(arc, rate, begin) for arc in arcs[60:-60]]
    missing = float(np.std(slopes / predicted) / np.mean(slopes))
    changes = [compliance.unpredicted_change(rate, arc) for arc in arcs[60:-60]]
    stated = math.sqrt(np.mean(np.square(changes)))
    assert 0.3 * stated < missing < 1.5 * stated


@pytest.mark.parametrize('chain', [FLIPPER_CHAIN, WOBBLER_CHAIN, SPINNER_CHAIN])
def test_momentum_is_the_integral_of_its_derivative(chain):
    compliance = ComplianceCorrection(orbit_of(chain))
    for rate in (-9.0, 0.5, 6.0):
        step = 1e-4 * rate
        slope = (compliance.rate_after_impulse(rate, step) - rate) / step
        momentum = -brentq(lambda p, w=rate: compliance.rate_after_impulse(w, p), -1e3, 1e3)
        gamma, inertia = compliance.contraction(rate)
        assert gamma == pytest.approx(momentum / rate, rel=1e-6)
        assert inertia == pytest.approx(1 / slope, rel=1e-3)


@pytest.mark.parametrize('periods', [1, 3, 8])
def test_the_bias_that_replaces_a_ripple_causes_equal_errors_of_the_rate(periods):
    orbit = uniform_orbit(SPINNER, ROTORS)
    compliance, rate = ComplianceCorrection(orbit), 0.5 * RATE
    ripple, period, count = compliance.ripple(rate), 2.0, 400
    assert ripple > 0
    by_ripple, by_bias = [], []
    for whole in periods + np.arange(0, 1, 0.1):
        sites = np.linspace(0, whole * period, count)
        centred = sites - sites.mean()
        weights = centred / (centred @ centred)
        waves = np.exp(2j * math.pi * sites / period)
        by_ripple.append(ripple * abs(weights @ waves) ** 2)
        way = DEFAULTS.filter.bias_way
        correlations = np.exp(-np.abs(sites[:, None] - sites) / way)
        duration = whole * period * orbit.site_arc / rate
        bias = compliance.ripple_bias(rate, duration)
        by_bias.append(bias * float(weights @ correlations @ weights))
    assert np.mean(by_ripple) == pytest.approx(np.mean(by_bias), rel=0.3)
