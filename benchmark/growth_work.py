# SPDX-License-Identifier: Apache-2.0
"""Tasks whose time is measured for chains of different lengths."""

from __future__ import annotations

import itertools
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
from processes import program_command, running, until
from rclpy.qos import QoSProfile
from wall_bag import NOISE, RATE, SECOND, NoisyWall, named_chain

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators import SymplecticNystrom
from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.bags.reading import type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.record.subscriptions import RecordedSubscription
from soliton_linkage_nodes.bags.record.writing_thread import RecordedTopic
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.runtime import interfaces

FIRST_FRAMES = 30
ARRIVAL = 0.02
BATCH = 5


@dataclass(frozen=True)
class Work:
    """Timed function, and the preparation before each call."""

    do: Callable[[], int]
    """Timed function, which returns the number of units of work."""
    prepare: Callable[[], object] = lambda: None


def moving(rotors: int) -> tuple[EquationOfMotion, np.ndarray]:
    """Return the equation of motion and the state of a chain with a moving wall."""
    motion = EquationOfMotion(Chain(number_of_rotors=rotors))
    return motion, motion.state(*NoisyWall(rotors, 0.0).frame(FIRST_FRAMES))


@contextmanager
def right_hand_side(rotors: int) -> Iterator[Work]:
    """Yield one evaluation of the equation of motion."""
    motion, state = moving(rotors)
    yield Work(lambda: len(motion(0.0, state)) // len(state))


@contextmanager
def compiled_force(rotors: int) -> Iterator[Work]:
    """Yield steps of the compiled integrator, with the force evaluation as the unit of work."""
    motion, state = moving(rotors)
    solver = SymplecticNystrom(motion, 0.0, state, 1e9, first_step=0.01, atol=1e-3, rtol=0.0)
    solver.step()

    def step() -> int:
        before = solver.nfev
        solver.step()
        return int(solver.nfev - before)

    yield Work(step)


@contextmanager
def one_zero_mode(rotors: int) -> Iterator[Work]:
    """Yield the zero mode of a chain with a wall."""
    motion, state = moving(rotors)
    yield Work(lambda: zero_mode(motion.chain, state[:rotors]).size // rotors)


@contextmanager
def analysis(rotors: int) -> Iterator[Work]:
    """Yield the analysis of one noisy frame with rates, in the steady state of the analyser."""
    wall, analyser = NoisyWall(rotors), Analyser(Chain(number_of_rotors=rotors), NOISE)
    numbers, frame = itertools.count(FIRST_FRAMES), []

    def prepare() -> None:
        number = next(numbers)
        frame[:] = [number * SECOND // RATE, *wall.frame(number)]

    def analyse() -> int:
        return 0 if analyser.analyse(*frame) is None else 1

    for _ in range(FIRST_FRAMES):
        prepare()
        analyse()
    yield Work(analyse, prepare)


@contextmanager
def published(rotors: int) -> Iterator[Work]:
    """Yield the publication of joint states to a subscriber in another process."""
    buffer, still = JointStateBuffer(named_chain(rotors)), np.zeros(rotors)
    topic = f'growing_{rotors}'
    node = rclpy.create_node('speaker')
    qos = interfaces.stream_qos(len(buffer))
    publisher = node.create_publisher(interfaces.JOINT_STATES.type, topic, qos)
    numbers = itertools.count()

    def publish() -> int:
        publisher.publish(bytes(buffer.fill(next(numbers), still, still, still)))
        return 1

    with running(program_command(Path(__file__).with_name('listener.py'), topic)):
        until(publisher.get_subscription_count, 'subscriber')
        yield Work(publish)
    node.destroy_node()


@contextmanager
def recorded(rotors: int) -> Iterator[Work]:
    """Yield the recording of one message, as in the threads of the recorder."""
    buffer, still = JointStateBuffer(named_chain(rotors)), np.zeros(rotors)
    message = bytes(buffer.fill(0, still, still, still))
    kind, qos = interfaces.JOINT_STATES.type, QoSProfile(depth=2 * BATCH)
    node = rclpy.create_node('recorded')
    name = f'/recorded_{rotors}'
    publisher = node.create_publisher(kind, name, qos)
    subscription = RecordedSubscription(
        node, RecordedTopic(name, type_name(kind), (qos,)), kind, 0
    )
    with tempfile.TemporaryDirectory() as folder:
        writer = BagWriter(Path(folder, 'run'))
        topic = writer.add_topic(name, type_name(kind), qos)

        def publish() -> None:
            for _ in range(BATCH):
                publisher.publish(message)
            time.sleep(ARRIVAL)

        def record() -> int:
            taken = subscription.drain()
            for each in taken:
                writer.write(topic, each.stamp, each.serialized)
            return len(taken)

        yield Work(record, publish)
        writer.close()
    node.destroy_node()


WORKS: dict[str, Callable[[int], AbstractContextManager[Work]]] = {
    'right-hand side': right_hand_side,
    'compiled force': compiled_force,
    'zero mode': one_zero_mode,
    'analysis': analysis,
    'published message': published,
    'recorded message': recorded,
}
