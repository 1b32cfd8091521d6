# SPDX-License-Identifier: Apache-2.0
import errno
import math
import os
import termios
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graphs import Graph, values
from sensor_msgs.msg import JointState

from soliton_linkage.dynamics.motor_controllers import MotorControllers
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.feedback import Feedback
from soliton_linkage.microcontroller.frames import Protocol
from soliton_linkage.microcontroller.simulated_controller import (
    ControllerSettings,
    SimulatedController,
)
from soliton_linkage_nodes.programs.simulated_controller import PseudoTerminal
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg
from soliton_linkage_nodes.serial_encoders.node import SerialEncoders

ROTORS = 4
ANGLES = np.array([0.5, -1.0, 2.0, math.nan])
COUNT = math.tau / 4096
RESENT_AFTER = 5.0
"""Time after which an unpublished frame is sent again [s]."""


class Controller:
    """Controller at the other end of the serial line, which sends frames when the test asks.

    Its clock for commands stands still, so that only the node ends a torque.
    """

    def __init__(self, graph: Graph, link: Path, **settings: Any) -> None:
        self._graph, self._link = graph, link
        self.simulated = SimulatedController(ROTORS, settings=ControllerSettings(**settings))
        self.terminal: PseudoTerminal | None = PseudoTerminal(link)

    @property
    def line(self) -> PseudoTerminal:
        assert self.terminal is not None
        return self.terminal

    def start(self) -> None:
        self.line.write(self.simulated.start(time.monotonic()))

    def send(self, received: list[Any], number: int) -> None:
        """Send frames, each after the previous one was published, until so many are published.

        A frame that is not published for some seconds is sent again: on a busy machine, the node
        may reject a frame that arrives much sooner than the frames before it.
        """
        for _ in range(number):
            before, sent = len(received), -math.inf

            def published(count: int = before) -> bool:
                nonlocal sent
                if time.monotonic() - sent > RESENT_AFTER:
                    sent = time.monotonic()
                    self.line.write(self.simulated.measure(sent, ANGLES))
                return len(received) > count

            self._graph.until(published, 'a message')

    def torques(self) -> list[float]:
        self.simulated.receive(0.0, self.line.read())
        return [float(torque) for torque in self.simulated.torques(0.0)]

    def unplug(self) -> None:
        self.line.close()
        self.terminal = None

    def plug(self, started: bool = True) -> None:
        self.terminal = PseudoTerminal(self._link)
        if started:
            self.start()


@pytest.fixture
def plugged(graph, tmp_path):
    pytest.importorskip('serial', reason='needs pyserial: pip install pyserial')
    controllers: list[Controller] = []

    def plug(**settings: Any) -> Controller:
        controllers.append(Controller(graph, tmp_path / 'tty', **settings))
        return controllers[-1]

    yield plug
    for controller in controllers:
        if controller.terminal is not None:
            controller.terminal.close()


def begin(graph: Graph, controller: Controller, **parameters: Any) -> tuple[Any, list[JointState]]:
    """Return the node at the other end of a controller and its joint states."""
    given = {
        'port': controller.line.path,
        'chain_from': 'parameters',
        'chain.number_of_rotors': ROTORS,
        **parameters,
    }
    node = graph.start(SerialEncoders, given)
    received = graph.hear(interfaces.JOINT_STATES)
    publisher = next(each for each in node.publishers if each.topic_name == '/joint_states')
    graph.until(publisher.get_subscription_count, 'a subscriber of joint_states')
    controller.start()
    return node, received


@pytest.mark.parametrize('protocol', Protocol)
def test_readings_become_joint_states_with_the_stamp_of_their_measurement(
    graph, plugged, protocol
):
    controller = plugged(protocol=protocol.value)
    node, received = begin(graph, controller)
    chains = graph.hear(interfaces.CHAIN)
    before = time.time_ns()
    controller.send(received, 20)
    graph.until(lambda: chains, 'the topic chain')
    message = received[-1]
    assert list(message.name) == [f'rotor_{rotor}' for rotor in range(ROTORS)]
    np.testing.assert_allclose(message.position, ANGLES, atol=COUNT)
    stamps = [time_from_msg(each.header.stamp) for each in received]
    assert (np.diff(stamps) > 0).all()
    assert before - 10**9 < stamps[0] < stamps[-1] < time.time_ns()
    assert node.decoder.protocol is protocol
    assert len(chains[0].joint_names) == ROTORS


def test_noise_and_frames_of_another_chain_are_counted_and_not_published(graph, plugged):
    controller = plugged(protocol='text')
    node, received = begin(graph, controller)
    reports = graph.reports('serial_encoders')
    controller.send(received, 1)
    controller.line.write(b'\x93noise\n')
    for line in (b'counts 7 1 2 3 4 5 6', b'counts 8 1 2 3 4 5'):
        controller.line.write(line + b'\n')
    graph.until(lambda: node.decoder.corrupted == 3, 'the rejected lines')
    controller.line.write(
        SimulatedController(3, settings=ControllerSettings('text')).measure(0.0, np.zeros(3))
    )
    graph.until(lambda: node.diagnostics.rejected == 1, 'a frame of three rotors')
    controller.send(received, 5)
    assert all(len(message.position) == ROTORS for message in received)
    graph.until(
        lambda: reports and values(reports[-1])['rejected'] == '1', 'the counts in the diagnostics'
    )
    figures = values(reports[-1])
    assert figures['frames corrupted'] == '3'
    rejection = 'frame: it has 3 readings for a chain of 4 rotors'
    assert figures['last rejection'].startswith(rejection)


def test_a_reset_and_a_lost_port_are_logged_and_publishing_continues(graph, plugged, said):
    controller = plugged()
    node, received = begin(graph, controller)
    controller.send(received, 5)
    controller.start()
    controller.send(received, 5)
    assert 'the clock of the controller restarted' in said()
    controller.unplug()
    graph.until(lambda: f'{node.settings.port} was lost' in said(), 'the log of the lost port')
    controller.plug()
    graph.until(
        lambda: f'{node.settings.port} is open again' in said(), 'the log of the reopened port'
    )
    controller.send(received, 5)
    stamps = [time_from_msg(each.header.stamp) for each in received]
    assert (np.diff(stamps) > 0).all()
    assert node.stream.lost == 0
    assert node.stream.clock.restarts == 2


def test_frames_sent_while_the_port_changes_behind_a_link_are_lost(graph, plugged, said):
    controller = plugged()
    node, received = begin(graph, controller)
    while math.isnan(node.stream.clock.scatter):
        controller.send(received, 1)
    controller.unplug()
    for _ in range(3):
        controller.simulated.measure(time.monotonic(), ANGLES)
    controller.plug(started=False)
    graph.until(lambda: 'is open again' in said(), 'the log of the reopened port')
    controller.send(received, 5)
    assert (node.stream.lost, node.stream.clock.restarts) == (3, 0)


@pytest.mark.parametrize('pressure', [False, True])
def test_torques_act_on_the_valves_until_the_command_timeout(graph, plugged, pressure):
    controller = plugged(torque_per_pressure=1e-6)
    scale = {'valves.torque_per_pressure': [1e-6]} if pressure else {}
    node, received = begin(graph, controller, **scale)
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    delivered = graph.hear(interfaces.DELIVERED_IMPULSES)
    controller.send(received, 1)
    wanted = pytest.approx([0.0, 0.0, 0.05, 0.0])

    def acts() -> bool:
        torques.publish(JointState(name=['rotor_2'], effort=[0.05]))
        return controller.torques() == wanted

    graph.until(acts, 'a torque')
    graph.until(lambda: controller.torques() == [0.0] * ROTORS, 'the timeout')
    assert node.valves.closed
    controller.send(received, 1)
    graph.until(lambda: delivered, 'the delivered impulse')
    impulse = delivered[0].impulse[2]
    assert list(delivered[0].impulse) == [0, 0, impulse, 0]
    assert impulse > 0
    assert delivered[0].header == received[-1].header


def test_feedback_is_sent_after_each_frame_and_is_no_impulse(graph, plugged):
    controller = plugged()
    gains = {'chain.feedback.left_angle': 0.01, 'chain.feedback.right_angle': -0.02}
    _, received = begin(graph, controller, **gains)
    delivered = graph.hear(interfaces.DELIVERED_IMPULSES)
    law = Feedback(left_angle=0.01, right_angle=-0.02)
    motors = MotorControllers(Chain(number_of_rotors=ROTORS, feedback=law))
    expected = [motors.torques(time, ANGLES) for time in (0.0, 1.0)][1]
    assert np.count_nonzero(expected) == 2
    controller.send(received, 2)
    graph.until(lambda: any(controller.torques()), 'the torques of the feedback')
    np.testing.assert_allclose(controller.torques(), expected, atol=0.04 * COUNT)
    controller.send(received, 1)
    assert not delivered


def test_a_node_that_is_deactivated_closes_the_valves(graph, plugged):
    controller = plugged()
    node, received = begin(graph, controller, **{'valves.command_timeout': 3600.0})
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    controller.send(received, 1)
    torques.publish(JointState(name=['rotor_0'], effort=[0.05]))
    graph.until(lambda: any(controller.torques()), 'a torque')
    node.trigger_deactivate()
    graph.until(lambda: not any(controller.torques()), 'closed valves')


def test_a_message_with_an_invalid_torque_is_rejected_as_a_whole(graph, plugged):
    controller = plugged()
    node, received = begin(graph, controller)
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    controller.send(received, 1)
    for number, (name, effort, reason) in enumerate(
        (
            ('rotor_9', 0.01, "joint 'rotor_9'"),
            ('rotor_0', 1.0, 'must lie in the range -0.1 to 0.1'),
            ('rotor_0', math.nan, 'must be a finite number'),
        ),
        start=1,
    ):
        torques.publish(JointState(name=['rotor_1', name], effort=[0.01, effort]))
        graph.until(lambda n=number: node.diagnostics.rejected == n, 'the rejection')
        assert reason in values(graph.next_report('serial_encoders'))['last rejection']
    assert node.valves.commands == 0


def test_an_invalid_parameter_is_reported_in_one_line_at_the_start(graph):
    pytest.importorskip('serial', reason='needs pyserial: pip install pyserial')
    chain = {'chain_from': 'parameters', 'chain.number_of_rotors': ROTORS}
    wrong: list[tuple[dict[str, Any], str]] = [
        ({}, r'parameter port is empty; set it: this machine has'),
        ({'port': '/dev/no_such_port'}, r"'/dev/no_such_port' cannot be opened: No such file"),
        ({'port': 'x', 'encoders.signs': [1.0]}, 'signs has 1 values for a chain of 4 rotors'),
        ({'port': 'x', 'valves.hold': 0.001}, r'hold = 0.001 s is shorter'),
        (
            {'port': 'x', 'chain.feedback.angle': 1.0, 'valves.torque_limit': 0.01},
            r'feedback.limit = 0.1 N m of the chain exceeds valves.torque_limit = 0.01 N m',
        ),
    ]
    for parameters, reason in wrong:
        with pytest.raises(ValueError, match=reason) as raised:
            graph.start(SerialEncoders, {**chain, **parameters})
        assert '\n' not in str(raised.value)


def test_a_denied_port_names_the_group_that_may_open_it(graph, monkeypatch):
    serial = pytest.importorskip('serial', reason='needs pyserial: pip install pyserial')

    def denied(*_args: Any, **_options: Any) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(serial, 'Serial', denied)
    given = {'port': '/dev/null', 'chain_from': 'parameters', 'chain.number_of_rotors': ROTORS}
    with pytest.raises(ValueError, match=r'Permission denied; run: sudo usermod -aG dialout \$US'):
        graph.start(SerialEncoders, given)


@pytest.mark.parametrize('hang_up', [True, False])
def test_hang_up_decides_whether_closing_the_port_releases_dtr(graph, plugged, hang_up):
    controller = plugged()
    with Path(controller.line.path).open('rb', buffering=0) as port:
        attributes = termios.tcgetattr(port)
        attributes[2] |= termios.HUPCL
        termios.tcsetattr(port, termios.TCSANOW, attributes)
        begin(graph, controller, hang_up=hang_up)
        assert bool(termios.tcgetattr(port)[2] & termios.HUPCL) is hang_up


@pytest.mark.parametrize(('rate', 'warned'), [(115_200, False), (250_000, True)])
def test_a_baud_rate_that_is_not_standard_causes_a_warning(graph, plugged, said, rate, warned):
    begin(graph, plugged(), baud_rate=rate)
    assert (f'baud_rate = {rate} is not a standard rate' in said()) is warned
