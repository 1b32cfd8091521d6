# SPDX-License-Identifier: Apache-2.0
"""Motors compute their torques from measured angles, and hold them from frame to frame."""

import dataclasses
import math
import re

import numpy as np
import pytest
from chain_motions import coordinates, unit_chain
from chains import FLIPPER, SPINNER, chain_of

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.ensemble import simulate_many
from soliton_linkage.dynamics.initial_states import leaning, with_soliton
from soliton_linkage.dynamics.motor_controllers import MotorControllers
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.linkage.feedback import Feedback

LAW = Feedback(0.1, 0.02, 0.3, -0.2, 0.05, 0.04, reference=0.4, delay=2, limit=0.3)


def naive(chain: Chain, now: Array, before: Array, period: float) -> Array:
    law, q, torques = chain.feedback, coordinates(chain, now), np.zeros(len(now))
    v = (q - coordinates(chain, before)) / period
    for n in range(len(now)):
        total = -law.angle * math.remainder(q[n] - law.reference, math.tau) - law.rate * v[n]
        for other, gain, of_rate in [
            (n - 1, law.left_angle, law.left_rate),
            (n + 1, law.right_angle, law.right_rate),
        ]:
            if chain.periodic or 0 <= other < len(now):
                other %= len(now)
                total += gain * math.remainder(q[other] - q[n], math.tau)
                total += of_rate * (v[other] - v[n])
        strength = 1 + (chain.deviations.feedback or [0.0] * len(now))[n]
        torques[n] = chain.signs[n] * min(max(strength * total, -law.limit), law.limit)
    return torques


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
@pytest.mark.parametrize('periodic', [False, True])
def test_torques_follow_the_law_of_the_frame_before_the_delay(example, periodic):
    deviations = Deviations(feedback=(0.5, -1.0, -3.0, 0.0, 0.0, 1.0))
    chain = unit_chain(6, example, periodic=periodic, feedback=LAW, deviations=deviations)
    frames = np.random.default_rng(3).normal(0, 2, (6, 6))
    controllers = MotorControllers(chain)
    found = [controllers.torques(0.1 * k, angles) for k, angles in enumerate(frames)]
    assert not np.any(found[:3])
    for k in range(3, 6):
        expected = naive(chain, frames[k - 2], frames[k - 3], 0.1)
        np.testing.assert_allclose(found[k], expected, rtol=0, atol=1e-14)
    assert np.abs(found).max() == pytest.approx(LAW.limit)


def test_motors_beside_a_missing_angle_have_no_torque():
    chain = unit_chain(6, feedback=dataclasses.replace(LAW, delay=0))
    frames = np.random.default_rng(3).normal(0, 1, (2, 6))
    seen = frames.copy()
    seen[1, 1] = math.nan
    full, partly = MotorControllers(chain), MotorControllers(chain)
    for k in range(2):
        expected, found = full.torques(k, frames[k]), partly.torques(k, seen[k])
    np.testing.assert_array_equal(found, np.where([1, 1, 1, 0, 0, 0], 0.0, expected))


def moved(chain: Chain, period: float, integrator: str = 'symplectic') -> ElasticSimulation:
    start = with_soliton(chain, 3.0, 0.1)
    simulation = ElasticSimulation(
        chain, start.angles, start.rates, period=period, integrator=integrator
    )
    simulation.record(0.4)
    return simulation


def test_feedback_at_short_periods_is_a_non_reciprocal_chain_with_damping():
    chain, kappa, drag = chain_of(FLIPPER, 8), 2e-5, 2e-6
    for law, terms in [
        (Feedback(left_angle=kappa, right_angle=-kappa), {'non_reciprocity': kappa}),
        (Feedback(rate=drag), {'damping': drag}),
    ]:
        expected = moved(dataclasses.replace(chain, **terms), 0.01)
        errors = []
        for period in (0.002, 0.001):
            found = moved(dataclasses.replace(chain, feedback=law), period)
            errors.append(np.abs(found.angles - expected.angles).max())
            assert found.dissipated == pytest.approx(expected.dissipated, rel=20 * period)
        assert errors[1] < 0.02
        assert errors[0] / errors[1] == pytest.approx(2, abs=0.3)


def test_motors_move_a_chain_as_the_same_held_torques():
    chain = dataclasses.replace(
        chain_of(FLIPPER, 8), feedback=Feedback(left_angle=1e-5, rate=1e-6, delay=1)
    )
    start = with_soliton(chain, 3.0, 0.1)
    fed_back = ElasticSimulation(chain, start.angles, start.rates)
    passive = dataclasses.replace(chain, feedback=Feedback())
    held = ElasticSimulation(passive, start.angles, start.rates)
    controllers = MotorControllers(chain)
    for _ in range(40):
        held.hold(controllers.torques(held.time, held.angles))
        for simulation in (held, fed_back):
            simulation.advance()
        assert abs(fed_back.energy_drift) < 1e-10
    np.testing.assert_allclose(fed_back.angles, held.angles, rtol=0, atol=1e-10)
    assert abs(fed_back.dissipated) > 1e-3 * fed_back.energy


def test_feedback_that_cannot_be_computed_is_rejected_in_one_line():
    with pytest.raises(ValueError, match=r'Feedback.delay = -1 must lie in the range 0 to 1000'):
        Feedback(delay=-1)
    with pytest.raises(ValueError, match=re.escape('Feedback.delay = 0.5 must be a whole number')):
        Feedback(delay=0.5)
    with pytest.raises(ValueError, match=r'Feedback\.angle = nan must be a finite number'):
        Feedback(angle=math.nan)
    chain = dataclasses.replace(chain_of(FLIPPER, 8), feedback=Feedback(angle=1e-3))
    with pytest.raises(ValueError, match='simulate_many has no frames') as raised:
        list(simulate_many(chain, [leaning(chain, -1)], 0.1))
    assert '\n' not in str(raised.value)
