# SPDX-License-Identifier: Apache-2.0
"""The simulator publishes the simulation of the physics at its stamps, bit for bit."""

import signal
import time
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from graphs import values
from programs import Program
from sensor_msgs.msg import JointState
from simulated_streams import (
    CHAIN,
    GIVEN,
    KICK,
    NAMES,
    RATE,
    Stream,
    hold,
    kick,
    let_go,
    torque_message,
)
from std_msgs.msg import Header

from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.messages.conversions import chain_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg
from soliton_linkage_nodes.simulator.node import Simulator


@pytest.mark.parametrize(('rate', 'frames'), [(1.0, 2), (1999.99, 500)])
def test_stamps_are_step_count_times_period_at_any_rate(graph, rate, frames):
    stream = Stream(graph, {'publish_rate': rate})
    stream.grow(frames)
    stream.explain([])
    assert stream.frames[0].name == NAMES
    assert stream.frames[0].header.frame_id == 'linkage'
    assert graph.user.count_publishers('/clock') == 0


@pytest.mark.parametrize(
    'parameters',
    [
        {'publish_rate': 1.0e3, 'tolerance': 1e-6},
        {'chain.rotor_length': 0.2, 'chain.rest_angle': 1.18, 'initial_state': 'right_leaning'},
    ],
)
def test_kicks_between_frames_act_at_the_instant_of_a_frame(graph, parameters):
    stream = Stream(graph, parameters)
    for _ in range(3):
        stream.kick()
        stream.grow(70)
    lean = 1 if parameters.get('initial_state') == 'right_leaning' else -1
    assert len(stream.explain([kick] * 3, lean)) == 3


def test_torques_act_for_the_command_timeout_without_another_message(graph):
    stream = Stream(graph, {'command_timeout': 0.1})
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    torques.publish(torque_message())
    stream.wait_for_motion()
    stream.grow(60)
    began, ended = stream.explain([hold, let_go])
    assert ended - began == round(0.1 * RATE)


def test_a_command_of_nothing_changes_nothing(graph):
    stream = Stream(graph)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    stream.kick()
    impulses.publish(RotorImpulses())
    stream.grow(60)
    stream.explain([kick])


def test_a_report_holds_rate_lateness_and_energy(graph):
    stream = Stream(graph)
    stream.kick()
    stream.grow(30)
    heard = len(stream.frames)
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
    assert int(figures['frames']) >= heard


def test_missed_deadlines_are_counted_and_warned_of(graph):
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


def test_the_chain_is_there_for_late_joiners(graph):
    graph.start(Simulator, GIVEN)
    chains = graph.hear(interfaces.CHAIN)
    graph.until(lambda: chains, 'the chain')
    assert chain_from_msg(chains[0]).chain == CHAIN
    assert list(chains[0].joint_names) == NAMES


def test_the_clock_has_the_stamp_of_each_frame_with_publish_clock(graph):
    clocks = graph.hear(interfaces.CLOCK)
    stream = Stream(graph, {'publish_clock': True})
    stream.grow(50)
    graph.until(lambda: len(clocks) >= 50, 'the clock')
    stamps = {time_from_msg(frame.header.stamp) for frame in stream.frames}
    shown = [time_from_msg(clock.clock) for clock in clocks]
    assert shown == sorted(set(shown))
    assert len(stamps & set(shown)) >= 40


def test_time_begins_with_the_required_number_of_subscribers(graph):
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


def test_it_ends_once_its_last_frames_are_acknowledged_or_cannot_be(graph, tmp_path):
    stream = Stream(graph)
    arguments = ['--ros-args', '-p', f'output:={tmp_path / "run"}']
    recorder = Program('bag_recorder', arguments, graph.domain, tmp_path / 'log')
    try:
        graph.until(lambda: stream.node.frames.subscribers == 2, 'the recorder')
        recorder.process.send_signal(signal.SIGSTOP)
        stream.grow(10)
        begin = time.monotonic()
        graph.stop(stream.node)
        assert time.monotonic() - begin >= interfaces.ACKNOWLEDGEMENT_LIMIT
    finally:
        recorder.process.kill()
        recorder.process.wait()


@pytest.mark.parametrize(('seconds', 'when'), [(1, 'past'), (2**31 - 1, 'future')])
def test_commands_of_another_time_are_rejected(graph, seconds, when):
    stream = Stream(graph)
    header = Header(stamp=Time(sec=seconds))
    graph.speak(interfaces.ROTOR_TORQUES).publish(
        JointState(header=header, name=['rotor_3'], effort=[1e-3])
    )
    graph.speak(interfaces.ROTOR_IMPULSES).publish(
        RotorImpulses(header=header, name=['rotor_3'], impulse=[1e-6])
    )
    graph.until(lambda: stream.node.diagnostics.rejected == 2, 'two refusals')
    last = values(graph.next_report('simulator'))['last rejection']
    assert f'{when}, the limit is 10 s; use the current time or 0, or raise stamp_' in last
