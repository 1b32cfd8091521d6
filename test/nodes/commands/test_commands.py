# SPDX-License-Identifier: Apache-2.0
"""The commands inspect and use topics, parameters and services without `ros2`."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

import pytest
import yaml
from graphs import Graph
from rclpy.node import Node
from std_msgs.msg import Float64

from soliton_linkage_nodes.commands import node, param, run, service, topic
from soliton_linkage_nodes.commands.visitor import visiting
from soliton_linkage_nodes.runtime import interfaces

Said = Callable[..., str]


class Pendulum(Node):
    """A node with a parameter, a latched topic and the standard services."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('pendulum', **kwargs)
        self.declare_parameter('length', 0.5)
        self.declare_parameter('masses', [1, 2])
        topic = interfaces.Topic('angle', Float64, interfaces.latched_qos())
        topic.publisher(self).publish(Float64(data=0.25))


@pytest.fixture
def said(
    graph: Graph, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Said:
    """Run a command on the domain of the test while it spins; return the output."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.domain))
    graph.start(Pendulum)

    def run_beside(command: Any, verb: str, *arguments: str, timeout: float = 60.0) -> str:
        codes: list[Any] = []

        def work() -> None:
            try:
                codes.append(command.main([verb, '--timeout', str(timeout), *arguments]))
            except Exception as error:
                codes.append(error)

        thread = threading.Thread(target=work)
        thread.start()
        graph.until(lambda: not thread.is_alive(), ' '.join((verb, *arguments)))
        if codes != [0]:
            raise codes[0]
        return capsys.readouterr().out

    return run_beside


def test_a_latched_message_is_echoed(said: Said) -> None:
    assert said(topic, 'echo', '--once', 'angle') == 'data: 0.25\n---\n'
    assert said(topic, 'echo', '--once', '--field', 'data', '/angle') == '0.25\n---\n'
    with pytest.raises(ValueError, match='--field size: there is no size; there are data'):
        said(topic, 'echo', '--field', 'size', 'angle')


def test_a_message_is_published_to_a_waiting_subscriber(said: Said, graph: Graph) -> None:
    heard = graph.hear(interfaces.TILT)
    shown = said(topic, 'pub', '--once', 'tilt', 'std_msgs/msg/Float64', '{data: 3}')
    graph.until(lambda: heard, 'the message')
    assert heard == [Float64(data=3.0)]
    assert shown == 'published on /tilt: std_msgs.msg.Float64(data=3.0)\n'


def test_nothing_is_published_without_a_subscriber(said: Said) -> None:
    with pytest.raises(RuntimeError, match=r'/tilt has 0 subscribers after 0.1 s, not 1; nothing'):
        said(topic, 'pub', '--once', 'tilt', 'std_msgs/msg/Float64', '{data: 3}', timeout=0.1)


def test_parameters_are_listed_got_set_and_dumped(said: Said) -> None:
    assert {'length', 'masses'} <= set(said(param, 'list', 'pendulum').split())
    assert said(param, 'get', '/pendulum', 'length') == '0.5\n'
    said(param, 'set', 'pendulum', 'length', '0.75')
    dumped = yaml.safe_load(said(param, 'dump', 'pendulum'))['/pendulum']['ros__parameters']
    assert (dumped['length'], dumped['masses']) == (0.75, [1, 2])
    with pytest.raises(RuntimeError, match='pendulum rejected length: '):
        said(param, 'set', 'pendulum', 'length', 'long')
    with pytest.raises(RuntimeError, match='pendulum has no parameter mass, or it is not set'):
        said(param, 'get', 'pendulum', 'mass')


def test_nodes_and_services_are_listed_and_called(said: Said, graph: Graph) -> None:
    graph.until(lambda: '/pendulum' in said(node, 'list', timeout=0.0).split(), 'the node')
    listed = '/pendulum/list_parameters'
    graph.until(lambda: listed in said(service, 'list', timeout=0.0).split(), 'its services')
    kind = 'rcl_interfaces/srv/GetParameters'
    shown = said(service, 'call', '/pendulum/get_parameters', kind, '{names: [length]}')
    assert yaml.safe_load(shown)['values'][0]['double_value'] == 0.5


@pytest.mark.parametrize(
    ('announced', 'length'),
    [([3.1], 4.1), ([3.1, 4.0, 4.9], 5.9), ([], 3.2), ([0.7 * n for n in range(20)], 10)],
)
def test_a_list_is_complete_once_it_no_longer_grows(
    graph: Graph, monkeypatch: pytest.MonkeyPatch, announced: list[float], length: float
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.domain))
    now = 0.0

    def found() -> list[float]:
        nonlocal now
        now += 0.05
        return [time for time in announced if time <= now]

    with visiting(clock=lambda: now) as visitor:
        assert visitor.settled(found) == [time for time in announced if time <= length]
    assert now == pytest.approx(length, abs=0.11)


def test_an_unknown_name_is_reported(said: Said) -> None:
    with pytest.raises(
        RuntimeError, match='there is no topic /none; list all with: soliton-linkage topic list'
    ):
        said(topic, 'echo', 'none', timeout=0.1)
    with pytest.raises(RuntimeError, match='nobody: there is no service /nobody/get_parameters'):
        said(param, 'get', 'nobody', 'length', timeout=0.1)


def test_programs_are_run_by_their_names(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[list[str]] = []
    monkeypatch.setattr('sys.argv', ['soliton-linkage'])
    monkeypatch.setattr(run.start, 'simulator', lambda: begun.append(list(sys.argv)))
    assert run.main(['simulator', '--ros-args', '-p', 'publish_rate:=5.0']) == 0
    assert begun == [['simulator', '--ros-args', '-p', 'publish_rate:=5.0']]
    with pytest.raises(SystemExit, match='2'):
        run.main(['simulatr'])
