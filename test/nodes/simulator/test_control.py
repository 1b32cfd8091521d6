# SPDX-License-Identifier: Apache-2.0
"""Commands act between frames, each whole; pause, step and reset lose and add nothing."""

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
import pytest

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import State, leaning
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity
from soliton_linkage_nodes.simulator.control import SimulationControl

CHAIN = Chain(number_of_rotors=6)
RATE = 100.0
TIMEOUT = 0.05
KICK = np.linspace(1e-4, 2e-4, 6)
TORQUES = np.linspace(-1e-3, 1e-3, 6)
LEFT, RIGHT = leaning(CHAIN, -1), leaning(CHAIN, 1)
TILTED = Gravity(9.81, 0.3)


def begin_springs(state: State, gravity: Gravity = NO_GRAVITY) -> Simulation:
    return ElasticSimulation(CHAIN, state.angles, state.rates, 1 / RATE, 1e-11, gravity)


def begin_bars(state: State, gravity: Gravity = NO_GRAVITY) -> Simulation:
    return RigidSimulation(CHAIN, state.angles, state.rates, 1 / RATE, 1e-11, gravity)


class Published:
    """Frames that a control has published: their numbers and angles."""

    def __init__(
        self,
        timeout: float = TIMEOUT,
        begin: Callable[[State, Gravity], Simulation] = begin_springs,
        longest_trial: float = 1.0,
    ) -> None:
        self.numbers: list[int] = []
        self.angles: list[Array] = []
        self.told: dict[int, Array] = {}
        self.control = SimulationControl(
            begin, LEFT, NO_GRAVITY, timeout, self._publish, self._tell, longest_trial
        )

    def tick(self, times: int) -> None:
        for _ in range(times):
            self.control.tick()

    def _publish(self, number: int, simulation: Simulation) -> None:
        self.numbers.append(number)
        self.angles.append(simulation.angles.copy())

    def _tell(self, number: int, impulses: Array) -> None:
        assert number == len(self.numbers), 'kicks are announced before their frame'
        self.told[number] = impulses


def assert_follow(
    frames: Sequence[Array],
    simulation: Simulation | None = None,
    acts: Mapping[int, Callable[[Simulation], object]] = MappingProxyType({}),
) -> None:
    """Compare angles with a simulation on which acts are done at the instants of some frames."""
    simulation = simulation or begin_springs(LEFT)
    for number, angles in enumerate(frames):
        np.testing.assert_array_equal(angles, simulation.angles)
        if number in acts:
            acts[number](simulation)
        simulation.advance()


def test_the_sum_of_kicks_is_announced_before_their_frame():
    published = Published()
    published.tick(3)
    published.control.kick(KICK)
    published.control.kick(2 * KICK)
    published.tick(2)
    assert published.told.keys() == {3}
    np.testing.assert_array_equal(published.told[3], 3 * KICK)


def test_without_a_timeout_torques_are_held_for_ever():
    published = Published(timeout=0.0)
    published.control.hold(TORQUES)
    published.tick(200)
    assert_follow(published.angles, acts={0: lambda twin: twin.hold(TORQUES)})


def test_kicks_beyond_the_queue_are_rejected():
    published = Published()
    published.control.pause(True)
    assert {published.control.kick(0 * KICK) for _ in range(10_000)} == {None}
    assert '10000 kicks already wait for the next frame' in str(published.control.kick(KICK))
    published.control.step(1)
    assert published.control.kick(KICK) is None


@pytest.mark.parametrize('begin', [begin_springs, begin_bars])
def test_gravity_turns_at_the_instant_of_the_next_frame_and_stays_after_a_reset(begin):
    published = Published(begin=begin)
    published.tick(2)
    published.control.set_gravity(Gravity(9.81, -0.3))
    published.control.set_gravity(TILTED)
    published.tick(3)
    turned = {2: lambda twin: twin.set_gravity(TILTED)}
    assert_follow(published.angles, begin(LEFT, NO_GRAVITY), turned)
    published.control.reset(RIGHT)
    published.tick(3)
    assert_follow(published.angles[5:], begin(RIGHT, TILTED))


def test_a_pulse_continues_after_a_pause_without_loss():
    paused, through = Published(), Published()
    for published in (paused, through):
        published.control.hold(TORQUES)
        published.tick(2)
    paused.control.pause(True)
    paused.tick(50)
    paused.control.pause(False)
    for published in (paused, through):
        published.tick(20)
    assert paused.numbers == through.numbers
    np.testing.assert_array_equal(paused.angles, through.angles)


def test_a_reset_that_the_mechanics_do_not_allow_changes_nothing():
    published = Published(begin=begin_bars)
    published.tick(2)
    published.control.kick(KICK)
    with pytest.raises(ValueError, match='longer than its'):
        published.control.reset(State(np.zeros(6), np.zeros(6)))
    published.tick(2)
    assert_follow(published.angles, begin_bars(LEFT), {2: lambda twin: twin.kick(KICK)})


def test_the_state_is_that_of_the_frame_published_next():
    published = Published()
    published.control.kick(KICK)
    published.tick(3)
    state = published.control.state
    published.tick(1)
    np.testing.assert_array_equal(state.angles, published.angles[-1])
    assert state.rates.any()


def test_the_status_has_the_energy_that_a_kick_gave_and_the_damping_took():
    chain = dataclasses.replace(CHAIN, damping=1e-4)

    def begin_damped(state: State, gravity: Gravity) -> Simulation:
        return ElasticSimulation(chain, state.angles, state.rates, 1 / RATE, 1e-11, gravity)

    published = Published(begin=begin_damped)
    published.control.kick(KICK)
    published.tick(30)
    status = published.control.status
    given = 0.5 * float(np.sum(KICK**2)) / CHAIN.moment_of_inertia
    assert status.frames == 30
    assert status.dissipated > 0.1 * given
    assert math.isfinite(status.energy_drift)
    assert abs(status.energy_drift) < 1e-8
    assert status.energy + status.dissipated == pytest.approx(given, rel=1e-8)


@pytest.fixture
def endless(monkeypatch):
    """Block the computation of frames, and signal its start."""
    begun = threading.Event()

    def step(simulation: ElasticSimulation) -> None:
        begun.set()
        time.sleep(1e-4)

    monkeypatch.setattr(ElasticSimulation, 'step', step)
    return begun


def end(published: Published, tick: threading.Thread) -> None:
    published.control.stop()
    tick.join(120)
    assert not tick.is_alive()


def begin(published: Published, begun: threading.Event) -> threading.Thread:
    tick = threading.Thread(target=published.control.tick)
    tick.start()
    assert begun.wait(120)
    return tick


def test_calls_are_answered_while_a_frame_is_computed(endless):
    published = Published()
    tick = begin(published, endless)
    published.control.kick(KICK)
    published.control.hold(TORQUES)
    assert published.control.pause(True) is None
    status = published.control.status
    assert (status.frames, status.pending, status.paused) == (1, 2, True)
    assert tick.is_alive()
    end(published, tick)


def test_a_reset_gives_up_the_frame_that_is_computed(endless, monkeypatch):
    published = Published(longest_trial=0.05)
    tick = begin(published, endless)
    published.control.reset(RIGHT)
    tick.join(120)
    assert not tick.is_alive()
    monkeypatch.undo()
    published.tick(3)
    assert published.numbers == [0, 1, 2, 3]
    assert_follow(published.angles[1:], begin_springs(RIGHT))


def test_the_end_gives_up_the_frame_that_is_computed_and_publishes_no_other(endless):
    published = Published()
    end(published, begin(published, endless))
    published.tick(3)
    assert published.numbers == [0]


def test_a_state_from_which_no_frame_can_be_computed_is_rejected():
    control = SimulationControl(
        lambda state, _: ElasticSimulation(
            CHAIN, state.angles, state.rates, 0.002, integrator='DOP853'
        ),
        State(CHAIN.uniform_state(-1), np.zeros(CHAIN.number_of_rotors)),
        NO_GRAVITY,
        0.0,
        lambda *_: None,
        longest_trial=60.0,
    )
    assert control.tick()
    before, rates = control.simulation, np.zeros(CHAIN.number_of_rotors)
    rates[3] = 1e6
    with pytest.raises(ValueError, match='more than 1100 steps; apply smaller impulses'):
        control.reset(State(CHAIN.uniform_state(-1), rates))
    assert control.simulation is before
    assert control.tick()


def test_a_failure_of_the_simulation_pauses_it_with_the_reason():
    class Broken(ElasticSimulation):
        def step(self) -> None:
            raise TypeError('no such step')

    control = SimulationControl(
        lambda state, _: Broken(CHAIN, state.angles),
        State(CHAIN.uniform_state(-1), np.zeros(CHAIN.number_of_rotors)),
        NO_GRAVITY,
        0.0,
        lambda *_: None,
    )
    control.tick()
    assert control.status.paused
    assert 'TypeError: no such step' in str(control.status.failure)
