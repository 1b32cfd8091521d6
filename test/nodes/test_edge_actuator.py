# SPDX-License-Identifier: Apache-2.0
"""Commands become impulses and torques along the zero mode of the chain as it is now."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest
from graphs import Graph, values
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from soliton_linkage.actuation import Edge, edge_mode
from soliton_linkage.chain import Array, Chain
from soliton_linkage.elastic_simulation import simulate
from soliton_linkage.rigidity import rigidity_matrix
from soliton_linkage.soliton import find_solitons
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.conversions import (
    Frame,
    NamedChain,
    chain_to_msg,
    frame_to_msg,
    impulses_from_msg,
    time_from_msg,
    time_to_msg,
    torques_from_msg,
)
from soliton_linkage_nodes.edge_actuator import EdgeActuator

pytestmark = pytest.mark.usefixtures('often')

LEFT, RIGHT = -1, 1
NEAR_EDGE = {LEFT: EdgeCommand.FIRST, RIGHT: EdgeCommand.LAST}
PATIENT = {'state_timeout': 60.0}
LASTING = EdgeCommand.PRESSURE


class Bench:
    """An actuator between a test that plays the joints and one that plays the user."""

    def __init__(
        self, graph: Graph, named: NamedChain, parameters: dict[str, Any] | None = None
    ) -> None:
        self.graph, self.named = graph, named
        self.impulses = graph.hear(interfaces.ROTOR_IMPULSES)
        self.torques = graph.hear(interfaces.ROTOR_TORQUES)
        self.reports = graph.reports('edge_actuator')
        self.node = graph.start(EdgeActuator, {**PATIENT, **(parameters or {})})
        self._joints = graph.speak(interfaces.JOINT_STATES)
        self._nudges = graph.speak(interfaces.NUDGE)
        self._commands = graph.speak(interfaces.EDGE_COMMAND)
        for publisher in self.node.publishers:
            if publisher.topic_name in ('/rotor_impulses', '/rotor_torques'):
                graph.until(publisher.get_subscription_count, publisher.topic_name)
        self._stamp = 0.0

    def tell_chain(self) -> None:
        self.graph.speak(interfaces.CHAIN).publish(chain_to_msg(self.named, time_to_msg(0)))
        self.graph.until(lambda: self.node._source.named, 'the chain')

    def joints(self, angles: Array, stamp: float | None = None, order: int = 1) -> None:
        """Publish joint states of a stamp [s], and wait until they are there."""
        self._stamp = self._stamp + 0.01 if stamp is None else stamp
        zeros = np.zeros(self.named.rotors)
        instant = time_to_msg(round(self._stamp * 1e9))
        message = frame_to_msg(self.named, Frame(angles, zeros), zeros, instant)
        for field in ('name', 'position', 'velocity', 'effort'):
            setattr(message, field, list(getattr(message, field))[::order])
        self.raw_joints(message)

    def raw_joints(self, message: JointState) -> None:
        before = self.node._latest_at
        self._joints.publish(message)
        self.graph.until(lambda: self.node._latest_at > before, 'the joint states')

    def nudge(self, speed: float) -> None:
        self._nudges.publish(Float64(data=speed))

    def command(self, **fields: Any) -> None:
        self._commands.publish(EdgeCommand(**fields))

    def next_impulses(self) -> Array:
        """Return the angular impulse of each rotor of the one message that comes."""
        self.graph.until(lambda: self.impulses, 'impulses')
        (message,) = self.impulses
        self.impulses.clear()
        return impulses_from_msg(self._order(), message, math.inf)

    def next_torques(self) -> Array:
        self.graph.until(lambda: self.torques, 'torques')
        message = self.torques.pop(0)
        assert (len(message.position), len(message.velocity)) == (0, 0)
        return torques_from_msg(self._order(), message, math.inf)

    def refusal(self, number: int = 1) -> str:
        """Return what was refused last, once so many commands were."""
        self.graph.until(
            lambda: self.reports and values(self.reports[-1])['refused'] == str(number),
            f'{number} refusals',
        )
        assert self.impulses == []
        return values(self.reports[-1])['last refusal']

    def _order(self) -> dict[str, int]:
        return {name: rotor for rotor, name in enumerate(self.named.joint_names)}


@pytest.fixture
def bench(graph: Graph, named: NamedChain) -> Bench:
    bench = Bench(graph, named)
    bench.tell_chain()
    return bench


@pytest.mark.parametrize('speed', [7.5, -7.5])
@pytest.mark.parametrize('lean', [LEFT, RIGHT])
def test_a_nudge_is_an_impulse_along_the_zero_mode_of_its_speed(
    bench: Bench, lean: int, speed: float
) -> None:
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
def test_a_positive_kick_sends_a_wall_from_its_edge_into_the_chain(
    graph: Graph, lean: int
) -> None:
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


def test_the_mode_is_that_of_the_latest_configuration(bench: Bench) -> None:
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


def test_joints_may_come_in_any_order(bench: Bench) -> None:
    chain = bench.named.chain
    angles = chain.uniform_state(LEFT) + np.linspace(0, 0.01, chain.number_of_rotors)
    bench.joints(angles, order=-1)
    bench.nudge(1.0)
    expected = chain.moment_of_inertia * edge_mode(chain, angles, Edge.NEAREST)
    np.testing.assert_array_equal(bench.next_impulses(), expected)


def test_the_edge_of_nudges_can_be_changed_and_not_to_nonsense(bench: Bench) -> None:
    bench.joints(bench.named.chain.uniform_state(LEFT))
    for edge, allowed in (('last', True), ('middle', False)):
        change = Parameter('nudge_edge', value=edge).to_parameter_msg()
        response = bench.graph.call(
            SetParameters, 'edge_actuator/set_parameters', parameters=[change]
        )
        assert response.results[0].successful == allowed
    bench.nudge(1.0)
    assert bench.refusal().endswith('nearer the first edge than the last; name the first edge')


def test_a_pressure_is_a_torque_that_follows_the_mode_until_its_time_is_over(
    bench: Bench,
) -> None:
    chain = bench.named.chain
    settings = bench.node.settings
    rest = chain.uniform_state(LEFT)
    moved = simulate(
        chain, rest, 10.0 * edge_mode(chain, rest, Edge.FIRST), duration=0.6, period=0.1
    )
    bench.joints(moved.angles[0], stamp=0.0)
    bench.command(edge=EdgeCommand.FIRST, kind=LASTING, value=1e5, duration=0.35)
    strength = 1e5 * settings.torque_per_pressure
    for number, angles in enumerate(moved.angles):
        if number:
            bench.joints(angles, stamp=0.1 * number)
        pushing = number < 4
        mode = edge_mode(chain, angles, Edge.FIRST, anywhere=True)
        np.testing.assert_array_equal(bench.next_torques(), strength * mode * pushing)
        if not pushing:
            break
    bench.joints(moved.angles[-1], stamp=0.6)
    bench.nudge(1.0)
    bench.next_impulses()
    assert bench.torques == []


def test_a_pressure_for_ever_lasts_until_it_is_vented(bench: Bench) -> None:
    rest = bench.named.chain.uniform_state(LEFT)
    bench.joints(rest, stamp=0.0)
    bench.command(edge=EdgeCommand.NEAREST, kind=LASTING, value=-1e5)
    assert np.any(bench.next_torques())
    bench.joints(rest, stamp=1e6)
    assert np.any(bench.next_torques())
    bench.command(edge=EdgeCommand.NEAREST, kind=LASTING, value=0.0)
    assert not np.any(bench.next_torques())
    bench.joints(rest, stamp=1e6 + 1)
    bench.nudge(1.0)
    bench.next_impulses()
    assert bench.torques == []


FULL_KICK = {'edge': EdgeCommand.FIRST, 'kind': EdgeCommand.KICK, 'value': 5.0}
FULL_PRESSURE = {'edge': EdgeCommand.FIRST, 'kind': LASTING, 'value': 1e4, 'duration': 1.0}


@pytest.mark.parametrize(
    ('command', 'complaint'),
    [
        (FULL_KICK | {'value': math.nan}, 'speed = nan rad/s must be a finite number'),
        (FULL_KICK | {'value': -math.inf}, 'speed = -inf rad/s must be a finite number'),
        (
            FULL_KICK | {'value': 100.5},
            'speed = 100.5 rad/s must lie in the range -100 to 100 rad/s; '
            'ask for less or raise speed_limit',
        ),
        (FULL_KICK | {'duration': 0.5}, 'duration of a kick = 0.5 s must be 0'),
        (FULL_KICK | {'duration': math.nan}, 'duration of a kick = nan s must be 0'),
        (FULL_KICK | {'edge': 3}, 'edge = 3 must be one of 0, 1, 2'),
        (FULL_KICK | {'kind': 2}, 'kind = 2 must be one of 0, 1'),
        (FULL_KICK | {'edge': EdgeCommand.LAST}, 'nearer the first edge than the last'),
        (FULL_PRESSURE | {'edge': EdgeCommand.LAST}, 'nearer the first edge than the last'),
        (FULL_PRESSURE | {'value': math.nan}, 'pressure = nan Pa must be a finite number'),
        (
            FULL_PRESSURE | {'value': -3e5},
            'pressure = -300000 Pa must lie in the range -200000 to 200000 Pa',
        ),
        (FULL_PRESSURE | {'duration': -1.0}, 'duration = -1 s must be a finite number of 0 or'),
        (FULL_PRESSURE | {'duration': math.inf}, 'duration = inf s must be a finite number'),
        (FULL_PRESSURE | {'edge': 255}, 'edge = 255 must be one of 0, 1, 2'),
    ],
)
def test_a_wrong_command_is_refused_and_the_pressure_that_is_held_goes_on(
    bench: Bench, command: dict[str, Any], complaint: str
) -> None:
    rest = bench.named.chain.uniform_state(LEFT)
    bench.joints(rest)
    bench.command(edge=EdgeCommand.FIRST, kind=LASTING, value=2e4, duration=0.0)
    held = bench.next_torques()
    bench.command(**command)
    assert complaint in bench.refusal()
    assert bench.reports[-1].level == bench.reports[-1].WARN
    bench.joints(rest)
    np.testing.assert_array_equal(bench.next_torques(), held)
    assert bench.torques == []


@pytest.mark.parametrize('value', [math.nan, math.inf, 1e3])
def test_a_wrong_nudge_is_refused(bench: Bench, value: float) -> None:
    bench.joints(bench.named.chain.uniform_state(LEFT))
    bench.nudge(value)
    assert bench.refusal().startswith(f'nudge: speed = {value:g} rad/s must ')
    bench.nudge(1.0)
    bench.next_impulses()


def test_without_any_joint_states_commands_are_refused(bench: Bench) -> None:
    bench.nudge(1.0)
    assert 'no fresh joint_states: none has come, the limit is 60 s' in bench.refusal()
    bench.command(**FULL_PRESSURE)
    assert 'start or resume the simulator' in bench.refusal(2)
    assert bench.torques == []


def test_with_old_joint_states_commands_are_refused(graph: Graph, named: NamedChain) -> None:
    bench = Bench(graph, named, {'state_timeout': 1e-3})
    bench.tell_chain()
    bench.joints(named.chain.uniform_state(LEFT))
    arrived = time.monotonic()
    graph.until(lambda: time.monotonic() - arrived > 2e-3, 'the joint states to grow old')
    bench.nudge(1.0)
    refusal = bench.refusal()
    assert 'no fresh joint_states: the last is' in refusal
    assert 's old, the limit is 0.001 s; start or resume the simulator, or raise' in refusal


def test_without_a_chain_commands_are_refused(graph: Graph, named: NamedChain) -> None:
    bench = Bench(graph, named)
    bench.joints(named.chain.uniform_state(LEFT))
    bench.nudge(1.0)
    assert 'the chain is not known yet; publish chain or set chain_from' in bench.refusal()


def test_parameters_of_the_chain_take_the_place_of_the_topic(
    graph: Graph, named: NamedChain
) -> None:
    given = {'chain_from': 'parameters', 'chain.number_of_rotors': named.rotors}
    bench = Bench(graph, named, given)
    bench.joints(named.chain.uniform_state(LEFT))
    bench.nudge(1.0)
    assert np.any(bench.next_impulses())


@pytest.mark.parametrize(
    ('spoil', 'complaint'),
    [
        ({'position': [0.0]}, 'joint_states.position has 1 values for 8 names'),
        ({'position': [math.nan] * 8}, 'position of rotor_0 = nan must be a finite number'),
        ({'name': [f'wheel_{n}' for n in range(8)]}, 'joint_states.name lacks 8 of 8 rotors'),
        ({'name': ['rotor_0'] * 8}, "'rotor_0' twice"),
    ],
)
def test_wrong_joint_states_are_refused_when_they_are_needed(
    bench: Bench, named: NamedChain, spoil: dict[str, Any], complaint: str
) -> None:
    rest = named.chain.uniform_state(LEFT)
    zeros = np.zeros(named.rotors)
    message = frame_to_msg(named, Frame(rest, None), zeros, time_to_msg(0))
    for field, value in spoil.items():
        setattr(message, field, value)
    bench.raw_joints(message)
    bench.nudge(1.0)
    assert complaint in bench.refusal()
    bench.joints(rest)
    bench.nudge(1.0)
    bench.next_impulses()


def test_while_nobody_takes_impulses_commands_are_refused(graph: Graph, named: NamedChain) -> None:
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
            lambda n=number: reports and values(reports[-1])['refused'] == str(n), 'the refusal'
        )
        assert values(reports[-1])['last refusal'] == (
            f'{topic.name}: nothing subscribes to {torques}; start the simulator first'
        )


def test_a_report_tells_what_it_waits_for(graph: Graph, named: NamedChain) -> None:
    bench = Bench(graph, named)
    graph.until(lambda: bench.reports, 'a report')
    assert bench.reports[-1].message == 'waiting for the topic chain'
    bench.tell_chain()
    assert graph.next_report('edge_actuator').message == 'waiting for joint_states'
    bench.joints(named.chain.uniform_state(LEFT))
    report = graph.next_report('edge_actuator')
    assert (report.message, report.level) == ('ready', report.OK)
    bench.command(edge=EdgeCommand.FIRST, kind=LASTING, value=2e4)
    bench.next_torques()
    report = graph.next_report('edge_actuator')
    assert (report.message, report.level) == ('holding a pressure', report.OK)
    assert values(report)['commands carried out'] == '1'


def test_impulses_are_stamped(bench: Bench) -> None:
    bench.joints(bench.named.chain.uniform_state(LEFT))
    bench.nudge(1.0)
    bench.graph.until(lambda: bench.impulses, 'impulses')
    assert time_from_msg(bench.impulses[0].header.stamp) > 1_600_000_000 * 10**9
    assert bench.impulses[0].header.frame_id == 'linkage'
