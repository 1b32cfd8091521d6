# SPDX-License-Identifier: Apache-2.0
"""A kick that was not recorded is found, and the motions before and after it are used."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from passages import FLIPPER, WOBBLER, read, unequal

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.identification.identification import identify
from soliton_linkage.identification.kicks import fit_around_kicks, largest_steps
from soliton_linkage.identification.readings import Readings, RecordedImpulse
from soliton_linkage.linear.rigidity import Edge, edge_mode, zero_mode
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import drawn_deviations

PERIOD = 1 / 150
BEFORE, AFTER = 1.08, 1.33
PULL = 0.15
"""Time from the first to the last of several kicks, which approximate a pull [s]."""
NEAR = 0.05
"""Largest error of the time of a kick [s]."""

LONG = replace(FLIPPER, number_of_rotors=12)
WOBBLING = replace(WOBBLER, number_of_rotors=8)

PARTS = (
    ('rotor_length', 'rotor_lengths', 'spacings'),
    ('spacing', 'spacings', 'spacings'),
    ('rest_length', 'rest_lengths', 'spacings'),
    ('stiffness', 'stiffnesses', 'masses'),
    ('mass', 'masses', 'masses'),
)
"""Deviation, values, and the values whose mean is given, of each kind of unknown."""


def kicked(
    seed: int,
    *sizes: float,
    nominal: Chain = LONG,
    speed: float = 10.0,
    period: float = PERIOD,
    spans: tuple[float, float] = (BEFORE, AFTER),
    noise: float = 0.01,
) -> tuple[Chain, Readings]:
    """Chain and its readings; successive kicks change the speed by the factors 1 + `sizes`.

    `spans` are the times before the first and after the last kick [s].
    """
    chain = unequal(nominal, seed)
    drawn = drawn_deviations(chain.number_of_rotors, seed, mass=0.05, stiffness=0.05)
    chain = replace(chain, deviations=chain.deviations.joined(drawn))
    start = leaning(chain, -1).angles
    motion = simulate(chain, start, speed * edge_mode(chain, start, Edge.FIRST), spans[0], period)
    parts = [motion.angles]
    for number, size in enumerate(sizes, 1):
        angles, rates = motion.angles[-1], motion.rates[-1]
        mode = zero_mode(chain, angles)
        momenta = chain.moments_of_inertia * mode
        change = size * (momenta @ rates) / (momenta @ mode) * mode
        duration = spans[1] if number == len(sizes) else PULL / (len(sizes) - 1)
        motion = simulate(chain, angles, rates + change, duration, period)
        parts.append(motion.angles[1:])
    whole = np.concatenate(parts)
    return chain, Readings(period * np.arange(len(whole)), read(whole, seed, noise)[0])


@pytest.mark.parametrize(('seed', 'size'), [(2, -0.1), (7, 0.25)])
def test_a_kick_is_named_and_errors_agree_with_the_stated_deviations(seed, size):
    chain, readings = kicked(seed, size)
    found = identify(readings, Chain())
    (warning,) = (each for each in found.warnings if 'kick that was not recorded' in each)
    assert float(warning.split(' near ')[1].split(' s;')[0]) == pytest.approx(BEFORE, abs=NEAR)
    assert warning.endswith('check that no rotor is missing before rotor 0 or after rotor 11')
    assert found.noise == pytest.approx(0.01, rel=0.04)
    for name, values, unit in PARTS:
        shown, true = (getattr(each, values) for each in (found.chain, chain))
        scale = getattr(chain, unit).mean() / getattr(found.chain, unit).mean()
        errors = np.log(shown / true * scale) / found.deviations[name]
        assert np.sqrt(np.mean(errors**2)) < 2.0, name


@pytest.mark.parametrize('seed', [0, 6])
def test_a_kick_that_unequal_masses_imitate_is_found_by_a_test_of_the_momentum(seed):
    chain, readings = kicked(seed, 0.1, period=0.01, spans=(0.81, 0.81))
    found = identify(readings, Chain())
    named = found.warnings[0].partition('a kick that was not recorded acts near ')[2]
    assert float(named.partition(' s;')[0]) == pytest.approx(0.81, abs=NEAR)
    scale = chain.spacings.mean() / found.chain.spacings.mean()
    errors = np.log(scale * found.chain.rotor_lengths / chain.rotor_lengths)
    assert np.sqrt(np.mean((errors / found.deviations['rotor_length']) ** 2)) < 2.0


@pytest.mark.parametrize(
    ('nominal', 'seed', 'speed', 'half'),
    [
        # The wall strains bonds at the last edge, so that a fit without the kick is far off.
        (LONG, 6, 10.0, 0.81),
        # The wall is at rotor 6 when the kick acts, as if its encoder were nonlinear.
        (replace(WOBBLER, number_of_rotors=12), 2, 4.0, 2.34),
    ],
)
def test_a_kick_is_more_likely_than_an_encoder_error_that_imitates_it(nominal, seed, speed, half):
    known = {'nominal': nominal, 'speed': speed, 'period': 0.01, 'noise': 0.003}
    chain, readings = kicked(seed, 0.1, spans=(half, half), **known)
    found = identify(readings, Chain())
    named = found.warnings[0].partition('a kick that was not recorded acts near ')[2]
    assert float(named.partition(' s;')[0]) == pytest.approx(half, abs=NEAR)
    scale = chain.spacings.mean() / found.chain.spacings.mean()
    errors = np.log(scale * found.chain.rotor_lengths / chain.rotor_lengths)
    assert np.sqrt(np.mean((errors / found.deviations['rotor_length']) ** 2)) < 2.0


def test_a_pull_that_unequal_masses_imitate_is_named_as_a_kick():
    chain, readings = kicked(2, *[0.06] * 4, nominal=WOBBLING, speed=4.0, period=1 / 60)
    found = identify(readings, Chain())
    assert found.warnings[0].startswith('a kick that was not recorded acts near 1.')
    errors = np.log(found.chain.masses / found.chain.masses.mean())
    errors -= np.log(chain.masses / chain.masses.mean())
    assert np.sqrt(np.mean((errors / found.deviations['mass']) ** 2)) < 2.0


@pytest.mark.parametrize(
    ('seed', 'size', 'bar_noise', 'accepted'),
    [(0, 0.3, 0.0106, True), (0, 0.3, 0.0104, False), (2, 0.0, 0.02, False)],
)
def test_springs_with_a_kick_must_fit_better_than_bars(seed, size, bar_noise, accepted):
    readings = kicked(seed, size)[1]
    fit: Any = SimpleNamespace(noise=0.01, residuals=np.zeros(readings.angles.shape), windows=())
    fitter: Any = SimpleNamespace(rate_changes=list, decreases_at_boundaries=list)

    def fit_springs(part: Readings, windows: Any) -> Any:
        return (fitter, fit) if part.impulses else 'springs do not fit'

    fitted, kicks = fit_around_kicks(readings, fit_springs, 0.01, bar_noise)
    assert kicks == (pytest.approx([BEFORE], abs=NEAR) if accepted else [])
    assert isinstance(fitted, str) != accepted


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_no_kick_is_named_in_a_free_motion(seed):
    found = identify(kicked(seed, 0.0)[1], Chain())
    assert not found.rigid
    assert not [each for each in found.warnings if 'kick' in each]


def test_exact_readings_of_several_passages_give_true_deviations_and_no_kick():
    chain = replace(FLIPPER, number_of_rotors=12)
    start = leaning(chain, -1).angles
    motion = simulate(chain, start, 10.0 * edge_mode(chain, start, Edge.FIRST), 8.0, 0.004)
    found = identify(Readings(motion.times, motion.angles), Chain())
    assert not found.warnings
    true, shown = (each.rotor_lengths / each.spacings.mean() for each in (chain, found.chain))
    assert np.all(np.abs(np.log(shown / true)) < 3 * found.deviations['rotor_length'])


def test_the_largest_step_of_the_speed_is_the_kick_unless_the_kick_is_known():
    readings = kicked(0, 0.3)[1]
    time, step = next(largest_steps(readings, 0.01))
    assert time == pytest.approx(BEFORE, abs=NEAR)
    assert step == pytest.approx(0.3, abs=0.08)
    known = replace(readings, impulses=[RecordedImpulse(BEFORE)])
    time, _ = next(largest_steps(known, 0.01))
    assert abs(time - BEFORE) > NEAR
    assert next(largest_steps(readings.select(np.arange(10)), 0.01))[1] == 0.0
