# SPDX-License-Identifier: Apache-2.0
import dataclasses
import math

import numpy as np
import pytest
from chain_motions import MOTIONS, lively_state, unit_chain
from chains import FLIPPER, SPINNER, chain_of
from numba.core.dispatcher import Dispatcher
from scipy.integrate import solve_ivp

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators import SymplecticNystrom, nystrom_loops
from soliton_linkage.dynamics.integrators.symplectic_nystrom import STABLE_STEP
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array


def kicked(motion: EquationOfMotion, speed: float = 0.1) -> Array:
    angles = motion.chain.uniform_state(-1)
    return motion.state(angles, speed * edge_mode(motion.chain, angles, Edge.FIRST))


def solved(
    motion: EquationOfMotion, state: Array, times: Array | list[float], **options: object
) -> Array:
    solution = solve_ivp(
        motion, (times[0], times[-1]), state, method=SymplecticNystrom, t_eval=times, **options
    )
    assert solution.success
    return np.asarray(solution.y)


def energy(motion: EquationOfMotion, states: Array) -> Array:
    number, chain = motion.rotors, motion.chain
    angles, rates = states[:number].T, states[number : 2 * number].T
    total = chain.elastic_energy(angles) + chain.kinetic_energy(rates)
    total += motion.gravity.energy(chain, angles)
    return total + states[2 * number :].sum(axis=0)


def test_its_smallest_error_is_that_of_rounding():
    motion = EquationOfMotion(unit_chain(3))
    state = kicked(motion, 0.3)
    found = solved(motion, state, [0, 1], rtol=0, atol=1e-15)
    exact = solve_ivp(motion, (0, 1), state, method='DOP853', rtol=1e-13, atol=1e-16).y
    np.testing.assert_allclose(found[:, -1], exact[:, -1], rtol=0, atol=2e-14)


def test_the_error_is_below_the_sum_of_those_tolerated():
    motion = EquationOfMotion(unit_chain(12, SPINNER))
    state = kicked(motion, 0.3)
    fixed = {'first_step': 0.02, 'max_step': 0.02, 'atol': 1.0}
    exact = solved(motion, state, [0, 50], **fixed)[:, -1]
    tolerances, errors = 10.0 ** -np.arange(6, 13), []
    for tolerance in tolerances:
        solver = SymplecticNystrom(motion, 0.0, state, 50.0, rtol=0, atol=tolerance, together=1)
        steps = 0
        while solver.status == 'running':
            solver.step()
            steps += 1
        errors.append(np.abs(solver.y - exact).max())
        assert errors[-1] < steps * tolerance * math.sqrt(len(state))
    slope = np.polyfit(np.log(tolerances[2:]), np.log(errors[2:]), 1)[0]
    assert 6 / 7 - 0.15 < slope < 1.1


def test_the_way_back_leads_to_the_start():
    motion = EquationOfMotion(unit_chain(15))
    state = kicked(motion)
    forth = solved(motion, state, [0, 100], first_step=1.0, max_step=1.0, atol=1.0)
    back = solved(motion, forth[:, -1], [100, 0], first_step=1.0, max_step=1.0, atol=1.0)
    assert np.abs(forth[:, -1] - state).max() > 1
    np.testing.assert_allclose(back[:, -1], state, rtol=0, atol=1e-11)


def test_the_energy_does_not_drift():
    motion = EquationOfMotion(unit_chain(10))
    state, times = kicked(motion), np.linspace(0, 40_000, 4001)
    states = solved(motion, state, times, first_step=1.0, max_step=1.0, atol=1.0)
    errors = energy(motion, states) / energy(motion, state[:, np.newaxis]) - 1
    early, late = np.abs(errors[1:401]).max(), np.abs(errors[-400:]).max()
    assert 1e-10 < early < 1e-5
    assert late < 2 * early


@pytest.mark.parametrize('speed', [0.6, 1.0, 3.0])
def test_the_energy_is_kept_though_springs_become_short(speed):
    motion = EquationOfMotion(unit_chain(8, FLIPPER))
    rates = speed * np.random.default_rng(3).standard_normal(8)
    state = motion.state(motion.chain.uniform_state(1), rates)
    states = solved(motion, state, np.linspace(0, 100, 1001), rtol=0, atol=1e-12)
    assert np.ptp(energy(motion, states)) < 1e-8 * energy(motion, state[:, np.newaxis])


def test_dense_output_meets_the_steps_and_is_smooth_in_between():
    for steps_before in [0, 1, 4]:
        motion = EquationOfMotion(unit_chain(8, damping=0.02))
        options = {'first_step': 0.25, 'max_step': 0.25, 'atol': 1.0, 'together': 3}
        solver = SymplecticNystrom(motion, 0.0, kicked(motion), 100.0, **options)
        for _ in range(steps_before):
            solver.step()
        start = solver.y.copy()
        solver.step()
        dense = solver.dense_output()
        np.testing.assert_allclose(dense(solver.t_old), start, rtol=0, atol=2e-15)
        np.testing.assert_allclose(dense(solver.t), solver.y, rtol=0, atol=2e-15)
        times = np.linspace(solver.t_old, solver.t, 7)
        np.testing.assert_array_equal(dense(times)[:, 3], dense(times[3]))
        width = 1e-4
        slopes = (dense(times[1:-1] + width) - dense(times[1:-1] - width)) / (2 * width)
        expected = np.array([motion(0.0, y) for y in dense(times[1:-1]).T]).T
        np.testing.assert_allclose(slopes, expected, rtol=0, atol=1e-7)


def test_steps_keep_their_length_and_end_at_the_bound():
    motion = EquationOfMotion(unit_chain(20))
    solver = SymplecticNystrom(motion, 5.0, kicked(motion), 205.3, rtol=0, atol=1e-8, together=1)
    lengths = []
    while solver.status == 'running':
        assert solver.step() is None
        lengths.append(solver.step_size)
    assert solver.t == 205.3
    assert sum(lengths) == pytest.approx(200.3, abs=1e-10)
    changes = np.abs(np.diff(lengths[:-1])) > 1e-9
    assert changes.sum() <= 3


def test_how_many_steps_go_together_makes_no_difference():
    motion = EquationOfMotion(unit_chain(20))
    state, times = kicked(motion), np.linspace(0, 30, 7)
    options = {'first_step': 0.5, 'max_step': 0.5, 'atol': 1.0}
    alone = solved(motion, state, times, together=1, **options)
    many = solved(motion, state, times, together=50, **options)
    np.testing.assert_allclose(alone, many, rtol=0, atol=1e-13)


def test_a_chain_at_rest_takes_the_longest_step():
    chain = chain_of(FLIPPER, 6)
    motion = EquationOfMotion(chain)
    state = motion.state(chain.uniform_state(1), np.zeros(6))
    solver = SymplecticNystrom(motion, 0.0, state, np.inf, together=1)
    for _ in range(100):
        solver.step()
    assert solver.step_size * motion.fastest_rate == pytest.approx(STABLE_STEP)
    np.testing.assert_allclose(solver.y, state, rtol=0, atol=1e-11)


def test_a_rotor_that_spins_fast_is_followed():
    motion = EquationOfMotion(unit_chain(3, stiffness=1e-9))
    state = motion.state(np.zeros(3), np.array([0.0, 500.0, 0.0]))
    found = solved(motion, state, [0, 1], rtol=0, atol=1e-3)
    assert found[1, -1] == pytest.approx(500, abs=1e-3)


def test_unsupported_forces_are_rejected():
    chain = unit_chain(4)
    motion, state = EquationOfMotion(chain), np.zeros(8)
    with pytest.raises(TypeError, match='choose DOP853'):
        SymplecticNystrom(lambda t, y: y, 0.0, state, 1.0)
    damped = EquationOfMotion(dataclasses.replace(chain, damping=1.0))
    with pytest.raises(ValueError, match='which needs 9'):
        SymplecticNystrom(damped, 0.0, state, 1.0)
    with pytest.raises(ValueError, match='not both be 0'):
        SymplecticNystrom(motion, 0.0, state, 1.0, rtol=0.0, atol=0.0)
    with pytest.raises(ValueError, match='must be 0 or more'):
        SymplecticNystrom(motion, 0.0, state, 1.0, rtol=-1.0)
    with pytest.raises(ValueError, match='first_step'):
        SymplecticNystrom(motion, 0.0, state, 1.0, first_step=0.0)
    with pytest.raises(ValueError, match='together'):
        SymplecticNystrom(motion, 0.0, state, 1.0, together=0)


def test_tolerances_that_no_step_meets_are_reported():
    motion = EquationOfMotion(unit_chain(10))
    solver = SymplecticNystrom(motion, 0.0, kicked(motion), 10.0, rtol=0.0, atol=1e-19)
    while solver.status == 'running':
        complaint = solver.step()
    assert solver.status == 'failed'
    assert 'no step length satisfies' in complaint


def test_loaded_loops_leave_nothing_to_compile():
    SymplecticNystrom.load()
    loops = [loop for loop in vars(nystrom_loops).values() if isinstance(loop, Dispatcher)]
    before = [len(loop.signatures) for loop in loops]
    for motion in MOTIONS.values():
        state = lively_state(motion)
        for options in (
            {'rtol': 1e-6, 'atol': 1e-6},
            {'rtol': 0, 'atol': 1, 'first_step': 1, 'max_step': 1},
        ):
            solver = SymplecticNystrom(motion, 0.0, state, 10.0, **options)
            while solver.status == 'running':
                solver.step()
                solver.dense_output()(solver.t)
    assert [len(loop.signatures) for loop in loops] == before
