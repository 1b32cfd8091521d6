# SPDX-License-Identifier: Apache-2.0
"""The actuator drives the zero mode of the current configuration, or says why it does not."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from graphs import Graph
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from soliton_linkage.actuation import Edge, edge_mode
from soliton_linkage.rigidity import mode_centre, mode_towards_last, zero_mode
from soliton_linkage.simulation import simulate
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.conversions import (
    Array,
    Frame,
    NamedChain,
    chain_to_msg,
    frame_to_msg,
    time_to_msg,
)
from soliton_linkage_nodes.edge_actuator import EdgeActuator

TORQUE_PER_PRESSURE = 1e-7
PRESSURE = 5e4


class Bench:
    """An actuator between a person and a chain that stands still where the test puts it."""

    def __init__(
        self, graph: Graph, named: NamedChain, parameters: dict[str, Any] | None = None
    ) -> None:
        self.graph = graph
        self.named = named
        given = {'state_timeout': 60.0, 'torque_per_pressure': TORQUE_PER_PRESSURE}
        self.node = graph.start(EdgeActuator, given | (parameters or {}))
        self.impulses = graph.hear(interfaces.ROTOR_IMPULSES)
        self.torques = graph.hear(interfaces.ROTOR_TORQUES)
        self.reports = graph.reports('edge_actuator')
        graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, Time()))
        self._joints = graph.speak(interfaces.JOINT_STATES)
        self._nudges = graph.speak(interfaces.NUDGE)
        self._commands = graph.speak(interfaces.EDGE_COMMAND)

    def show(self, angles: Array, stamp: float = 0.0) -> None:
        """Let the actuator see a configuration with a stamp [s]."""
        self.show_message(
            frame_to_msg(
                self.named, Frame(angles, None), 0 * angles, time_to_msg(int(stamp * 1e9))
            )
        )

    def show_message(self, message: JointState) -> None:
        self.reports.clear()
        self._joints.publish(message)
        self.heard('ready', 'holding a pressure')

    def nudge(self, speed: float) -> None:
        self._nudges.publish(Float64(data=speed))

    def command(self, **fields: Any) -> None:
        self._commands.publish(EdgeCommand(**fields))

    def kicked(self) -> Array:
        """Return the change of the rates that the next impulses give [rad/s]."""
        self.graph.until(lambda: self.impulses, 'impulses')
        message = self.impulses.pop(0)
        assert list(message.name) == list(self.named.joint_names)
        return np.array(message.impulse) / self.named.chain.moment_of_inertia

    def pushed(self) -> Array:
        """Return the next torques [N m]."""
        self.graph.until(lambda: self.torques, 'torques')
        return np.array(self.torques.pop(0).effort)

    def heard(self, *messages: str) -> None:
        self.graph.until(
            lambda: any(report.message in messages for report in self.reports), str(messages)
        )

    def refusal(self) -> str:
        """Return the next refusal that is reported."""

        def refused() -> list[str]:
            return [report.message for report in self.reports if ' refused: ' in report.message]

        self.graph.until(refused, 'a refusal')
        return refused()[0]


def wall_at(named: NamedChain, share: float) -> Array:
    """Angles with a wall on its way, after a share of a crossing."""
    chain = named.chain
    rest = chain.uniform_state(-1)
    rates = 10.0 * mode_towards_last(chain, rest)
    return simulate(chain, rest, rates, share * 0.9, 0.01).angles[-1]


@pytest.fixture
def bench(graph: Graph, named: NamedChain) -> Bench:
    return Bench(graph, named)


def test_a_nudge_kicks_the_zero_mode_with_its_speed(bench: Bench, named: NamedChain) -> None:
    rest = named.chain.uniform_state(-1)
    bench.show(rest)
    bench.nudge(3.0)
    kicked = bench.kicked()
    assert np.linalg.norm(kicked) == pytest.approx(3.0, rel=1e-12)
    np.testing.assert_allclose(kicked, 3.0 * mode_towards_last(named.chain, rest), atol=1e-12)
    bench.nudge(-3.0)
    np.testing.assert_allclose(bench.kicked(), -kicked, atol=1e-12)


@pytest.mark.parametrize('lean', [-1, 1])
def test_a_positive_nudge_carries_the_wall_away_from_its_edge(
    bench: Bench, named: NamedChain, lean: int
) -> None:
    chain = named.chain
    rest = chain.uniform_state(lean)
    bench.show(rest)
    bench.nudge(8.0)
    recording = simulate(chain, rest, bench.kicked(), 0.45, 0.01)
    places = [mode_centre(zero_mode(chain, angles)) for angles in recording.angles]
    from_edge = np.array(places) if lean < 0 else chain.number_of_rotors - 1 - np.array(places)
    assert from_edge[0] < 0.5
    assert from_edge[-1] > 2
    assert (np.diff(from_edge) > 0).all()


@pytest.mark.parametrize('share', [0.2, 0.5, 0.8])
def test_the_mode_is_that_of_the_latest_configuration(
    bench: Bench, named: NamedChain, share: float
) -> None:
    bench.show(named.chain.uniform_state(-1))
    angles = wall_at(named, share)
    bench.show(angles)
    bench.command(edge=EdgeCommand.NEAREST, kind=EdgeCommand.KICK, value=2.0)
    expected = 2.0 * edge_mode(named.chain, angles, Edge.NEAREST)
    np.testing.assert_allclose(bench.kicked(), expected, atol=1e-12)


def test_a_command_for_the_edge_without_the_mode_is_refused(
    bench: Bench, named: NamedChain
) -> None:
    bench.show(named.chain.uniform_state(-1))
    bench.command(edge=EdgeCommand.LAST, kind=EdgeCommand.KICK, value=2.0)
    assert 'the zero mode sits at rotor' in bench.refusal()
    bench.command(edge=EdgeCommand.FIRST, kind=EdgeCommand.KICK, value=2.0)
    assert np.linalg.norm(bench.kicked()) == pytest.approx(2.0)
    assert bench.impulses == []


def test_a_pressure_pushes_along_the_mode_and_follows_it(bench: Bench, named: NamedChain) -> None:
    chain = named.chain
    bench.show(chain.uniform_state(-1), 0.0)
    bench.command(edge=EdgeCommand.FIRST, kind=EdgeCommand.PRESSURE, value=PRESSURE)
    torque = PRESSURE * TORQUE_PER_PRESSURE
    for step, angles in enumerate(
        [chain.uniform_state(-1), *(wall_at(named, s) for s in (0.3, 0.8))]
    ):
        if step:
            bench.show(angles, 0.1 * step)
        expected = torque * mode_towards_last(chain, angles)
        np.testing.assert_allclose(bench.pushed(), expected, atol=1e-12)


def test_a_pressure_ends_after_its_duration_in_the_time_of_the_joints(
    bench: Bench, named: NamedChain
) -> None:
    rest = named.chain.uniform_state(-1)
    bench.show(rest, 1.0)
    bench.command(kind=EdgeCommand.PRESSURE, value=PRESSURE, duration=0.5)
    assert np.linalg.norm(bench.pushed()) > 0
    bench.show(rest, 1.499)
    assert np.linalg.norm(bench.pushed()) > 0
    bench.show(rest, 1.5)
    assert np.linalg.norm(bench.pushed()) == 0
    bench.show(rest, 1.6)
    assert bench.torques == []


def test_no_pressure_vents_the_actuator(bench: Bench, named: NamedChain) -> None:
    bench.show(named.chain.uniform_state(-1))
    bench.command(kind=EdgeCommand.PRESSURE, value=PRESSURE)
    assert np.linalg.norm(bench.pushed()) > 0
    bench.command(kind=EdgeCommand.PRESSURE, value=0.0)
    assert np.linalg.norm(bench.pushed()) == 0


@pytest.mark.parametrize(
    ('fields', 'complaint'),
    [
        ({'edge': 3}, 'edge = 3 must be one of 0, 1, 2'),
        ({'kind': 7}, 'kind = 7 must be one of 0, 1'),
        ({'value': math.nan}, 'speed = nan rad/s must be a finite number'),
        ({'value': 101.0}, 'speed = 101 rad/s must lie in the range -100 to 100 rad/s'),
        ({'value': 1.0, 'duration': 1.0}, 'duration of a kick = 1 s must be 0'),
        ({'kind': 1, 'value': math.inf}, 'pressure = inf Pa must be a finite number'),
        ({'kind': 1, 'value': 1e9}, 'pressure = 1e+09 Pa must lie in the range'),
        ({'kind': 1, 'duration': -1.0}, 'duration = -1 s must be'),
        ({'kind': 1, 'duration': math.nan}, 'duration = nan s must be'),
    ],
)
def test_a_command_that_cannot_be_is_refused_whole(
    bench: Bench, named: NamedChain, fields: dict[str, Any], complaint: str
) -> None:
    bench.show(named.chain.uniform_state(-1))
    bench.command(**fields)
    assert f'edge_command: {complaint}' in bench.refusal()
    bench.nudge(1.0)
    assert np.linalg.norm(bench.kicked()) == pytest.approx(1.0)
    assert bench.impulses == []
    assert bench.torques == []


def test_a_refused_pressure_leaves_the_one_that_is_held(bench: Bench, named: NamedChain) -> None:
    rest = named.chain.uniform_state(-1)
    bench.show(rest, 0.0)
    bench.command(kind=EdgeCommand.PRESSURE, value=PRESSURE)
    held = bench.pushed()
    bench.command(kind=EdgeCommand.PRESSURE, value=1e9)
    assert 'pressure = 1e+09 Pa' in bench.refusal()
    bench.show(rest, 0.1)
    np.testing.assert_array_equal(bench.pushed(), held)


def test_a_nudge_that_is_no_number_is_refused(bench: Bench, named: NamedChain) -> None:
    bench.show(named.chain.uniform_state(-1))
    bench.nudge(math.nan)
    assert 'nudge: speed = nan rad/s must be a finite number' in bench.refusal()


def test_without_joint_states_a_nudge_is_refused(bench: Bench) -> None:
    bench.heard('waiting for joint_states')
    bench.nudge(1.0)
    assert 'no fresh joint_states: none has come' in bench.refusal()
    assert bench.impulses == []


def test_with_old_joint_states_a_nudge_is_refused(graph: Graph, named: NamedChain) -> None:
    bench = Bench(graph, named, {'state_timeout': 0.001})
    rest = named.chain.uniform_state(-1)
    bench._joints.publish(frame_to_msg(named, Frame(rest, None), 0 * rest, Time()))
    graph.until(lambda: bench.node._latest is not None, 'the frame')
    bench.reports.clear()
    bench.heard('waiting for joint_states')
    bench.nudge(1.0)
    assert 'the limit is 0.001 s' in bench.refusal()
    assert bench.impulses == []


def test_without_a_simulator_a_nudge_is_refused(graph: Graph, named: NamedChain) -> None:
    graph.start(EdgeActuator)
    reports = graph.reports('edge_actuator')
    graph.speak(interfaces.NUDGE).publish(Float64(data=1.0))
    graph.until(lambda: any('refused' in report.message for report in reports), 'the refusal')
    assert any('nothing subscribes to rotor_impulses' in report.message for report in reports)


def test_nudges_are_for_the_edge_that_the_parameter_names(graph: Graph, named: NamedChain) -> None:
    bench = Bench(graph, named, {'nudge_edge': 'last'})
    bench.show(named.chain.uniform_state(-1))
    bench.nudge(1.0)
    assert 'name the first edge' in bench.refusal()
    bench.show(named.chain.uniform_state(1))
    bench.nudge(1.0)
    assert np.linalg.norm(bench.kicked()) == pytest.approx(1.0)
