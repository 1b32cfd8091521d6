# SPDX-License-Identifier: Apache-2.0
"""Outcomes of collisions between a kink and an anti-kink, and their invariants."""

from dataclasses import replace

import numpy as np
import pytest
from meeting_walls import NARROW, SINE_GORDON, meeting, phi4_speed_after, ring_of
from scipy.integrate import solve_ivp

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.initial_states import State
from soliton_linkage.dynamics.integrators import SymplecticNystrom
from soliton_linkage.linear.bands import gap
from soliton_linkage.linkage.chain import Array, Chain, staggered
from soliton_linkage.solitons.continuum import SpinnerTheory
from soliton_linkage_studies.collisions.runs import (
    WallPaths,
    find_walls,
    initial_state,
    ring_order_field,
    simulate_frames,
)


def mirrored(state: State) -> State:
    """Return the mirrored state theta_n -> -theta_(N-1-n), which maps kinks to kinks."""
    signs = (-1.0) ** np.arange(len(state.rates))
    turned = signs * state.rates
    return State(staggered(-staggered(state.angles)[::-1]), signs * -turned[::-1])


def after(chain: Chain, state: State, duration: float) -> State:
    motion = EquationOfMotion(chain)
    start = motion.state(state.angles, state.rates)
    method = SymplecticNystrom
    moved = solve_ivp(motion, (0, duration), start, method=method, atol=1e-9, rtol=0).y[:, -1]
    return State(*np.split(moved, 2))


def test_walls_start_with_the_specified_position_and_speed():
    task = meeting(NARROW, 0.3)
    run = task()
    assert run.speed_before == pytest.approx(0.3, rel=1e-3)
    path = find_walls(task.ring, np.zeros(1), initial_state(task).angles[None])
    assert path.distances[0] / task.reach == pytest.approx(12, abs=0.1)


def test_collisions_are_mirror_symmetric():
    task = meeting(NARROW, 0.3)
    begin, duration = initial_state(task), 60 * task.unit
    straight = mirrored(after(task.ring, begin, duration))
    reflected = after(task.ring, mirrored(begin), duration)
    assert np.abs(straight.angles - begin.angles).max() > 0.1
    assert reflected.angles == pytest.approx(straight.angles, abs=1e-6)
    assert reflected.rates == pytest.approx(straight.rates, abs=1e-6)


def test_slow_flippers_are_captured_and_fast_ones_separate():
    slow, fast = (meeting(NARROW, speed)() for speed in (0.18, 0.4))
    assert not slow.escaped
    assert slow.collisions > 3
    assert slow.speed_after == 0
    assert fast.escaped
    assert fast.collisions == 1
    assert 0.25 < fast.speed_after < 0.4
    assert fast.radiated < slow.radiated < 0.2
    assert max(slow.drift, fast.drift) < 1e-8


def test_a_bounce_window_does_not_depend_on_the_integrator():
    task = meeting(NARROW, 0.16)
    runs = [replace(task, integrator=name)() for name in ('symplectic', 'DOP853')]
    for run in runs:
        assert (run.escaped, run.collisions) == (True, 2)
        assert run.drift < 1e-6
    assert runs[0].speed_after == pytest.approx(runs[1].speed_after, abs=2e-4)


def test_small_d_agrees_with_phi4_theory():
    theory = phi4_speed_after(0.3)
    off = [meeting((0.5, angle), 0.3)().speed_after - theory for angle in (0.1, 0.2)]
    assert abs(off[0]) < 0.02
    assert 3 < off[1] / off[0] < 5


def test_spinners_pass_or_repel_each_other_without_energy_loss():
    back, onwards = (meeting(SINE_GORDON, 0.5, turning)() for turning in (False, True))
    assert (back.collisions, back.turns) == (1, -1)
    assert (onwards.collisions, onwards.turns) == (0, 0)
    assert onwards.closest > 0.5
    for run in (back, onwards):
        assert run.speed_after == pytest.approx(run.speed_before, rel=3e-3)
        assert run.radiated < 1e-3


@pytest.mark.parametrize('onwards', [False, True])
def test_the_shift_of_spinners_agrees_with_sine_gordon_theory(onwards):
    """Lines along the walls before and after meet at a distance of 2 w ln(c / v) / gamma."""
    speed = 0.3
    task = meeting(SINE_GORDON, speed, onwards)
    ends = 24 / speed * task.unit
    path = WallPaths(*np.empty((3, 0)))
    for times, angles, _ in simulate_frames(task):
        path = path.joined(find_walls(task.ring, times, angles))
        if times[-1] > ends:
            break
    far = path.distances > 5 * task.reach
    closest = int(np.nanargmin(np.nan_to_num(path.distances)))
    lines = [
        np.polyfit(path.times[part][far[part]], path.distances[part][far[part]], 1)
        for part in (slice(closest), slice(closest, None))
    ]
    meeting_time = np.roots(lines[0] - lines[1])[0]
    expected = 2 * np.log(1 / speed) * np.sqrt(1 - speed**2)
    width = task.ring.wall_width / task.ring.spacing
    assert np.polyval(lines[0], meeting_time) / width == pytest.approx(expected, rel=0.04)


def test_rotors_of_a_narrow_flipper_turn_over_and_its_anti_kink_breaks():
    run = meeting((0.5, 0.97), 0.2)()
    assert run.broken
    assert run.escaped


@pytest.mark.parametrize(
    ('example', 'least', 'most'), [((2.0, 1.18), 0.0, 0.1), (SINE_GORDON, 0.999, 1.001)]
)
def test_only_spinners_with_long_rotors_have_an_anti_kink(example, least, most):
    ring = ring_of(example, 24.0)
    theory, rotors = SpinnerTheory(ring), ring.number_of_rotors
    damped = replace(ring, damping=0.2 * ring.moment_of_inertia * gap(ring))
    angles: Array = -(ring.uniform_state(1) + np.pi)
    for position, charge in ((rotors // 4 - 0.5, 1), (3 * rotors // 4 - 0.5, -1)):
        angles = angles + theory.state(position, charge=charge)[0]
    simulation = ElasticSimulation(damped, angles, None, 1.0, 1e-6, integrator='symplectic')
    simulation.record(100 / gap(ring))
    energy = float(ring.elastic_energy(simulation.angles))
    assert least <= energy / theory.energy(0.0, charge=-1) < most
    assert np.abs(ring_order_field(ring, simulation.angles)).max() < 1.01
