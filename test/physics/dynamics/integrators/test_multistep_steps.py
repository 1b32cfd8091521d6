# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from chain_motions import MOTIONS, lively_state, unit_chain
from naive_multistep import NaiveMultistep

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.multistep_coefficients import (
    AHEAD,
    DIFFERENCE,
    ERROR,
    OF_KICKS,
    OF_TURNS,
    ORDER,
    RECALLING,
    RECURSION,
    RESPONSE,
    STABLE_STEP,
    STARTING_STEPS,
    interpolating,
)
from soliton_linkage.dynamics.integrators.multistep_steps import MultistepSteps
from soliton_linkage.dynamics.integrators.nystrom_steps import NystromSteps
from soliton_linkage.dynamics.integrators.rotor_loops import LARGEST_TURN, ROTORS_IN_CACHE
from soliton_linkage.linkage.chain import Array

UNDAMPED = {name: motion for name, motion in MOTIONS.items() if not motion.damped}
ANY_ERROR = 1e9


def tolerances(motion: EquationOfMotion, absolute: float = ANY_ERROR) -> tuple[Array, float]:
    return np.full(2 * motion.rotors, absolute), 0.0


def begun(motion: EquationOfMotion, step: float) -> tuple[MultistepSteps, Array]:
    steps = MultistepSteps(motion, 50)
    states, _ = steps.begin(lively_state(motion), step, *tolerances(motion))
    assert len(states) == STARTING_STEPS + 1
    return steps, states[-1]


def naively_begun(motion: EquationOfMotion, step: float) -> tuple[NaiveMultistep, Array]:
    steps = NaiveMultistep(motion)
    states, _ = steps.begin(lively_state(motion), step, *tolerances(motion))
    return steps, states[-1]


def exact(motion: EquationOfMotion, duration: float, finer: int = 400) -> Array:
    return NystromSteps(motion).advance(lively_state(motion), duration / finer, finer)[0][-1]


def test_the_coefficients_are_the_same_forth_and_back() -> None:
    np.testing.assert_array_equal(RECURSION, RECURSION[::-1])
    np.testing.assert_array_equal(RESPONSE, RESPONSE[::-1])


def test_polynomials_of_the_time_up_to_the_order_are_followed_exactly() -> None:
    times = np.arange(-5, 6) / 5
    for power in range(ORDER + 4):
        changes = np.diff(times**power, n=2)
        kicks = np.zeros(9)
        if power >= 2:
            kicks = power * (power - 1) * times[1:-1] ** (power - 2) / 25
        missed = (RECURSION @ changes - RESPONSE @ kicks) / RECURSION.sum()
        if power == ORDER + 2:
            # The derivative of this order is power! and a step 1/5.
            scale = np.prod(np.arange(1.0, power + 1)) / 5.0**power
            assert missed == pytest.approx(ERROR * scale, rel=1e-4)
        else:
            assert abs(missed) < 1e-13


def test_tenth_differences_see_what_the_step_misses() -> None:
    assert DIFFERENCE @ np.arange(11.0) ** 10 == pytest.approx(np.prod(np.arange(1.0, 11)))
    for power in range(10):
        assert abs(DIFFERENCE @ np.linspace(-1, 1, 11) ** power) < 1e-12


def test_it_vibrates_by_itself_with_constant_amplitude() -> None:
    turning = np.convolve(RECURSION, [1, -2, 1])
    for angle in np.linspace(0.01, STABLE_STEP, 200):
        roots = np.roots(turning + angle**2 * np.concatenate([[0], RESPONSE, [0]]))
        np.testing.assert_allclose(np.abs(roots), 1, rtol=0, atol=1e-7)
        apart = np.abs(roots[:, np.newaxis] - roots) + np.eye(10)
        assert apart.min() > 0.005
    too_long = np.roots(turning + 0.66**2 * np.concatenate([[0], RESPONSE, [0]]))
    assert np.abs(too_long).max() > 1.01


def test_what_is_remembered_is_recalled_from_turns_and_kicks() -> None:
    rng = np.random.default_rng(2)
    memory, kicks, changes = list(rng.normal(size=8)), rng.normal(size=8), []
    for kick in kicks:
        memory.append(kick - RECURSION[1:] @ memory[:-9:-1])
        changes.append(RESPONSE @ memory[:-10:-1])
    known = np.concatenate([changes, kicks])
    np.testing.assert_allclose(RECALLING @ known, memory[8:], rtol=0, atol=1e-10)


def test_polynomials_are_interpolated_exactly() -> None:
    places, instants = np.linspace(0, 1, 7), np.arange(1.0 - AHEAD, 1 + AHEAD)
    for power in range(12):
        kicks = power * (power - 1) * instants ** max(power - 2, 0)
        ends = [0.0**power, 1.0, float(power == 1), float(power)]
        known = np.concatenate([ends, kicks])
        angles, rates = (weights @ known for weights in interpolating(places))
        scale = max(1.0, np.abs(kicks).max())
        np.testing.assert_allclose(angles, places**power, rtol=0, atol=1e-14 * scale)
        slopes = power * places ** max(power - 1, 0)
        np.testing.assert_allclose(rates, slopes, rtol=0, atol=1e-14 * scale)


def test_interpolation_meets_angles_and_rates_at_both_ends_whatever_the_kicks() -> None:
    angles, rates = interpolating(np.array([0.0, 1.0]))
    both_ends = np.eye(4, 14)
    np.testing.assert_allclose(angles, both_ends[:2], rtol=0, atol=1e-14)
    np.testing.assert_allclose(rates, both_ends[2:], rtol=0, atol=1e-14)


def test_what_is_told_of_polynomials_is_exact() -> None:
    places = np.arange(-AHEAD, AHEAD + 1.0)
    for power in range(2, ORDER + 3):
        turns = np.diff(places**power)
        kicks = power * (power - 1) * places ** (power - 2)
        told = OF_TURNS @ turns + OF_KICKS @ kicks
        np.testing.assert_allclose(told, 0, rtol=0, atol=1e-13 * np.abs(kicks).max())
    assert (OF_TURNS @ np.ones(2 * AHEAD))[1] == pytest.approx(1, abs=1e-15)


def test_what_the_method_vibrates_by_itself_is_not_told() -> None:
    places = np.arange(-AHEAD, AHEAD + 1.0)
    for root in np.roots(RECURSION):
        waves = root**places
        angle, rate = OF_TURNS @ np.diff(waves)
        assert abs(1 + angle) < 1e-12
        assert abs(rate) < 1e-12


@pytest.mark.parametrize('name', UNDAMPED)
def test_the_loops_take_the_steps_of_the_equations(name: str) -> None:
    motion = UNDAMPED[name]
    for step in (0.15, -0.15):
        (fast, _), (plain, _) = begun(motion, step), naively_begun(motion, step)
        for count in (1, 7, 50):
            given = tolerances(motion, 1e-3)[0], 1e-3
            state, done, error = fast.advance(count, *given)
            expected, plain_done, plain_error = plain.advance(count, *given)
            assert done == plain_done == count
            assert error == pytest.approx(plain_error, rel=1e-4, abs=1e-9)
            np.testing.assert_allclose(state, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize('beyond', [-8, -1, 0, 1, 700])
def test_chains_that_are_taken_in_blocks_take_the_same_steps(beyond: int) -> None:
    motion = EquationOfMotion(unit_chain(2 * ROTORS_IN_CACHE + beyond))
    (fast, _), (plain, _) = begun(motion, 0.15), naively_begun(motion, 0.15)
    state, done, error = fast.advance(40, *tolerances(motion))
    expected, _, plain_error = plain.advance(40, *tolerances(motion))
    assert done == 40
    assert error == pytest.approx(plain_error, rel=1e-4)
    np.testing.assert_allclose(state, expected, rtol=0, atol=1e-11)


def test_the_loops_interpolate_as_the_equations_have_it() -> None:
    motion = UNDAMPED['deviating']
    places = np.array([0.0, 0.3, 1.0, 11.5, 20.0, 3.2])
    (fast, start), (plain, plain_start) = begun(motion, 0.15), naively_begun(motion, 0.15)
    state, _, _ = fast.advance(20, *tolerances(motion))
    plain.advance(20, *tolerances(motion))
    states = fast.recorded(start, 20).interpolated(places)
    np.testing.assert_allclose(states[[0, 4]], [start, state], rtol=0, atol=2e-14)
    expected = plain.interpolated(plain_start, 20, places)
    np.testing.assert_allclose(states, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize('name', UNDAMPED)
def test_a_step_is_of_order_ten(name: str) -> None:
    motion = UNDAMPED[name]
    counts, errors = np.array([30, 40, 50]), []
    for count in counts:
        steps, _ = begun(motion, 4.0 / count)
        state, _, _ = steps.advance(int(count) - STARTING_STEPS, *tolerances(motion))
        errors.append(np.linalg.norm(state - exact(motion, 4.0)))
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert -13 < slope < -8.5


def test_it_goes_back_to_where_the_error_was_small() -> None:
    pushed = EquationOfMotion(UNDAMPED['flipper'].chain, 0.05 * np.eye(11)[5])
    start = lively_state(pushed, speed=0.0)

    def ends(count: int, absolute: float = ANY_ERROR) -> tuple[Array, int, float]:
        steps = MultistepSteps(pushed, 100)
        steps.begin(start, 0.2, *tolerances(pushed))
        return steps.advance(count, *tolerances(pushed, absolute))

    _, _, largest = ends(60)
    kept, done, error = ends(60, 0.99 * largest * ANY_ERROR)
    assert error > 1
    assert 0 < done < 60
    expected, _, smaller = ends(done)
    assert smaller < largest
    np.testing.assert_allclose(kept, expected, rtol=0, atol=1e-13)
    assert ends(60, 1e-15)[1] == 0


def test_it_stops_before_a_rotor_turns_too_far() -> None:
    motion = UNDAMPED['flipper']
    state = lively_state(motion)
    state[motion.rotors + 2] = 1.01 * LARGEST_TURN / 0.3
    steps = MultistepSteps(motion, 20)
    assert len(steps.begin(state, 0.3, *tolerances(motion))[0]) == 1
    assert len(steps.begin(state, 0.1, *tolerances(motion))[0]) == STARTING_STEPS + 1


def test_a_turn_that_grows_too_far_ends_the_steps() -> None:
    motion = UNDAMPED['gravity and torques']
    state = lively_state(motion, speed=0.0)
    pushed = EquationOfMotion(motion.chain, 0.2 * np.eye(motion.rotors)[5])
    steps = MultistepSteps(pushed, 200)
    steps.begin(state, 0.2, *tolerances(motion))
    last, done, error = steps.advance(200, *tolerances(motion))
    assert 0 < done < 200
    assert error <= 1
    assert 0.2 * np.abs(last[motion.rotors :]).max() > 0.7 * LARGEST_TURN


def test_the_loops_stop_as_the_equations_do_before_a_turn_too_far() -> None:
    motion, found = UNDAMPED['flipper'], []
    state = lively_state(motion, speed=0.0)
    state[5] += 2.0
    for steps in (MultistepSteps(motion, 200), NaiveMultistep(motion)):
        steps.begin(state, 0.25, *tolerances(motion))
        found.append(steps.advance(200, *tolerances(motion)))
    (fast, done, _), (plain, plain_done, _) = found
    assert 32 < done == plain_done < 200
    np.testing.assert_allclose(fast, plain, rtol=0, atol=1e-8)


def test_a_fixed_rotor_does_not_move() -> None:
    motion = UNDAMPED['fixed']
    steps, start = begun(motion, 0.2)
    state, _, _ = steps.advance(50, *tolerances(motion))
    for rotor in motion.fixed:
        assert state[rotor] == start[rotor]
        assert state[motion.rotors + rotor] == 0


def test_damping_is_refused() -> None:
    with pytest.raises(ValueError, match='take SymplecticNystrom'):
        MultistepSteps(MOTIONS['damped'], 10)
