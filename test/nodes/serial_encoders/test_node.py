# SPDX-License-Identifier: Apache-2.0
"""A controller on a pseudo-terminal, in place of the simulator."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graphs import Graph, values
from sensor_msgs.msg import JointState

from soliton_linkage.microcontroller.frames import Protocol
from soliton_linkage.microcontroller.simulated_controller import (
    ControllerSettings,
    SimulatedController,
)
from soliton_linkage_nodes.programs.simulated_controller import PseudoTerminal
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg, time_to_msg
from soliton_linkage_nodes.serial_encoders.node import SerialEncoders
from soliton_linkage_nodes.serial_encoders.valves import ValveParameters

ROTORS = 4
ANGLES = np.array([0.5, -1.0, 2.0, math.nan])
COUNT = math.tau / 4096
PATIENT = 60.0


class Controller:
    """A controller at the other end of the line, which the test lets speak."""

    def __init__(self, graph: Graph, link: Path, **settings: Any) -> None:
        self._graph, self._link = graph, link
        self.simulated = SimulatedController(ROTORS, settings=ControllerSettings(**settings))
        self.terminal: PseudoTerminal | None = PseudoTerminal(link)

    @property
    def line(self) -> PseudoTerminal:
        assert self.terminal is not None
        return self.terminal

    def start(self) -> None:
        """Begin, or begin anew as after a reset."""
        self.line.write(self.simulated.start(time.monotonic()))

    def say(self, angles: np.ndarray = ANGLES) -> None:
        self.line.write(self.simulated.measure(time.monotonic(), angles))

    def say_and_hear(self, heard: list[Any], number: int) -> None:
        """Say so many frames, each once the one before was published."""
        for _ in range(number):
            before = len(heard)
            self.say()
            self._graph.until(lambda count=before: len(heard) > count, 'a message')

    def torques(self) -> list[float]:
        """What the valves do now."""
        now = time.monotonic()
        self.simulated.receive(now, self.line.read())
        return [float(torque) for torque in self.simulated.torques(now)]

    def unplug(self) -> None:
        self.line.close()
        self.terminal = None

    def plug(self) -> None:
        self.terminal = PseudoTerminal(self._link)
        self.start()


@pytest.fixture
def plugged(graph: Graph, tmp_path: Path) -> Iterator[Callable[..., Controller]]:
    pytest.importorskip('serial', reason='serial ports need pyserial')
    controllers: list[Controller] = []

    def plug(**settings: Any) -> Controller:
        controllers.append(Controller(graph, tmp_path / 'tty', **settings))
        return controllers[-1]

    yield plug
    for controller in controllers:
        if controller.terminal is not None:
            controller.terminal.close()


def begin(graph: Graph, controller: Controller, **parameters: Any) -> tuple[Any, list[JointState]]:
    """Return the node at the other end of a controller, and what it publishes."""
    given = {
        'port': controller.line.path,
        'chain_from': 'parameters',
        'chain.number_of_rotors': ROTORS,
        **parameters,
    }
    node = graph.start(SerialEncoders, given)
    heard = graph.hear(interfaces.JOINT_STATES)
    publisher = next(each for each in node.publishers if each.topic_name == '/joint_states')
    graph.until(publisher.get_subscription_count, 'a subscriber of joint_states')
    controller.start()
    return node, heard


@pytest.mark.parametrize('protocol', Protocol)
def test_readings_become_joint_states_with_the_stamp_of_their_measurement(
    graph: Graph, plugged: Callable[..., Controller], protocol: Protocol
) -> None:
    controller = plugged(protocol=protocol.value)
    node, heard = begin(graph, controller)
    chains = graph.hear(interfaces.CHAIN)
    before = time.time_ns()
    controller.say_and_hear(heard, 20)
    graph.until(lambda: chains, 'the chain that a bag is a recording of')
    message = heard[-1]
    assert list(message.name) == [f'rotor_{rotor}' for rotor in range(ROTORS)]
    np.testing.assert_allclose(message.position, ANGLES, atol=COUNT)
    stamps = [time_from_msg(each.header.stamp) for each in heard]
    assert (np.diff(stamps) > 0).all()
    assert before - 10**6 < stamps[0] < stamps[-1] < time.time_ns()
    assert node.decoder.protocol is protocol
    assert len(chains[0].joint_names) == ROTORS


def test_noise_and_frames_of_another_chain_are_counted_and_never_published(
    graph: Graph, plugged: Callable[..., Controller], often: None
) -> None:
    controller = plugged(protocol='text')
    node, heard = begin(graph, controller)
    reports = graph.reports('serial_encoders')
    controller.say_and_hear(heard, 1)
    controller.line.write(b'\x93noise\n')
    for line in (b'counts 7 1 2 3 4 5 6', b'counts 8 1 2 3 4 5'):
        controller.line.write(line + b'\n')
    graph.until(lambda: node.decoder.corrupted == 3, 'lines that are refused')
    controller.line.write(
        SimulatedController(3, settings=ControllerSettings('text')).measure(0.0, np.zeros(3))
    )
    graph.until(lambda: node.diagnostics.rejected == 1, 'a frame of three rotors')
    controller.say_and_hear(heard, 5)
    assert all(len(message.position) == ROTORS for message in heard)
    graph.until(
        lambda: reports and values(reports[-1])['rejected'] == '1', 'the counts in the diagnostics'
    )
    told = values(reports[-1])
    assert told['frames corrupted'] == '3'
    refusal = 'frame: it has 3 readings for a chain of 4 rotors'
    assert told['last rejection'].startswith(refusal)


def test_a_reset_and_a_plug_that_is_pulled_are_told_and_it_goes_on(
    graph: Graph, plugged: Callable[..., Controller], said: Callable[[], str]
) -> None:
    controller = plugged()
    node, heard = begin(graph, controller)
    controller.say_and_hear(heard, 5)
    controller.start()
    controller.say_and_hear(heard, 5)
    assert 'the clock of the controller has begun anew' in said()
    controller.unplug()
    graph.until(lambda: f'{node.settings.port} is gone' in said(), 'the plug to be missed')
    controller.plug()
    graph.until(lambda: f'{node.settings.port} is back' in said(), 'the plug to be back')
    controller.say_and_hear(heard, 5)
    stamps = [time_from_msg(each.header.stamp) for each in heard]
    assert (np.diff(stamps) > 0).all()
    assert node.stream.lost == 0
    assert node.stream.clock.restarts == 2


@pytest.mark.parametrize('pressure', [False, True])
def test_torques_go_to_the_valves_until_nobody_renews_them(
    graph: Graph, plugged: Callable[..., Controller], pressure: bool
) -> None:
    controller = plugged(torque_per_pressure=1e-6)
    scale = {'valves.torque_per_pressure': [1e-6]} if pressure else {}
    node, heard = begin(graph, controller, **scale, **{'valves.hold': PATIENT})
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    delivered = graph.hear(interfaces.DELIVERED_IMPULSES)
    controller.say_and_hear(heard, 1)
    wanted = pytest.approx([0.0, 0.0, 0.05, 0.0])
    begun = time.monotonic()

    def told() -> bool:
        torques.publish(JointState(name=['rotor_2'], effort=[0.05]))
        return controller.torques() == wanted

    graph.until(told, 'a torque')
    graph.until(lambda: controller.torques() == [0.0] * ROTORS, 'the end of it')
    elapsed = time.monotonic() - begun
    assert elapsed < PATIENT, 'it was the controller that gave up'
    assert node.valves.shut
    assert node.valves.told <= 100 * elapsed + 3
    controller.say_and_hear(heard, 1)
    graph.until(lambda: delivered, 'the impulse of it')
    impulse = delivered[0].impulse[2]
    assert list(delivered[0].impulse) == [0, 0, impulse, 0]
    assert 0.05 * ValveParameters().command_timeout < impulse < 0.05 * elapsed
    assert delivered[0].header == heard[-1].header


def test_a_node_that_stops_shuts_the_valves_first(
    graph: Graph, plugged: Callable[..., Controller]
) -> None:
    controller = plugged()
    node, heard = begin(
        graph, controller, **{'valves.hold': PATIENT, 'valves.command_timeout': PATIENT}
    )
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    controller.say_and_hear(heard, 1)
    torques.publish(JointState(name=['rotor_0'], effort=[0.05]))
    graph.until(lambda: any(controller.torques()), 'a torque')
    begun = time.monotonic()
    node.trigger_deactivate()
    graph.until(lambda: not any(controller.torques()), 'valves that are shut')
    assert time.monotonic() - begun < PATIENT, 'it was the controller that gave up'


@pytest.mark.parametrize(
    ('message', 'complaint'),
    [
        (JointState(name=['rotor_9'], effort=[0.01]), "joint 'rotor_9'"),
        (JointState(name=['rotor_0'], effort=[1.0]), 'must lie in the range -0.1 to 0.1'),
        (JointState(name=['rotor_0'], effort=[math.nan]), 'must be a finite number'),
    ],
)
def test_torques_that_cannot_be_are_refused_whole(
    graph: Graph, plugged: Callable[..., Controller], message: JointState, complaint: str
) -> None:
    controller = plugged()
    node, heard = begin(graph, controller)
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    controller.say_and_hear(heard, 1)
    message.header.stamp = time_to_msg(0)
    torques.publish(message)
    graph.until(lambda: node.diagnostics.rejected == 1, 'a refusal')
    report = graph.next_report('serial_encoders')
    assert complaint in values(report)['last rejection']
    assert node.valves.told == 0


@pytest.mark.parametrize(
    ('parameters', 'complaint'),
    [
        ({}, r'parameter port is empty; set it: this machine has'),
        ({'port': '/dev/no_such_port'}, r"'/dev/no_such_port' cannot be opened: No such file"),
        ({'port': 'x', 'encoders.signs': [1.0]}, 'signs has 1 values for a chain of 4 rotors'),
        ({'port': 'x', 'valves.hold': 0.001}, r'hold = 0.001 s is shorter'),
    ],
)
def test_what_cannot_work_is_said_in_one_line_at_the_start(
    graph: Graph, parameters: dict[str, Any], complaint: str
) -> None:
    pytest.importorskip('serial', reason='serial ports need pyserial')
    chain = {'chain_from': 'parameters', 'chain.number_of_rotors': ROTORS}
    with pytest.raises(ValueError, match=complaint) as raised:
        graph.start(SerialEncoders, {**chain, **parameters})
    assert '\n' not in str(raised.value)


def test_without_pyserial_it_says_in_one_line_what_to_install(
    graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, 'serial', None)
    with pytest.raises(ValueError, match=r'need pyserial.*pip install pyserial') as raised:
        graph.start(SerialEncoders)
    assert '\n' not in str(raised.value)
