# SPDX-License-Identifier: Apache-2.0
import mpmath
import numpy as np
import pytest
from chain_motions import MOTIONS, lively_state, unit_chain
from scipy.integrate import solve_ivp

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.nystrom_loops import LARGEST_TURN, Checks
from soliton_linkage.dynamics.integrators.symplectic_nystrom import (
    DRIFTS,
    KICKS,
    STABLE_STEP,
    NystromSteps,
    steps_to_measure,
)
from soliton_linkage.dynamics.terms import tension
from soliton_linkage.linkage.chain import Array


@pytest.mark.parametrize('name', MOTIONS)
def test_short_steps_and_their_interpolation_solve_the_equation(name):
    motion = MOTIONS[name]
    state, places = lively_state(motion), np.array([0.3, 0.5, 2.9, 19.5, 20.0])
    for step in (0.05, -0.05):
        states, _ = NystromSteps(motion).advance(state, step, 20)
        found = NystromSteps(motion).interpolated(states, step, places)
        exact = solve_ivp(
            motion, (0, 20 * step), state, 'DOP853', step * places, rtol=1e-13, atol=1e-14
        ).y.T
        np.testing.assert_allclose(states[-1], exact[-1], rtol=0, atol=3e-13)
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12)


def test_the_pull_of_a_spring_is_exact_up_to_rounding():
    near_one = 1 + np.linspace(-0.3, 0.3, 2001)
    squares = np.concatenate([near_one, np.geomspace(1e-12, 1e12, 2001)])
    exact = [float(1 - 1 / mpmath.sqrt(square)) for square in squares]
    errors = np.array([tension(square) for square in squares]) - exact
    # Half a unit in the last place of 1 / sqrt(w), and of the result, twice over.
    assert (
        np.abs(errors) <= 2 * np.finfo(float).eps * (1 / np.sqrt(squares) + np.abs(exact))
    ).all()
    assert np.abs(errors[:2001]).max() < 3e-16
    assert abs(tension(1.0)) < 1e-20


def test_measurements_do_not_depend_on_the_split_of_steps():
    def measured(*counts: int) -> list[int]:
        found, taken = [], 0
        for count in counts:
            found += [taken + n for n in steps_to_measure(taken, count, 32)]
            taken += count
        return found

    assert measured(100) == [1, 4, 16, 32, 64, 96]
    rng = np.random.default_rng(8)
    for _ in range(20):
        counts = rng.integers(1, 40, 12)
        assert measured(*counts) == measured(int(counts.sum()))
    assert list(steps_to_measure(2, 20, 1)) == list(range(1, 21))


def test_the_error_is_the_largest_of_the_measured_steps_which_are_taken_unchanged():
    motion = MOTIONS['all at once']
    state = lively_state(motion)
    plain, unmeasured = NystromSteps(motion).advance(state, 0.9, 6)
    errors = []
    for measured in ([2], [5], [2, 5]):
        checks = Checks(np.full(len(state), 1e-4), 1e-5, np.array(measured))
        states, error = NystromSteps(motion).advance(state, 0.9, 6, checks)
        np.testing.assert_array_equal(states, plain)
        errors.append(error)
    assert errors[2] == max(errors[:2])
    assert min(errors) > unmeasured == 0


def test_the_error_is_that_against_two_halves():
    motion = MOTIONS['damped']
    state = lively_state(motion)
    absolute = np.linspace(1e-3, 2e-3, len(state))
    taken = NystromSteps(motion)
    whole, error = taken.advance(state, 1.0, 1, Checks(absolute, 0.01, np.array([1])))
    halves, _ = taken.advance(state, 0.5, 2)
    scale = absolute + 0.01 * np.maximum(np.abs(state), np.abs(halves[-1]))
    expected = np.sqrt(np.mean(((whole[-1] - halves[-1]) / scale) ** 2))
    assert error == pytest.approx(expected, rel=1e-6)


def test_it_stops_before_a_step_that_is_too_wrong():
    motion = MOTIONS['flipper']
    state = lively_state(motion)
    checks = Checks(np.full(len(state), 1e-14), 0.0, np.array([3]))
    states, error = NystromSteps(motion).advance(state, 1.0, 8, checks)
    assert len(states) == 3
    assert error > 1


def test_it_stops_before_a_rotor_turns_too_far():
    motion = MOTIONS['flipper']
    state = lively_state(motion)
    state[motion.rotors + 2] = 1.01 * LARGEST_TURN / np.abs(DRIFTS).max()
    assert len(NystromSteps(motion).advance(state, 1.0, 3)[0]) == 1
    assert len(NystromSteps(motion).advance(state, 0.9, 1)[0]) == 2


@pytest.mark.parametrize('name', ['flipper', 'spinner', 'deviating ring', 'all at once'])
def test_the_error_is_of_order_six(name):
    motion = MOTIONS[name]
    taken = NystromSteps(motion)
    counts = np.array([12, 16, 24])
    squares = np.zeros(len(counts))
    for seed in range(2):
        state = lively_state(motion, seed, speed=0.1)
        exact = taken.advance(state, 4.0 / 72, 72)[0][-1]
        ends = [taken.advance(state, 4.0 / count, count)[0][-1] for count in counts]
        squares += [np.sum((end - exact) ** 2) for end in ends]
    slope = np.polyfit(np.log(counts), np.log(squares) / 2, 1)[0]
    assert -6.5 < slope < -5.5


def test_steps_back_undo_steps_forth():
    for name in MOTIONS:
        motion = MOTIONS[name]
        state = lively_state(motion)
        taken = NystromSteps(motion)
        forth, _ = taken.advance(state, 0.7, 20)
        back, _ = taken.advance(forth[-1], -0.7, 20)
        assert np.abs(forth[-1] - state).max() > 0.1
        np.testing.assert_allclose(back, forth[::-1], rtol=0, atol=1e-10)


def jacobian(motion: EquationOfMotion, state: Array, step: float) -> Array:
    size = 2 * motion.rotors
    taken, columns = NystromSteps(motion), []
    for place in range(size):
        shifted = []
        for shift in (2e-4, 1e-4, -1e-4, -2e-4):
            moved = state.copy()
            moved[place] += shift
            shifted.append(taken.advance(moved, step, 1)[0][-1][:size])
        columns.append((8 * (shifted[1] - shifted[2]) - (shifted[0] - shifted[3])) / 1.2e-3)
    return np.array(columns).T


@pytest.mark.parametrize('name', ['flipper', 'deviating', 'gravity and torques', 'ring'])
def test_a_step_is_symplectic_without_damping(name):
    motion = MOTIONS[name]
    number = motion.rotors
    matrix = jacobian(motion, lively_state(motion), 1.3)
    inertias = np.diag(motion.chain.moments_of_inertia)
    form = np.block([[np.zeros((number, number)), inertias], [-inertias, np.zeros_like(inertias)]])
    np.testing.assert_allclose(matrix.T @ form @ matrix, form, rtol=0, atol=1e-9)
    assert np.abs(matrix - np.eye(2 * number)).max() > 0.5


def test_damping_contracts_areas_as_in_the_motion():
    motion = EquationOfMotion(unit_chain(6, damping=0.05))
    gamma = float(motion.decay_rates[0])
    matrix = jacobian(motion, lively_state(motion), 1.1)
    inertia = motion.chain.moment_of_inertia
    form = inertia * np.block([[np.zeros((6, 6)), np.eye(6)], [-np.eye(6), np.zeros((6, 6))]])
    shrunk = np.exp(-gamma * 1.1) * form
    np.testing.assert_allclose(matrix.T @ form @ matrix, shrunk, rtol=0, atol=1e-9)


def test_a_step_is_bounded_for_vibrations_up_to_the_stable_one():
    def trace(angle: float) -> float:
        matrix = np.eye(2)
        for stage, drift in enumerate(DRIFTS):
            if stage:
                matrix = np.array([[1, 0], [-angle * KICKS[stage - 1], 1]]) @ matrix
            matrix = np.array([[1, angle * drift], [0, 1]]) @ matrix
        return float(np.trace(matrix))

    stable = np.linspace(0.01, STABLE_STEP, 3000)
    assert max(abs(trace(angle)) for angle in stable) <= 2
    assert abs(trace(np.pi)) > 2
