# SPDX-License-Identifier: Apache-2.0
"""Commands become impulses and torques along the zero mode of the chain as it is now."""

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from bench import Bench
from graphs import values
from joint_frames import frame_of, halves
from numpy.typing import ArrayLike
from std_msgs.msg import Float64, Header

from soliton_linkage.actuation.actuators import ACTUATORS, PneumaticActuator
from soliton_linkage.actuation.profile import trapezoid
from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import Edge, edge_mode, rigidity_matrix
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.solitons.tanh_fit import find_solitons
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg, time_to_msg

LEFT, RIGHT = -1, 1
NEAR_EDGE = {LEFT: EdgeCommand.FIRST, RIGHT: EdgeCommand.LAST}
LASTING = EdgeCommand.PRESSURE


@pytest.fixture
def bench(graph, named):
    bench = Bench(graph, named)
    bench.tell_chain()
    return bench


@pytest.mark.parametrize('lean', [LEFT, RIGHT])
def test_a_nudge_is_an_impulse_along_the_zero_mode_of_its_speed(bench, lean):
    for speed in [7.5, -7.5]:
        chain = bench.named.chain
        angles = chain.uniform_state(lean)
        bench.joints(angles)
        bench.nudge(speed)
        impulses = bench.next_impulses()
        rates = impulses / chain.moment_of_inertia
        stretched = rigidity_matrix(chain, angles) @ rates
        assert np.linalg.norm(rates) == pytest.approx(abs(speed), rel=1e-12)
        assert np.abs(stretched).max() < 1e-12 * abs(speed)
        expected = edge_mode(chain, angles, Edge.NEAREST)
        np.testing.assert_array_equal(impulses, chain.moment_of_inertia * speed * expected)


@pytest.mark.parametrize('lean', [LEFT, RIGHT])
def test_a_positive_kick_sends_a_wall_from_its_edge_into_the_chain(graph, lean):
    chain = Chain(number_of_rotors=20)
    named = NamedChain(chain, tuple(f'joint_{rotor}' for rotor in range(20)))
    bench = Bench(graph, named)
    bench.tell_chain()
    angles = chain.uniform_state(lean)
    bench.joints(angles)
    bench.command(edge=NEAR_EDGE[lean], kind=EdgeCommand.KICK, value=10.0)
    rates = bench.next_impulses() / chain.moment_of_inertia
    moved = simulate(chain, angles, rates, duration=1.0, period=1.0)
    (wall,) = find_solitons(chain, moved.angles[-1], moved.rates[-1])
    from_edge = wall.rotor if lean == LEFT else 19 - wall.rotor
    assert from_edge > 5
    assert wall.velocity * lean < 0


def test_the_mode_is_that_of_the_latest_configuration(bench):
    chain = bench.named.chain
    rest = chain.uniform_state(LEFT)
    start = 10.0 * edge_mode(chain, rest, Edge.FIRST)
    moved = simulate(chain, rest, start, duration=0.5, period=0.1)
    for angles in moved.angles:
        bench.joints(angles)
        bench.command(edge=EdgeCommand.NEAREST, kind=EdgeCommand.KICK, value=2.0)
        expected = edge_mode(chain, angles, Edge.NEAREST)
        np.testing.assert_array_equal(
            bench.next_impulses(), chain.moment_of_inertia * 2.0 * expected
        )


def test_the_edge_of_nudges_can_be_changed_and_not_to_nonsense(bench):
    bench.joints(bench.named.chain.uniform_state(LEFT))
    for edge, allowed in (('last', True), ('middle', False)):
        assert bench.set('nudge_edge', edge) == allowed
    bench.nudge(1.0)
    assert bench.refusal().endswith('nearer the first edge than the last; choose the first edge')


@pytest.mark.parametrize('speed', [7.0, -2.0])
def test_a_nudge_can_be_a_pressure_with_the_impulse_of_the_kick(bench, speed):
    assert bench.set('nudge_as', 'pressure')
    assert bench.set('nudge_duration', 0.08)
    chain = bench.named.chain
    rest = chain.uniform_state(LEFT)
    bench.joints(rest, stamp=-0.01)
    bench.joints(rest, stamp=0.0)
    bench.nudge(speed)
    bench.graph.until(lambda: bench.node.carried_out, 'the nudge')
    torques = bench.drive([rest] * 90, 0.01, 0.01)
    impulse = 0.01 * torques.sum(axis=0)
    expected = chain.moment_of_inertia * speed * edge_mode(chain, rest, Edge.FIRST)
    np.testing.assert_allclose(impulse, expected, rtol=1e-5)
    assert bench.impulses == []
    assert not torques[-1].any()


def test_a_pulse_follows_the_mode_and_its_ramps_until_its_time_is_over(bench):
    chain = bench.named.chain
    rest = chain.uniform_state(LEFT)
    moved = simulate(
        chain, rest, 10.0 * edge_mode(chain, rest, Edge.FIRST), duration=0.6, period=0.1
    )
    bench.joints(rest, stamp=0.0)
    bench.joints(rest, stamp=0.1)
    bench.carry_out(
        edge=EdgeCommand.FIRST,
        kind=EdgeCommand.PULSE,
        value=5e-3,
        ramp_up=0.1,
        duration=0.15,
        ramp_down=0.1,
    )
    torques = bench.drive(moved.angles, 0.2, 0.1, messages=5)
    # Means over the periods of a rise, a plateau and a fall that begin with the next frame.
    for mean, given, angles in zip(
        (0.5, 1.0, 0.875, 0.125, 0.0), torques, moved.angles, strict=False
    ):
        mode = edge_mode(chain, angles, Edge.FIRST, anywhere=True)
        np.testing.assert_allclose(given, 5e-3 * mean * mode, atol=1e-15)


@pytest.mark.parametrize('side', [Edge.FIRST, Edge.LAST])
def test_a_pressure_follows_the_filling_and_venting_of_the_chamber(bench, side):
    chain = bench.named.chain
    rest = chain.uniform_state(LEFT if side is Edge.FIRST else RIGHT)
    bench.joints(rest, stamp=0.0)
    bench.joints(rest, stamp=0.01)
    bench.carry_out(edge=EdgeCommand.NEAREST, kind=LASTING, value=1e5, duration=0.1, ramp_up=0.02)
    torques = bench.drive([rest] * 100, 0.02, 0.01, messages=83)
    model = bench.node.actuator
    areas = [
        model.response(0.0, trapezoid(1e5, 0.02, 0.1, 0.0), 0.0, 0.01 * n)[1] for n in range(84)
    ]
    strengths = model.torque_per_pressure * np.diff(areas) / 0.01
    strengths[-1] = 0.0
    expected = strengths[:, None] * edge_mode(chain, rest, side)
    np.testing.assert_allclose(torques, expected, atol=1e-14)


FULL_KICK = {'edge': EdgeCommand.FIRST, 'kind': EdgeCommand.KICK, 'value': 5.0}
FULL_PRESSURE = {'edge': EdgeCommand.FIRST, 'kind': LASTING, 'value': 1e4, 'duration': 1.0}
FULL_PULSE = FULL_PRESSURE | {'kind': EdgeCommand.PULSE, 'value': 0.01}
LONG_AGO = Header(stamp=time_to_msg(10**18))


WRONG: list[tuple[dict[str, Any], str]] = [
    (FULL_KICK | {'value': math.nan}, 'speed = nan rad/s must be a finite number'),
    (FULL_KICK | {'value': -math.inf}, 'speed = -inf rad/s must be a finite number'),
    (
        FULL_KICK | {'value': 100.5},
        'speed = 100.5 rad/s must lie in the range -100 to 100 rad/s; '
        'lower the speed or raise speed_limit',
    ),
    (FULL_KICK | {'duration': 0.5}, 'duration of a kick = 0.5 s must be 0'),
    (FULL_KICK | {'duration': math.nan}, 'duration of a kick = nan s must be 0'),
    (FULL_KICK | {'edge': 3}, 'edge = 3 must be one of 0, 1, 2'),
    (FULL_KICK | {'kind': 4}, 'kind = 4 must be one of 0, 1, 2, 3'),
    (FULL_KICK | {'ramp_up': 0.1}, 'ramp_up of a kick = 0.1 s must be 0'),
    (FULL_KICK | {'header': LONG_AGO}, 's old, the limit is 0.5 s; send it earlier, or'),
    (FULL_KICK | {'edge': EdgeCommand.LAST}, 'nearer the first edge than the last'),
    (FULL_PRESSURE | {'edge': EdgeCommand.LAST}, 'nearer the first edge than the last'),
    (FULL_PRESSURE | {'value': math.nan}, 'pressure = nan Pa must be a finite number'),
    (
        FULL_PRESSURE | {'value': -3e5},
        'pressure = -300000 Pa must lie in the range -80000 to 200000 Pa',
    ),
    (FULL_PRESSURE | {'duration': 0.0, 'ramp_down': 1.0}, 'ramp_down = 1 s must be 0 for'),
    (FULL_PULSE | {'value': 0.2}, 'torque = 0.2 N m must lie in the range -0.1 to 0.1 N m'),
    (FULL_PULSE | {'ramp_down': -1e-3}, 'ramp_down = -0.001 s must be a finite number of 0'),
    (FULL_PULSE | {'edge': EdgeCommand.LAST}, 'nearer the first edge than the last'),
    (FULL_PRESSURE | {'duration': -1.0}, 'duration = -1 s must be a finite number of 0 or'),
    (FULL_PRESSURE | {'duration': math.inf}, 'duration = inf s must be a finite number'),
    (FULL_PRESSURE | {'edge': 255}, 'edge = 255 must be one of 0, 1, 2'),
]


def test_wrong_commands_are_rejected_and_the_active_one_continues(bench):
    rest = bench.named.chain.uniform_state(LEFT)
    bench.joints(rest)
    bench.joints(rest)
    bench.carry_out(edge=EdgeCommand.FIRST, kind=EdgeCommand.PULSE, value=2e-3, duration=9.0)
    bench.joints(rest)
    held = bench.next_torques()
    for number, (command, complaint) in enumerate(WRONG, start=1):
        bench.command(**command)
        assert complaint in bench.refusal(number)
        assert bench.reports[-1].level == bench.reports[-1].WARN
        bench.joints(rest)
        np.testing.assert_array_equal(bench.next_torques(), held)
        assert bench.torques == []


def test_without_joint_states_commands_are_rejected(bench):
    bench.nudge(1.0)
    assert 'no fresh joint_states: none received, the limit is 60 s' in bench.refusal()
    bench.command(**FULL_PRESSURE)
    assert 'start or resume the simulator' in bench.refusal(2)
    assert bench.torques == []


def test_with_old_joint_states_commands_are_rejected(graph, named):
    bench = Bench(graph, named, {'state_timeout': 1e-3})
    bench.tell_chain()
    bench.joints(named.chain.uniform_state(LEFT))
    arrived = time.monotonic()
    graph.until(lambda: time.monotonic() - arrived > 2e-3, 'the joint states to grow old')
    bench.nudge(1.0)
    refusal = bench.refusal()
    assert 'no fresh joint_states: the last is' in refusal
    assert 's old, the limit is 0.001 s; start or resume the simulator, or raise' in refusal


def test_without_a_chain_commands_are_rejected(graph, named):
    bench = Bench(graph, named)
    bench.joints(named.chain.uniform_state(LEFT))
    bench.nudge(1.0)
    assert 'the chain is unknown; publish chain or set chain_from' in bench.refusal()


def test_a_frame_that_is_read_again_is_not_late(graph, named, said):
    bench = Bench(graph, named)
    bench.tell_chain()
    bench.joints(named.chain.uniform_state(LEFT))
    for _ in range(3):
        bench.nudge(1.0)
        bench.next_impulses()
    assert 'late' not in said()
    bench.joints(named.chain.uniform_state(LEFT), stamp=0.01)
    bench.nudge(1.0)
    bench.next_impulses()
    assert 'joint_states are not in order: a stamp is equal to the previous one' in said()


def test_warnings_have_the_real_names_of_topics(graph, said):
    renamed = ['--ros-args', '-r', 'nudge:=poke', '-r', '~/commands:=/efforts']
    graph.start(EdgeActuator, namespace='left', cli_args=renamed)
    for topic, name in (
        (interfaces.NUDGE, '/left/poke'),
        (interfaces.EFFORT_COMMANDS, '/efforts'),
        (interfaces.JOINT_TRAJECTORY, '/left/edge_actuator/joint_trajectory'),
    ):
        reports = graph.reports('edge_actuator')
        graph.speak(replace(topic, name=name)).publish(topic.type())
        graph.until(
            lambda heard=reports, name=name: any(name in status.message for status in heard), name
        )
    assert 'rejected /left/poke: nothing subscribes' in said()


def test_wrong_joint_states_are_rejected_when_they_are_needed(bench, named):
    rest = named.chain.uniform_state(LEFT)
    message = frame_of(named, rest)
    message.position[0] = math.nan
    bench.raw_joints(message)
    bench.nudge(1.0)
    assert 'position of rotor_0 = nan must be a finite number' in bench.refusal()
    bench.joints(rest)
    bench.nudge(1.0)
    bench.next_impulses()


def test_without_a_subscriber_of_impulses_commands_are_rejected(graph, named):
    reports = graph.reports('edge_actuator')
    graph.start(EdgeActuator)
    for number, (topic, message, torques) in enumerate(
        (
            (interfaces.NUDGE, Float64(data=1.0), 'rotor_impulses'),
            (interfaces.EDGE_COMMAND, EdgeCommand(**FULL_PRESSURE), 'rotor_torques'),
        ),
        start=1,
    ):
        graph.speak(topic).publish(message)
        graph.until(
            lambda n=number: reports and values(reports[-1])['rejected'] == str(n), 'the refusal'
        )
        assert values(reports[-1])['last rejection'] == (
            f'/{topic.name}: nothing subscribes to {torques}; start the simulator first'
        )


def test_a_report_has_the_missing_input(graph, named):
    bench = Bench(graph, named)
    graph.until(lambda: bench.reports, 'a report')
    assert bench.reports[-1].message == 'waiting for the topic chain'
    bench.tell_chain()
    assert graph.next_report('edge_actuator').message == 'waiting for joint_states'
    bench.joints(named.chain.uniform_state(LEFT))
    report = graph.next_report('edge_actuator')
    assert (report.message, report.level) == ('ready', report.OK)
    bench.joints(named.chain.uniform_state(LEFT))
    bench.carry_out(edge=EdgeCommand.FIRST, kind=LASTING, value=2e4)
    bench.joints(named.chain.uniform_state(LEFT))
    bench.next_torques()
    report = graph.next_report('edge_actuator')
    assert (report.message, report.level) == ('driving', report.OK)
    assert values(report)['commands carried out'] == '1'


def test_a_subscriber_of_torques_is_sufficient(graph, named):
    given = {'chain_from': 'parameters', 'chain.number_of_rotors': named.rotors}
    node = graph.start(EdgeActuator, {**given, 'state_timeout': 60.0})
    joints = graph.speak(interfaces.JOINT_STATES)
    joints.publish(frame_of(named, named.chain.uniform_state(LEFT), 1))
    graph.until(lambda: node.frames.taken, 'the joint states')
    report = graph.next_report('edge_actuator')
    assert report.message == 'nothing subscribes to rotor_impulses or rotor_torques'
    graph.hear(interfaces.ROTOR_TORQUES)
    graph.until(lambda: graph.next_report('edge_actuator').message == 'ready', 'to be ready')


def test_impulses_are_stamped(bench):
    bench.joints(bench.named.chain.uniform_state(LEFT))
    bench.nudge(1.0)
    bench.graph.until(lambda: bench.impulses, 'impulses')
    assert time_from_msg(bench.impulses[0].header.stamp) > 1_600_000_000 * 10**9
    assert bench.impulses[0].header.frame_id == 'linkage'


@dataclass(frozen=True)
class TwinBellows(PneumaticActuator):
    """Bellows in pairs."""

    bellows: int = quantity(2, 'number of bellows', '', 1, 9)

    def torque(self, pressure: ArrayLike) -> Array:
        return self.bellows * super().torque(pressure)


@pytest.fixture
def twin_bellows(monkeypatch):
    monkeypatch.setitem(ACTUATORS, 'twin_bellows', TwinBellows)


@pytest.mark.usefixtures('twin_bellows')
def test_the_actuator_that_is_chosen_gives_the_torques(graph, named):
    bench = Bench(graph, named, {'actuator': 'twin_bellows', 'bellows': 3})
    bench.tell_chain()
    rest = named.chain.uniform_state(-1)
    bench.joints(rest, stamp=0.0)
    bench.joints(rest, stamp=1.0)
    bench.carry_out(edge=EdgeCommand.FIRST, kind=EdgeCommand.PRESSURE, value=1e5)
    held = bench.drive([rest, rest], 10.0, 10.0, messages=2)[-1]
    strength = 3 * 1e5 * PneumaticActuator().torque_per_pressure
    expected = strength * edge_mode(named.chain, rest, Edge.FIRST)
    np.testing.assert_allclose(held, expected, rtol=1e-6)


def test_frames_in_halves_are_whole_for_a_kick(bench, named):
    rest = named.chain.uniform_state(LEFT)
    for number in (1, 2):
        first, second = halves(frame_of(named, rest, number * 10**7, 0 * rest))
        bench.publish_joints(first)
        bench.raw_joints(second)
    bench.nudge(1.0)
    expected = edge_mode(named.chain, rest, Edge.NEAREST)
    np.testing.assert_array_equal(
        bench.next_impulses(), named.chain.moment_of_inertia * 1.0 * expected
    )
