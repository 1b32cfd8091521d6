# SPDX-License-Identifier: Apache-2.0
"""What the simulator publishes is the simulation of the physics at its stamps, bit for bit."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from graphs import Graph, values
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import State
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.messages.conversions import chain_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg
from soliton_linkage_nodes.simulator.node import Simulator

pytestmark = pytest.mark.usefixtures('often')

ROTORS = 8
RATE = 300.0  # a period that is no whole number of nanoseconds
GIVEN = {'chain.number_of_rotors': ROTORS, 'publish_rate': RATE}
CHAIN = Chain(number_of_rotors=ROTORS)
NAMES = [f'rotor_{rotor}' for rotor in range(ROTORS)]
KICK = 10.0 * CHAIN.moment_of_inertia * edge_mode(CHAIN, CHAIN.uniform_state(-1), Edge.FIRST)
TORQUES = np.linspace(-1e-3, 2e-3, ROTORS)

Act = Callable[[ElasticSimulation], None]


def kick(simulation: ElasticSimulation) -> None:
    simulation.kick(KICK)


def hold(simulation: ElasticSimulation) -> None:
    simulation.hold(TORQUES)


def let_go(simulation: ElasticSimulation) -> None:
    simulation.hold(np.zeros(ROTORS))


def kick_message() -> RotorImpulses:
    return RotorImpulses(name=NAMES, impulse=list(KICK))


def torque_message() -> JointState:
    return JointState(name=NAMES, effort=list(TORQUES))


class Stream:
    """The frames that a simulator publishes, and the same chain simulated without it."""

    def __init__(self, graph: Graph, parameters: dict[str, Any] | None = None) -> None:
        self.graph = graph
        self.frames: list[JointState] = graph.hear(interfaces.JOINT_STATES)
        chains = graph.hear(interfaces.CHAIN)
        self.node = graph.start(Simulator, {**GIVEN, **(parameters or {})})
        graph.until(lambda: chains and self.frames, 'the chain and a frame')
        self.rate = self.node.settings.publish_rate
        self.chain = chain_from_msg(chains[0]).chain
        self._epoch = time_from_msg(chains[0].header.stamp)

    def grow(self, frames: int) -> None:
        """Wait for more frames than are published now, of which some may be on their way."""
        target = self.node.control.status.frames + frames
        self.graph.until(lambda: self.number(self.frames[-1]) >= target, f'{frames} frames')

    def number(self, frame: JointState) -> int:
        """Return which frame it is; its stamp is exactly that many periods after the chain's."""
        since = time_from_msg(frame.header.stamp) - self._epoch
        number = round(since * self.rate / 1e9)
        assert since == round(number * 10**9 / self.rate)
        return number

    def explain(self, commands: Sequence[Act], lean: int = -1) -> list[int]:
        """Assert that the frames are those of a simulation with these commands in this order.

        The numbers of the frames at which they took effect are returned. Of kicks the frame
        itself shows it, of torques the next one.
        """
        took_effect: list[int] = []
        while (unexplained := self._first_unlike(commands, took_effect, lean)) is not None:
            assert len(took_effect) < len(commands), f'frame {unexplained} is like no simulation'
            at = unexplained - (commands[len(took_effect)] is not kick)
            assert at not in took_effect
            took_effect.append(at)
        assert len(took_effect) == len(commands)
        return took_effect

    def _first_unlike(
        self, commands: Sequence[Act], took_effect: list[int], lean: int
    ) -> int | None:
        due = dict(zip(took_effect, commands, strict=False))
        twin = ElasticSimulation(
            self.chain,
            self.chain.uniform_state(lean),
            period=1 / self.rate,
            tolerance=self.node.settings.tolerance,
        )
        numbers = [self.number(frame) for frame in self.frames]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        for number in range(numbers[-1] + 1):
            if number in due:
                due[number](twin)
            if number >= numbers[0]:
                frame = self.frames[number - numbers[0]]
                torques = self.chain.spring_torques(twin.angles)
                seen = (frame.position, frame.velocity, frame.effort)
                if not all(map(np.array_equal, seen, (twin.angles, twin.rates, torques))):
                    return number
            twin.advance()
        return None


def test_a_chain_at_rest_is_published_as_it_is(graph: Graph) -> None:
    stream = Stream(graph)
    stream.grow(100)
    stream.explain([])
    assert stream.frames[0].name == NAMES
    assert stream.frames[0].header.frame_id == 'linkage'


@pytest.mark.parametrize(('rate', 'frames'), [(1.0, 2), (1999.99, 500), (2000.0, 500)])
def test_stamps_are_step_count_times_period_at_any_rate(
    graph: Graph, rate: float, frames: int
) -> None:
    stream = Stream(graph, {'publish_rate': rate})
    stream.grow(frames)
    stream.explain([])


@pytest.mark.parametrize(
    'parameters',
    [
        {},
        {'publish_rate': 1.0e3, 'tolerance': 1e-6},
        {'chain.rotor_length': 0.2, 'chain.rest_angle': 1.18, 'chain.number_of_rotors': ROTORS},
        {'initial_state': 'right_leaning'},
    ],
)
def test_kicks_between_frames_act_at_the_instant_of_a_frame(
    graph: Graph, parameters: dict[str, Any]
) -> None:
    stream = Stream(graph, parameters)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    for _ in range(3):
        impulses.publish(kick_message())
        stream.grow(70)
    lean = 1 if parameters.get('initial_state') == 'right_leaning' else -1
    assert len(stream.explain([kick] * 3, lean)) == 3


def test_torques_act_until_the_next_message(graph: Graph) -> None:
    stream = Stream(graph, {'command_timeout': 0.0})
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    torques.publish(torque_message())
    stream.grow(200)
    last = stream.number(stream.frames[-1])
    torques.publish(JointState(name=NAMES, effort=[0.0] * ROTORS))
    stream.grow(50)
    began, ended = stream.explain([hold, let_go])
    assert began < last <= ended


def test_torques_act_for_the_command_timeout_where_no_message_follows(graph: Graph) -> None:
    stream = Stream(graph, {'command_timeout': 0.1})
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    torques.publish(torque_message())
    stream.grow(60)
    began, ended = stream.explain([hold, let_go])
    assert ended - began == round(0.1 * RATE)


def test_the_same_commands_give_the_same_trajectory(graph: Graph) -> None:
    trajectories = []
    for _ in range(2):
        stream = Stream(graph)
        impulses = graph.speak(interfaces.ROTOR_IMPULSES)
        control = stream.node.control
        control.pause(True)
        control.reset(State(CHAIN.uniform_state(-1), np.zeros(ROTORS)))
        kicked = control.status.frames
        impulses.publish(kick_message())
        graph.until(lambda control=control: control.status.pending, 'the kick')
        control.pause(False)
        stream.grow(120)
        first = kicked - stream.number(stream.frames[0])
        trajectories.append([list(f.position) for f in stream.frames[first : first + 100]])
        graph.user.destroy_publisher(impulses)
        graph.stop(stream.node)
    assert trajectories[0] == trajectories[1]


@pytest.mark.parametrize(
    ('topic', 'wrong', 'complaint'),
    [
        (
            interfaces.ROTOR_IMPULSES,
            RotorImpulses(name=['rotor_0', 'rotor_8'], impulse=[1e-3, 1e-3]),
            "'rotor_8', which is none of 'rotor_0' to 'rotor_7'",
        ),
        (
            interfaces.ROTOR_IMPULSES,
            RotorImpulses(name=['rotor_0', 'rotor_0'], impulse=[1e-3, 1e-3]),
            "'rotor_0' twice",
        ),
        (
            interfaces.ROTOR_IMPULSES,
            RotorImpulses(name=['rotor_0', 'rotor_1'], impulse=[1e-3]),
            '1 values for 2 names',
        ),
        (
            interfaces.ROTOR_IMPULSES,
            RotorImpulses(name=['rotor_0', 'rotor_1'], impulse=[1e-3, math.nan]),
            'rotor_1 = nan must be a finite number',
        ),
        (
            interfaces.ROTOR_IMPULSES,
            RotorImpulses(name=['rotor_0', 'rotor_1'], impulse=[1e-3, -0.2]),
            'rotor_1 = -0.2 must lie in the range -0.1 to 0.1',
        ),
        (
            interfaces.ROTOR_TORQUES,
            JointState(name=['rotor_0', 'rotor_1'], effort=[1e-3, math.inf]),
            'rotor_1 = inf must be a finite number',
        ),
        (
            interfaces.ROTOR_TORQUES,
            JointState(name=['rotor_0', 'rotor_1'], effort=[1e-3, 10.5]),
            'rotor_1 = 10.5 must lie in the range -10 to 10',
        ),
        (
            interfaces.ROTOR_TORQUES,
            JointState(name=NAMES, position=[1.0] * ROTORS),
            '0 values for 8 names',
        ),
    ],
)
def test_a_wrong_command_is_refused_whole_and_the_next_right_one_acts(
    graph: Graph, topic: interfaces.Topic, wrong: Any, complaint: str
) -> None:
    stream = Stream(graph)
    reports = graph.reports('simulator')
    commands = graph.speak(topic)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    commands.publish(wrong)
    graph.until(lambda: reports and values(reports[-1])['refused'] == '1', 'the refusal')
    assert complaint in values(reports[-1])['last refusal']
    assert complaint in reports[-1].message
    assert reports[-1].level == reports[-1].WARN
    impulses.publish(kick_message())
    stream.grow(60)
    stream.explain([kick])


def test_a_command_of_nothing_changes_nothing(graph: Graph) -> None:
    stream = Stream(graph)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    for message in (kick_message(), RotorImpulses()):
        impulses.publish(message)
        stream.grow(60)
    stream.explain([kick])


def pause(graph: Graph, paused: bool) -> Any:
    return graph.call(SetBool, 'simulator/pause', data=paused)


def step(graph: Graph, periods: int) -> Any:
    return graph.call(Step, 'simulator/step', periods=periods)


def reset(graph: Graph, state: int = Reset.Request.INITIAL) -> Any:
    return graph.call(Reset, 'simulator/reset', state=state)


def settled(stream: Stream) -> int:
    """Return the number of frames once everything that was published has come."""
    last = stream.node.control.status.frames
    stream.graph.until(lambda: stream.number(stream.frames[-1]) == last - 1, 'the last frame')
    return len(stream.frames)


def test_a_pause_stops_time_at_once_and_can_be_repeated(graph: Graph) -> None:
    stream = Stream(graph)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    impulses.publish(kick_message())
    stream.grow(60)
    for _ in range(2):
        response = pause(graph, True)
        assert (response.success, response.message) == (True, 'paused')
    paused_at = settled(stream)
    report = graph.next_report('simulator')
    assert (report.message, report.level) == ('paused', report.OK)
    assert len(stream.frames) == paused_at
    for _ in range(2):
        response = pause(graph, False)
        assert (response.success, response.message) == (True, 'running')
    stream.grow(60)
    stream.explain([kick])


def test_steps_are_taken_while_paused_and_answered_when_done(graph: Graph) -> None:
    stream = Stream(graph)
    pause(graph, True)
    before = settled(stream)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    impulses.publish(kick_message())
    graph.until(lambda: stream.node.control.status.pending, 'the kick')
    response = step(graph, 25)
    assert response.success
    reached = stream.number(stream.frames[before - 1]) + 1 + 25
    assert response.message == f'reached t = {reached / RATE:g} s'
    assert settled(stream) == before + 25
    (kicked,) = stream.explain([kick])
    assert kicked == stream.number(stream.frames[before])


def test_a_step_while_running_or_of_nothing_or_too_far_is_refused(graph: Graph) -> None:
    stream = Stream(graph)
    response = step(graph, 5)
    assert (response.success, response.message) == (
        False,
        'the simulation is running; pause it before stepping',
    )
    pause(graph, True)
    before = settled(stream)
    for periods in (0, 1001, 2**32 - 1):
        response = step(graph, periods)
        assert not response.success
        assert f'periods = {periods} must lie in the range 1 to 1000' in response.message
    assert step(graph, 1).success
    assert settled(stream) == before + 1
    stream.explain([])


@pytest.mark.parametrize(
    ('state', 'lean', 'message'),
    [
        (Reset.Request.INITIAL, -1, 'in the initial state'),
        (Reset.Request.LEFT_LEANING, -1, 'at rest, left-leaning'),
        (Reset.Request.RIGHT_LEANING, 1, 'at rest, right-leaning'),
    ],
)
def test_a_reset_forgets_commands_but_not_the_time(
    graph: Graph, state: int, lean: int, message: str
) -> None:
    stream = Stream(graph)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    torques.publish(torque_message())
    stream.grow(30)
    pause(graph, True)
    impulses.publish(kick_message())
    graph.until(lambda: stream.node.control.status.pending, 'the kick')
    response = reset(graph, state)
    assert (response.success, response.message) == (True, message)
    before = settled(stream)
    assert step(graph, 200).success
    settled(stream)
    numbers = [stream.number(frame) for frame in stream.frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    twin = ElasticSimulation(CHAIN, CHAIN.uniform_state(lean), period=1 / RATE)
    for frame in stream.frames[before:]:
        np.testing.assert_array_equal(frame.position, twin.angles)
        np.testing.assert_array_equal(frame.velocity, twin.rates)
        twin.advance()


def test_a_reset_to_an_unknown_state_changes_nothing(graph: Graph) -> None:
    stream = Stream(graph)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    impulses.publish(kick_message())
    stream.grow(30)
    response = reset(graph, 7)
    assert (response.success, response.message) == (False, 'state = 7 must be one of 0 to 4')
    stream.grow(30)
    stream.explain([kick])


@pytest.mark.parametrize('stepping', [False, True])
def test_a_motion_too_fast_to_compute_pauses_until_a_reset(graph: Graph, stepping: bool) -> None:
    stream = Stream(graph, {'impulse_limit': 1e308})
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    if stepping:
        pause(graph, True)
    impulses.publish(RotorImpulses(name=['rotor_3'], impulse=[1e9 if stepping else 1e308]))
    if stepping:
        graph.until(lambda: stream.node.control.status.pending, 'the kick')
        response = step(graph, 10)
        assert not response.success
        assert 'call ~/reset to go on' in response.message
    graph.until(lambda: stream.node.control.status.failure, 'the failure')
    frames = settled(stream)
    report = graph.next_report('simulator')
    assert report.level == report.WARN
    assert report.message.startswith('paused, ')
    for response in (pause(graph, False), step(graph, 1)):
        assert not response.success
        assert 'call ~/reset to go on' in response.message
    assert len(stream.frames) == frames
    assert reset(graph).success
    if stepping:
        pause(graph, False)
    stream.grow(30)
    numbers = [stream.number(frame) for frame in stream.frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    for frame in stream.frames[frames:]:
        # Rounding of the springs' lengths moves a chain at rest by no more.
        np.testing.assert_allclose(frame.velocity, 0, atol=1e-10)


def test_a_report_holds_rate_lateness_and_energy(graph: Graph) -> None:
    stream = Stream(graph)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    impulses.publish(kick_message())
    stream.grow(30)
    graph.next_report('simulator')
    figures = values(graph.next_report('simulator'))
    assert figures['motion'] == 'flipper'
    rate, factor = float(figures['publish rate [Hz]']), float(figures['real-time factor'])
    assert factor == pytest.approx(rate / RATE, rel=1e-4)
    assert rate > 0
    energy = CHAIN.kinetic_energy(KICK / CHAIN.moment_of_inertia)
    assert float(figures['energy [J]']) == pytest.approx(energy, rel=1e-5)
    assert 0 < abs(float(figures['energy drift'])) < 1e-8
    assert float(figures['largest lateness [s]']) > 0
    assert int(figures['frames']) >= len(stream.frames)


def test_missed_deadlines_are_counted_and_warned_of(graph: Graph) -> None:
    graph.start(Simulator, {'chain.number_of_rotors': 20_000, 'publish_rate': 2000.0})
    reports = graph.reports('simulator')

    def late() -> list[Any]:
        end = ' deadlines missed in the last second'
        return [report for report in reports if report.message.endswith(end)]

    graph.until(late, 'missed deadlines')
    figures = values(late()[0])
    assert late()[0].level == DiagnosticStatus.WARN
    assert int(figures['missed deadlines']) > 0
    assert float(figures['real-time factor']) < 1


def test_the_chain_is_there_for_late_joiners(graph: Graph) -> None:
    graph.start(Simulator, GIVEN)
    chains = graph.hear(interfaces.CHAIN)
    graph.until(lambda: chains, 'the chain')
    assert chain_from_msg(chains[0]).chain == CHAIN
    assert list(chains[0].joint_names) == NAMES


def test_the_clock_shows_the_stamp_of_each_frame_where_it_is_asked_for(graph: Graph) -> None:
    clocks = graph.hear(interfaces.CLOCK)
    stream = Stream(graph, {'publish_clock': True})
    stream.grow(50)
    graph.until(lambda: len(clocks) >= 50, 'the clock')
    stamps = {time_from_msg(frame.header.stamp) for frame in stream.frames}
    shown = [time_from_msg(clock.clock) for clock in clocks]
    assert shown == sorted(set(shown))
    assert len(stamps & set(shown)) >= 40


def test_without_being_asked_nobody_publishes_a_clock(graph: Graph) -> None:
    Stream(graph).grow(5)
    assert graph.user.count_publishers('/clock') == 0


@pytest.mark.parametrize(
    ('name', 'value', 'complaint'),
    [
        ('publish_rate', 10_001.0, 'must lie in the range 1 to 10000 Hz'),
        ('publish_rate', 0.5, 'must lie in the range 1 to 10000 Hz'),
        ('chain.number_of_rotors', 1, 'must lie in the range 2 to 100000'),
        ('initial_state', 'upright', "must be one of 'left_leaning', 'right_leaning'"),
        ('publsh_rate', 500.0, "is unknown; did you mean 'publish_rate'?"),
    ],
)
def test_a_wrong_parameter_stops_it(graph: Graph, name: str, value: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=r'^parameter .* of simulator .*') as refusal:
        graph.start(Simulator, {name: value})
    assert complaint in str(refusal.value)


def test_time_begins_once_there_are_as_many_subscribers_as_asked_for(graph: Graph) -> None:
    first = graph.hear(interfaces.JOINT_STATES)
    chains = graph.hear(interfaces.CHAIN)
    reports = graph.reports('simulator')
    graph.start(Simulator, {**GIVEN, 'subscribers': 2})
    waiting = 'waiting for 2 subscribers of joint_states, there are 1'
    graph.until(lambda: any(r.message == waiting for r in reports), 'a warning')
    assert first == []
    second = graph.hear(interfaces.JOINT_STATES)
    graph.until(lambda: len(first) > 5 and len(second) > 5, 'frames')
    assert first[0] == second[0]
    assert first[0].header.stamp == chains[0].header.stamp
