# SPDX-License-Identifier: Apache-2.0
"""Every node starts as a process or logs the reason in one line, and stops on a signal."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from itertools import cycle

import pytest
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from recordings import run_of, write_bag
from std_msgs.msg import Float64

from soliton_linkage_nodes.runtime.process import SpinSlices, initialise, interruptible

SMALL = ['-p', 'chain.number_of_rotors:=8', '-p', 'publish_rate:=50.0']
MINUTE = 60 * 10**9
MOST_HEARD = 50_000
SIGNALLED_TWICE = {'simulator': 0.03, 'bag_recorder': 0.1}
"""Nodes that receive a second signal after a time [s]."""
FIRST_WORDS = {
    'simulator': 'simulating a chain of 8 rotors (flipper, a = 0.1 m, r = 0.05 m, rest angle '
    '0.97 rad), elastic, integrator symplectic, at 50 Hz',
    'edge_actuator': 'pneumatic actuators on the chain of /chain; a nudge is a kick at the',
    'soliton_analyser': 'analysing /joint_states of the chain of /chain',
    'soliton_steering': 'steering the soliton of the chain of /chain by all joints',
    'bag_recorder': '; discovering all publishers',
    'bag_player': 'messages at rate 1',
}


def test_every_node_stops_cleanly_on_one_or_two_signals(graph, start, named, tmp_path):
    long_bag = write_bag(tmp_path / 'long', run_of(named, 2, gap=MINUTE))
    given = {
        'simulator': SMALL,
        'bag_recorder': ['-p', f'output:={tmp_path / "run"}'],
        'bag_player': ['-p', f'bag:={long_bag}'],
    }
    reports = {node: graph.reports(node) for node in FIRST_WORDS}
    programs = {node: start(node, '--ros-args', *given.get(node, [])) for node in FIRST_WORDS}
    graph.until(lambda: all(reports.values()), 'a report of every node')
    numbers = cycle([signal.SIGINT, signal.SIGTERM])
    for (node, program), number in zip(programs.items(), numbers, strict=False):
        if node in SIGNALLED_TWICE:
            program.process.send_signal(number)
            time.sleep(SIGNALLED_TWICE[node])
        assert program.stop(number) == 0, node
        assert 'Traceback' not in ''.join(program.said), node
        assert 'FATAL' not in ''.join(program.said), node
        assert sum(FIRST_WORDS[node] in line for line in program.said) == 1, node
        closed = sum('closed' in line for line in program.said)
        assert closed == (node == 'bag_recorder'), node


def test_a_simulator_that_computes_a_long_frame_stops_as_well(graph, start):
    reports = graph.reports('simulator')
    program = start('simulator', '--ros-args', '-p', 'chain.number_of_rotors:=20000')
    graph.until(lambda: reports, 'a report')
    assert program.stop() == 0


def lose() -> None:
    weakref.finalize(threading.Event(), signal.raise_signal, signal.SIGTERM)


def suppress() -> None:
    with contextlib.suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize('swallow', [suppress, lose])
def test_an_interrupt_that_is_lost_ends_the_block_at_its_end(swallow, monkeypatch):
    stopping, printed = threading.Event(), []
    monkeypatch.setattr(sys, 'unraisablehook', printed.append)
    with pytest.raises(KeyboardInterrupt):
        interruptible(stopping)(swallow)()
    assert stopping.is_set()
    assert printed == []


def test_a_slice_ends_under_a_continuous_stream_of_messages(graph):
    node = Node('busy', context=graph.context)
    executor = EventsExecutor(context=graph.context)
    executor.add_node(node)
    publisher = node.create_publisher(Float64, 'echo', 10)
    heard = []

    def answer_twice(message: Float64) -> None:
        heard.append(message)
        # Where the turn does not end the test does, and fails.
        if len(heard) < MOST_HEARD:
            publisher.publish(message)
            publisher.publish(message)

    node.create_subscription(Float64, 'echo', answer_twice, 10)
    graph.until(publisher.get_subscription_count, 'a listener')
    publisher.publish(Float64())
    with SpinSlices() as slices:
        while len(heard) < 10:
            executor.spin_until_future_complete(slices.begin(), 0.1)
    executor.remove_node(node)
    node.destroy_node()
    assert len(heard) < MOST_HEARD


def test_unreadable_parameters_are_logged_in_one_line(tmp_path):
    for content in [None, 'simulator:\n  ros__parameters: [', '\x00']:
        path = tmp_path / 'wrong.yaml'
        if content is not None:
            path.write_text(content)
        with pytest.raises(ValueError, match=r'wrong ROS arguments: |does not exist') as refusal:
            initialise(['--ros-args', '--params-file', str(path)])
        assert 'rcl' not in str(refusal.value) or content is not None
        assert str(path) in str(refusal.value)
        assert '\n' not in str(refusal.value)


def test_wrong_arguments_are_logged_in_one_line(start):
    program = start('edge_actuator', '--ros-args', '-p', 'chain.mass:=0.0')
    assert program.wait() == 1
    (line,) = [line for line in program.said if 'FATAL' in line]
    said = 'parameter chain.mass of edge_actuator = 0.0 must lie in the range 1e-09 to 1e+06 kg'
    assert said in line
    assert 'Traceback' not in ''.join(program.said)
    with pytest.raises(ValueError, match=r"wrong ROS arguments: \['--unknown'\]"):
        initialise(['--ros-args', '--unknown'])


COMPUTING = """
import atexit, threading
from soliton_linkage_nodes.runtime.process import end_process

lock, taken = threading.Lock(), threading.Event()

def compute():
    with lock:
        taken.set()
        threading.Event().wait()

atexit.register(lock.acquire)
threading.Thread(target=compute, daemon=True).start()
taken.wait()
print('ended', end='')
end_process(3)
"""


START = """
import atexit, weakref
from rclpy.node import Node
from soliton_linkage_nodes.programs.command_line import ros_client
from soliton_linkage_nodes.runtime.process import run_together

nodes = []

class Wrong(Node):
    def __init__(self, *_):
        super().__init__('wrong')
        nodes.append(weakref.ref(self))
        self.create_timer(1.0, self.act)
        raise ValueError('wrong')

    def act(self):
        pass

atexit.register(lambda: print('destroyed' if nodes[0]() is None else 'alive', end=''))
"""
WRONG_NODE = f"{START}run_together([Wrong], ['wrong'])"
WRONG_CLIENT = f"""{START}
with ros_client('client', Wrong):
    pass
"""
FAILING_CLIENT = """
from rclpy.node import Node
from soliton_linkage_nodes.programs.command_line import ros_client

class Client(Node):
    def destroy_node(self):
        super().destroy_node()
        print('destroyed', end='')

with ros_client('client', lambda stopping: Client('client')):
    raise ValueError('wrong')
"""


@pytest.mark.parametrize(
    'code', [WRONG_NODE, WRONG_CLIENT, FAILING_CLIENT], ids=['node', 'client', 'block']
)
def test_after_an_error_the_node_is_destroyed_before_the_process_ends(graph, code):
    """Otherwise threads of the middleware run on while the process ends, and can crash it."""
    ended = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (1, 'destroyed'), ended.stderr


def test_a_long_computation_does_not_delay_the_end_of_a_process():
    ended = subprocess.run(
        [sys.executable, '-c', COMPUTING], capture_output=True, text=True, timeout=120, check=False
    )
    assert (ended.returncode, ended.stdout) == (3, 'ended')
