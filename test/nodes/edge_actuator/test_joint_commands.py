# SPDX-License-Identifier: Apache-2.0
"""ros2_control tools drive the chain without changes; invalid commands are rejected whole."""

import math
from typing import Any

import numpy as np
import pytest
from bench import Bench
from builtin_interfaces.msg import Duration
from graphs import Graph
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

JOINTS, EFFORTS = interfaces.JOINT_COMMANDS, interfaces.EFFORT_COMMANDS
TRAJECTORY = interfaces.JOINT_TRAJECTORY
PERIOD = 0.01
LONG_AGO = Header(stamp=time_to_msg(10**18))
FAR_AHEAD = Header(stamp=time_to_msg((2**31 - 1) * 10**9))


class Desk:
    """A bench whose joints are at rest, and publishers of joint commands."""

    def __init__(self, graph: Graph, named: NamedChain, parameters: dict[str, Any]) -> None:
        self.bench = Bench(graph, named, parameters)
        self.bench.tell_chain()
        self._publishers = {
            topic.name: graph.speak(topic) for topic in (JOINTS, EFFORTS, TRAJECTORY)
        }
        self.now = 0.0
        self.frames(2, 0)

    def say(self, topic: interfaces.Topic, message: Any) -> None:
        """Publish a command, and wait until it is accepted."""
        node = self.bench.node
        before = node.carried_out
        self.publish(topic, message)
        self.bench.graph.until(lambda: node.carried_out > before, 'acceptance')

    def publish(self, topic: interfaces.Topic, message: Any) -> None:
        self._publishers[topic.name].publish(message)

    def frames(self, count: int, messages: int | None = None) -> Array:
        """Publish frames, and return the torques that come of it, one of each frame [N m]."""
        expected = count if messages is None else messages
        for _ in range(count):
            self.now += PERIOD
            self.bench.joints(self.bench.named.chain.uniform_state(-1), stamp=self.now)
        return np.array([self.bench.next_torques() for _ in range(expected)])


@pytest.fixture
def desk(graph, named):
    return Desk(graph, named, {'command_timeout': 0.05})


def efforts(**by_name: float) -> JointState:
    return JointState(name=list(by_name), effort=list(by_name.values()))


def trajectory(names: list[str], *points: tuple[float, list[float]]) -> JointTrajectory:
    return JointTrajectory(
        joint_names=names,
        points=[
            JointTrajectoryPoint(
                effort=effort,
                time_from_start=Duration(sec=int(time), nanosec=round(time % 1 * 1e9)),
            )
            for time, effort in points
        ],
    )


def at(**by_rotor: float) -> Array:
    torques = np.zeros(8)
    for name, torque in by_rotor.items():
        torques[int(name[1:])] = torque
    return torques


def test_efforts_by_name_act_on_those_joints_until_the_watchdog_ends_them(desk):
    desk.say(JOINTS, efforts(rotor_5=1e-3, rotor_2=-2e-3))
    torques = desk.frames(8, messages=6)
    np.testing.assert_array_equal(torques[:5], [at(r5=1e-3, r2=-2e-3)] * 5)
    assert not torques[5].any()


def test_a_stream_as_topic_based_ros2_control_sends_it_acts_message_by_message(graph, named):
    """All joints of the hardware in every message, only effort, stamped."""
    desk = Desk(graph, named, {'command_timeout': 60.0})
    names = list(desk.bench.named.joint_names)
    for number in range(20):
        asked = 1e-3 * np.sin(0.3 * number + np.arange(8.0))
        now = desk.bench.node.get_clock().now().to_msg()
        desk.say(JOINTS, JointState(header=Header(stamp=now), name=names, effort=list(asked)))
        np.testing.assert_array_equal(desk.frames(1), [asked])


def test_an_array_as_for_forward_command_controller_commands_all_joints(desk):
    asked = 1e-3 * np.arange(8.0)
    desk.say(EFFORTS, Float64MultiArray(data=list(asked)))
    np.testing.assert_array_equal(desk.frames(3), [asked] * 3)


def test_listed_joints_use_arrays_in_their_order_and_their_own_limits(graph, named):
    given = {
        'joints': ['rotor_6', 'rotor_1'],
        'torque_limits.rotor_6': 0.02,
        'torque_limit': 0.3,
        'command_timeout': 0.0,
    }
    desk = Desk(graph, named, given)
    desk.say(EFFORTS, Float64MultiArray(data=[0.02, -0.3]))
    np.testing.assert_array_equal(desk.frames(1), [at(r6=0.02, r1=-0.3)])
    for number, (topic, message, complaint) in enumerate(
        (
            (EFFORTS, Float64MultiArray(data=[0.021, 0.0]), 'rotor_6 = 0.021 N m must lie in'),
            (EFFORTS, Float64MultiArray(data=[0.0] * 8), 'has 8 efforts for 2 joints'),
            (JOINTS, efforts(rotor_0=0.0), "'rotor_0', which has no actuator"),
        ),
        start=1,
    ):
        desk.publish(topic, message)
        assert complaint in desk.bench.refusal(number)
    np.testing.assert_array_equal(desk.frames(1), [at(r6=0.02, r1=-0.3)])


def test_a_trajectory_interpolates_its_points_linearly_and_is_held_for_the_timeout(desk):
    desk.say(TRAJECTORY, trajectory(['rotor_4'], (0.02, [2e-3]), (0.05, [-1e-3])))
    torques = desk.frames(12, messages=11)
    expected = 1e-3 * np.array([0.5, 1.5, 1.5, 0.5, -0.5, *[-1.0] * 5, 0.0])
    np.testing.assert_allclose(torques, [at(r4=effort) for effort in expected], atol=1e-15)


def test_a_trajectory_may_start_in_the_future_or_the_past(desk):
    now = desk.bench.node.get_clock().now().nanoseconds
    late = trajectory(['rotor_4'], (0.0, [1e-3]), (100.0, [1e-3]))
    late.header.stamp = time_to_msg(now - 50 * 10**9)
    desk.say(TRAJECTORY, late)
    np.testing.assert_allclose(desk.frames(1), [at(r4=1e-3)], rtol=1e-12)
    early = trajectory(['rotor_4'], (0.0, [0.0]), (1.0, [5e-3]))
    early.header.stamp = time_to_msg(now + 100 * 10**9)
    desk.say(TRAJECTORY, early)
    ((torque,),) = desk.frames(1)[:, [4]]
    assert torque == pytest.approx(1e-3, rel=1e-3)


GOOD_POINT = (0.1, [1e-3])


WRONG: list[tuple[interfaces.Topic, Any, str]] = [
    (JOINTS, efforts(rotor_1=1e-3, rotor_8=1e-3), "'rotor_8', which has no actuator"),
    (JOINTS, efforts(rotor_1=1e-3, rotor_2=math.nan), 'rotor_2 = nan N m must be a finite'),
    (JOINTS, efforts(rotor_1=1e-3, rotor_2=-0.11), 'rotor_2 = -0.11 N m must lie in the'),
    (JOINTS, JointState(name=['rotor_1'] * 2, effort=[1e-3] * 2), "'rotor_1' twice"),
    (JOINTS, JointState(name=['rotor_1'], effort=[]), 'has 0 efforts for 1 joints'),
    (JOINTS, JointState(effort=[1e-3]), 'has an empty field name'),
    (JOINTS, JointState(name=['rotor_1'], position=[0.5], effort=[1e-3]), 'only effort'),
    (
        JOINTS,
        JointState(header=LONG_AGO, name=['rotor_1'], effort=[1e-3]),
        's old, the limit is 0.05 s',
    ),
    (EFFORTS, Float64MultiArray(data=[1e-3] * 7), 'has 7 efforts for 8 joints'),
    (EFFORTS, Float64MultiArray(data=[1e-3] * 7 + [math.nan]), 'rotor_7 = nan N m must'),
    (EFFORTS, Float64MultiArray(data=[1e-3] * 7 + [0.2]), 'rotor_7 = 0.2 N m must lie in'),
    (TRAJECTORY, trajectory([], (0.1, [])), 'has points but no joints'),
    (TRAJECTORY, trajectory(['rotor_1'], (2.1e9, [1e-3])), 'from now, the limit is 600 s'),
    (
        TRAJECTORY,
        JointTrajectory(
            header=FAR_AHEAD, joint_names=['rotor_1'], points=[JointTrajectoryPoint(effort=[1e-3])]
        ),
        'from now, the limit is 600 s; send a shorter command, or raise longest_command',
    ),
    (
        JOINTS,
        JointState(header=FAR_AHEAD, name=['rotor_1'], effort=[1e-3]),
        'in the future, the limit is 0.05 s; synchronise the clocks',
    ),
    (TRAJECTORY, trajectory(['wheel'], GOOD_POINT), "'wheel', which has no actuator"),
    (
        TRAJECTORY,
        trajectory(['rotor_1'], GOOD_POINT, (0.2, [])),
        'point 1 of /edge_actuator/joint_traj',
    ),
    (TRAJECTORY, trajectory(['rotor_1'], GOOD_POINT, GOOD_POINT), 'or more and increase'),
    (TRAJECTORY, trajectory(['rotor_1'], GOOD_POINT, (0.2, [9.0])), 'rotor_1 = 9 N m must'),
    (
        TRAJECTORY,
        JointTrajectory(
            joint_names=['rotor_1'], points=[JointTrajectoryPoint(positions=[1.0], effort=[1e-3])]
        ),
        'point 0 of /edge_actuator/joint_trajectory commands positions',
    ),
    (
        TRAJECTORY,
        JointTrajectory(
            header=LONG_AGO, joint_names=['rotor_1'], points=[JointTrajectoryPoint(effort=[1e-3])]
        ),
        '/edge_actuator/joint_trajectory ended',
    ),
]


def test_a_trajectory_without_points_ends_torques(desk):
    for names in [[], ['rotor_4', 'rotor_5']]:
        desk.say(TRAJECTORY, trajectory(['rotor_4'], (0.0, [1e-3]), (10.0, [1e-3])))
        assert desk.frames(2)[-1][4] == pytest.approx(1e-3)
        desk.say(TRAJECTORY, JointTrajectory(joint_names=names))
        assert not desk.frames(1).any()
        desk.frames(5, 0)


def test_wrong_commands_are_rejected_whole(desk):
    desk.say(JOINTS, efforts(rotor_1=5e-4))
    desk.frames(1)
    for number, (topic, message, complaint) in enumerate(WRONG, start=1):
        desk.publish(topic, message)
        assert complaint in desk.bench.refusal(number)
    np.testing.assert_array_equal(desk.frames(1), [at(r1=5e-4)])


def test_joints_and_an_edge_act_together(desk):
    desk.bench.carry_out(edge=EdgeCommand.FIRST, kind=EdgeCommand.PULSE, value=1e-3, duration=60.0)
    (alone,) = desk.frames(1)
    desk.say(JOINTS, efforts(rotor_6=2e-3))
    (together,) = desk.frames(1)
    np.testing.assert_allclose(together, alone + at(r6=2e-3), rtol=1e-12)


def test_stamps_that_go_back_end_all_torques(desk):
    desk.say(JOINTS, efforts(rotor_6=2e-3))
    desk.frames(1)
    rest = desk.bench.named.chain.uniform_state(-1)
    desk.bench.joints(rest, stamp=0.0)
    assert 'all torques are dropped' in desk.bench.refusal()
    assert not desk.bench.next_torques().any()
    desk.bench.joints(rest, stamp=0.1)
    desk.bench.graph.next_report('edge_actuator')
    assert desk.bench.torques == []


def test_wrong_parameters_stop_it(graph, named):
    for given, complaint in [
        ({'joints': ['rotor_1', 'rotor_1']}, 'each once'),
        ({'joints': ['rotor_1'], 'torque_limits.rotor_2': 1.0}, 'is unknown'),
        ({'joints': ['rotor_1'], 'torque_limits.rotor_1': -1.0}, 'must lie in the range 0'),
        ({'lowest_pressure': -2e5}, 'must lie in the range -101325 to 0 Pa'),
    ]:
        with pytest.raises(ValueError, match=complaint):
            Bench(graph, named, given)


def test_a_listed_joint_that_is_unknown_is_rejected_with_the_chain(graph, named):
    bench = Bench(graph, named, {'joints': ['rotor_9']})
    bench.tell_chain()
    assert "parameter joints names 'rotor_9', which is none of 'rotor_0' to" in bench.refusal()
    bench.joints(named.chain.uniform_state(-1))
    bench.nudge(1.0)
    assert 'the chain is unknown' in bench.refusal(2)
