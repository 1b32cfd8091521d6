# SPDX-License-Identifier: Apache-2.0
"""The soliton goes where it is sent, and each thing that can go wrong has its own answer."""

import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from graphs import Graph, values
from joint_frames import frame_of
from rclpy.action import ActionClient
from std_srvs.srv import SetBool, Trigger

from soliton_linkage.estimation.relocalisation import fit_anywhere
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import Deviations, Disorder
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.guarded import ACTION_QOS
from soliton_linkage_nodes.runtime.stamps import time_to_msg
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_steering.node import (
    SolitonSteering,
    SolitonSteeringParameters,
    SteeredChain,
)

ROTORS = 8
CHAIN = Chain(number_of_rotors=ROTORS)
EVEN = Disorder()
UNEVEN = Disorder(spacing=0.05, rotor_length=0.05, rest_length=0.02, mass=0.05, seed=1)
Result = MoveSoliton.Result


class Bench:
    """A simulated chain with a steering, and a user who sends goals."""

    def __init__(
        self, graph: Graph, parameters: dict[str, Any] | None = None, disorder: Disorder = EVEN
    ) -> None:
        self.graph = graph
        self.orbit = orbit_of(replace(CHAIN, deviations=disorder.drawn(ROTORS)))
        self.reports = graph.reports('soliton_steering')
        self.frames = graph.hear(interfaces.JOINT_STATES)
        self.torques = graph.hear(interfaces.ROTOR_TORQUES)
        self.feedback: list[MoveSoliton.Feedback] = []
        self.simulator = graph.start(
            Simulator,
            {
                'chain.number_of_rotors': ROTORS,
                **{f'chain.disorder.{key}': value for key, value in asdict(disorder).items()},
                'publish_rate': 125.0,
                'real_time_factor': 0.25,
                'tolerance': 1e-8,
            },
        )
        self.node = graph.start(SolitonSteering, {'state_timeout': 60.0, **(parameters or {})})
        self._client = ActionClient(graph.user, MoveSoliton, interfaces.MOVE_SOLITON)
        graph.until(self._client.server_is_ready, 'the action server')
        graph.until(lambda: self.message == 'ready', 'a steering that sees the wall')
        self.after(20)

    @property
    def message(self) -> str:
        return str(self.reports[-1].message) if self.reports else ''

    @property
    def place(self) -> float:
        """Where the wall is by the last frame [rotor spacings]."""
        angles = np.array(self.frames[-1].position)
        return self.orbit.site(fit_anywhere(self.orbit, angles).arc)

    def send(self, rotor: float, speed: float = 0.0) -> Any:
        goal = MoveSoliton.Goal(rotor=rotor, speed=speed)
        sent = self._client.send_goal_async(
            goal, feedback_callback=lambda message: self.feedback.append(message.feedback)
        )
        self.graph.until(sent.done, 'an answer to the goal')
        assert sent.result().accepted
        return sent.result()

    def result(self, handle: Any) -> Any:
        future = handle.get_result_async()
        self.graph.until(future.done, 'the result')
        return future.result()

    def move(self, rotor: float, speed: float = 0.0) -> Any:
        return self.result(self.send(rotor, speed))

    def after(self, frames: int) -> None:
        target = len(self.frames) + frames
        self.graph.until(lambda: len(self.frames) >= target, f'{frames} frames')


def test_the_wall_is_drawn_out_of_its_edge_to_a_place_and_held_there(graph):
    bench = Bench(graph)
    ended = bench.move(4.3)
    assert (ended.status, ended.result.outcome) == (GoalStatus.STATUS_SUCCEEDED, Result.REACHED)
    assert ended.result.rotor == pytest.approx(4.3, abs=0.05)
    for _ in range(5):
        bench.after(20)
        assert bench.place == pytest.approx(4.3, abs=0.1)
    rotors = [each.rotor for each in bench.feedback]
    assert len(rotors) > 5
    assert max(rotors) < 4.4
    assert max(each.speed for each in bench.feedback) > 1
    assert all(each.phonon_energy >= 0 for each in bench.feedback)
    assert bench.feedback[-1].phonon_energy < 1e-7


def test_a_goal_replaces_the_current_one_and_a_node_that_ends_releases_the_wall(graph):
    bench = Bench(graph, disorder=UNEVEN)
    first = bench.send(6.0)
    graph.until(lambda: len(bench.feedback) > 3, 'feedback')
    second = bench.send(2.0)
    ended = bench.result(first)
    assert (ended.status, ended.result.outcome) == (GoalStatus.STATUS_ABORTED, Result.PREEMPTED)
    assert 'another goal, rotor 2, replaced this one' in ended.result.message
    assert bench.result(second).result.outcome == Result.REACHED
    # On the orbit of the chain with its deviations.
    assert bench.place == pytest.approx(2.0, abs=0.05)
    bench.send(6.0)
    graph.until(lambda: bench.message.startswith('moving'), 'a third move')
    graph.stop(bench.node)
    graph.until(lambda: not any(bench.torques[-1].effort), 'torques of 0')


def test_cancel_holds_the_soliton_and_release_frees_it(graph):
    bench = Bench(graph)
    handle = bench.send(6.0)
    graph.until(lambda: bench.feedback and bench.feedback[-1].rotor > 1, 'a wall on its way')
    cancelled = handle.cancel_goal_async()
    graph.until(cancelled.done, 'an answer to the cancellation')
    ended = bench.result(handle)
    assert (ended.status, ended.result.outcome) == (GoalStatus.STATUS_CANCELED, Result.CANCELLED)
    stopped = ended.result.rotor
    assert 1 < stopped < 6
    bench.after(100)
    assert bench.place == pytest.approx(stopped, abs=0.1)
    graph.until(lambda: bench.message.startswith('holding the soliton'), 'a steering that holds')
    assert graph.call(Trigger, 'soliton_steering/release').success
    graph.until(lambda: bench.torques and not any(bench.torques[-1].effort), 'torques of 0')
    count = len(bench.torques)
    bench.after(50)
    assert len(bench.torques) == count
    assert not graph.call(Trigger, 'soliton_steering/release').success


def test_impossible_goals_are_rejected_and_edge_actuators_move_the_wall_within_their_reach(graph):
    bench = Bench(graph, {'actuated_joints': ['rotor_0', 'rotor_1']})
    for rotor, speed, outcome, reason in (
        (7.5, 0.0, Result.OUT_OF_CHAIN, 'range 0 to 7'),
        (math.nan, 0.0, Result.OUT_OF_CHAIN, 'rotor = nan'),
        (4.0, -2.0, Result.INVALID_SPEED, 'speed = -2'),
        (6.0, 0.0, Result.OUT_OF_REACH, 'actuate more rotors'),
    ):
        ended = bench.move(rotor, speed)
        assert (ended.status, ended.result.outcome) == (GoalStatus.STATUS_ABORTED, outcome)
        assert reason in ended.result.message
        graph.until(
            lambda said=reason: said in values(bench.reports[-1])['last rejection'],
            'a report of the refusal',
        )
    assert bench.torques == []
    assert bench.move(1.0).result.outcome == Result.REACHED
    assert bench.place == pytest.approx(1.0, abs=0.1)
    assert any(any(each.effort[:2]) for each in bench.torques)
    assert not any(any(each.effort[2:]) for each in bench.torques)


def test_a_wall_is_lost_when_the_joint_states_stop_or_jump(graph):
    bench = Bench(graph, {'state_timeout': 10.0})
    handle = bench.send(6.0)
    graph.until(lambda: len(bench.feedback) > 3, 'feedback')
    assert graph.call(SetBool, 'simulator/pause', data=True).success
    ended = bench.result(handle)
    lost = GoalStatus.STATUS_ABORTED, Result.SOLITON_LOST
    assert (ended.status, ended.result.outcome) == lost
    assert 'joint_states have stopped' in ended.result.message
    graph.until(lambda: not any(bench.torques[-1].effort), 'torques of 0')
    none = bench.move(6.0).result
    assert none.outcome == Result.NO_SOLITON
    assert 'no fresh joint_states' in none.message
    assert graph.call(SetBool, 'simulator/pause', data=False).success
    graph.until(lambda: bench.message == 'ready', 'a steering that sees the wall again')
    bench.feedback.clear()
    handle = bench.send(5.0)
    graph.until(lambda: bench.feedback and bench.feedback[-1].rotor > 2, 'a wall on its way')
    state = Reset.Request.RIGHT_LEANING
    assert graph.call(Reset, 'simulator/reset', state=state).success
    ended = bench.result(handle)
    assert ended.result.outcome == Result.SOLITON_LOST
    assert 'is released' in ended.result.message
    bench.after(10)
    assert bench.move(4.0).result.outcome == Result.REACHED


def test_without_a_chain_or_a_wall_there_is_nothing_to_move(graph):
    client = ActionClient(graph.user, MoveSoliton, interfaces.MOVE_SOLITON)
    node = graph.start(SolitonSteering, {'state_timeout': 60.0})

    def move() -> Any:
        graph.until(client.server_is_ready, 'the action server')
        sent = client.send_goal_async(MoveSoliton.Goal(rotor=3.0))
        graph.until(sent.done, 'an answer')
        future = sent.result().get_result_async()
        graph.until(future.done, 'the result')
        return future.result().result

    assert move().outcome == Result.NO_SOLITON
    named = NamedChain(CHAIN, default_joint_names(ROTORS))
    graph.hear(interfaces.ROTOR_TORQUES)
    chain = graph.speak(interfaces.CHAIN)
    joints = graph.speak(interfaces.JOINT_STATES)
    chain.publish(chain_to_msg(named, time_to_msg(0)))
    graph.until(lambda: node.chain is not None, 'the chain')
    graph.until(node.torques.get_subscription_count, 'a subscriber of the torques')
    angles = np.full(ROTORS, 2.0)
    joints.publish(frame_of(named, angles, 1))
    graph.until(lambda: not math.isinf(node.freshness.age), 'joint states')
    none = move()
    assert none.outcome == Result.NO_SOLITON
    assert 'fit no zero-energy configuration' in none.message
    assert math.isnan(none.rotor)


def test_an_unknown_joint_is_rejected(graph):
    reports = graph.reports('soliton_steering')
    graph.start(Simulator, {'chain.number_of_rotors': ROTORS})
    graph.start(SolitonSteering, {'actuated_joints': ['rotor_9']})
    graph.until(
        lambda: reports and "'rotor_9'" in values(reports[-1])['last rejection'], 'the refusal'
    )


def test_deviations_that_block_the_way_are_ignored_and_reported():
    shortened = (*7 * (0.0,), -0.5, *4 * (0.0,))
    chain = Chain(12, rotor_length=0.2, rest_angle=1.18)
    blocked = replace(chain, deviations=Deviations(rotor_length=shortened))
    for each, left_out in ((chain, False), (blocked, True)):
        steered = SteeredChain(
            NamedChain(each, default_joint_names(12)), SolitonSteeringParameters()
        )
        assert steered.steering.orbit.chain == chain
        assert ('cannot pass' in steered.limitation) is left_out


def test_two_hundred_goals_at_once_are_all_ended(graph):
    graph.start(SolitonSteering)
    client = ActionClient(graph.user, MoveSoliton, interfaces.MOVE_SOLITON, **ACTION_QOS)
    graph.until(client.server_is_ready, 'the action server')
    sent = [client.send_goal_async(MoveSoliton.Goal(rotor=1.0)) for _ in range(200)]
    graph.until(lambda: all(each.done() for each in sent), 'answers to the goals')
    ended = [each.result().get_result_async() for each in sent]
    graph.until(lambda: all(each.done() for each in ended), 'the results')
    assert {each.result().result.outcome for each in ended} == {Result.NO_SOLITON}
