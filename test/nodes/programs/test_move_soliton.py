# SPDX-License-Identifier: Apache-2.0
"""The program move_soliton shows the progress and the result of a move."""

import math
import signal
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from graphs import values
from rclpy.action import ActionServer

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.programs.move_soliton import MoveClient, progress_of
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

QUICK = {
    'chain.number_of_rotors': 8,
    'publish_rate': 125.0,
    'real_time_factor': 0.25,
    'tolerance': 1e-8,
}


@pytest.fixture
def client(graph):
    made = MoveClient(threading.Event(), context=graph.context)
    yield made
    made.destroy_node()


def test_it_waits_for_the_chain_and_ends_when_the_soliton_is_there(graph, start):
    reports = graph.reports('soliton_steering')
    graph.start(SolitonSteering, {'state_timeout': 60.0})
    program = start('move_soliton', '2.5', '--wait', '240')
    graph.until(
        lambda: 'move_soliton' in graph.user.get_node_names() and len(reports) > 5, 'the program'
    )
    assert 'waiting for the topic chain' in reports[-1].message
    graph.start(Simulator, QUICK)
    graph.until(lambda: program.process.poll() is not None, 'the end of the move')
    assert program.process.returncode == 0, program.said
    assert any('J in phonons' in line for line in program.said)
    assert program.said[-1].startswith('the soliton is held at rotor 2.')
    assert abs(float(values(graph.next_report('soliton_steering'))['rotor']) - 2.5) < 0.1
    program = start('move_soliton', '77', '--wait', '240')
    graph.until(lambda: program.process.poll() is not None, 'the rejection')
    assert program.process.returncode == 1
    assert 'range 0 to 7' in program.said[-1]


def test_it_reports_that_no_node_steers(client):
    with pytest.raises(ValueError, match=r'no node offers the action .* after 0\.5 s; start'):
        client.move(3.0, 0.0, 0.5)


def test_phonons_are_reported_if_rates_are_known():
    told = MoveSoliton.Feedback(rotor=2.5, speed=1.0, phonon_energy=1e-3)
    assert progress_of(told).endswith('1.0e-03 J in phonons')
    told.phonon_energy = math.nan
    assert progress_of(told).endswith('rotors/s')


def test_interrupted_it_stops_the_soliton(graph, start):
    reports = graph.reports('soliton_steering')
    graph.start(Simulator, QUICK)
    graph.start(SolitonSteering, {'state_timeout': 60.0})

    def rotor():
        return float(values(reports[-1])['rotor']) if reports else math.nan

    graph.until(lambda: rotor() >= 0, 'a wall')
    program = start('move_soliton', '6', '--speed', '0.05', '--wait', '240')
    graph.until(lambda: reports[-1].message.startswith('moving'), 'a wall on its way')
    program.process.send_signal(signal.SIGINT)
    graph.until(lambda: program.process.poll() is not None, 'the end of the move')
    assert program.process.returncode == 130
    assert program.said[-1] in (
        'cancelled; soliton_steering brings the soliton to rest',
        f'the soliton is held at rotor {rotor():.2f}',
    )
    reports.clear()
    graph.until(
        lambda: reports and reports[-1].message.startswith('holding the soliton'), 'a rest'
    )
    assert rotor() < 5


def test_it_ends_when_the_steering_is_killed(graph, start, client):
    reports = graph.reports('soliton_steering')
    graph.start(Simulator, QUICK)
    steering = start('soliton_steering', '--ros-args', '-p', 'state_timeout:=60.0')
    graph.until(lambda: reports and reports[-1].message == 'ready', 'a wall')
    with ThreadPoolExecutor(1) as pool:
        move = pool.submit(client.move, 6.0, 0.2, 60.0)
        graph.until(lambda: reports[-1].message.startswith('moving'), 'a wall on its way')
        steering.process.kill()
        graph.until(move.done, 'the end of the move')
    with pytest.raises(
        ValueError,
        match=r'(no feedback from soliton_steering for \d+ s|soliton_steering has stopped)',
    ):
        move.result()


def test_an_interrupted_move_ends_without_a_response_of_the_server(graph, client):
    server = ActionServer(graph.user, MoveSoliton, interfaces.MOVE_SOLITON, lambda _: None)
    taken: list[object] = []
    server.register_handle_accepted_callback(taken.append)
    with ThreadPoolExecutor(1) as pool:
        move = pool.submit(client.move, 6.0, 0.2)
        graph.until(lambda: taken, 'the goal')
        client.stopping.set()
        graph.until(move.done, 'the end of the move')
    with pytest.raises(KeyboardInterrupt):
        move.result()
    server.destroy()
