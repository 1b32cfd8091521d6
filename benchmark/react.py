# SPDX-License-Identifier: Apache-2.0
"""Time from a nudge on the topic to the first messages that show its effect.

A simulator of 40 rotors at 1000 Hz, an edge actuator and an analyser run in separate processes.
This process nudges in alternating directions at random instants. A nudge changes the rates by its
speed (norm over the rotors). Without a nudge, rates hardly change between frames. The first frame
with a change of more than half of this speed shows the nudge, and so does the soliton_state with
the same stamp.

The arrival time of a message is the time that the middleware records. This process has a higher
priority than the nodes, and sleeps after each nudge until all messages have arrived.
"""

from __future__ import annotations

import random
import time
from contextlib import ExitStack

import numpy as np
import rclpy
from comparison import Figure, Part, parse, parser, tracked, write
from processes import node_command, own_domain, raw_subscription, running, take_all, until
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.pacing import raise_priority
from soliton_linkage_nodes.runtime.stamps import time_from_msg

ROTORS = 40
RATE = 1000.0
SPEED = 2.0
DIRECTIONS = (1, -1, -1, 1)
PAUSES = (0.04, 0.06)
WATCHING = 0.02
IMPERCEPTIBLE = 1e-6
LISTENING = 0.1
SETTLING = 2.0
SECOND = 1e-9


Arrival = tuple[bytes, dict[str, int]]
"""Message with its times of publication and arrival [ns]."""


class Inbox:
    """Undecoded messages of a topic, in the order of their arrival."""

    def __init__(self, node: Node, topic: interfaces.Topic) -> None:
        self._subscription = raw_subscription(node, topic)
        self._arrivals: list[Arrival] = []

    def messages(self) -> list[Arrival]:
        """Return the messages since the last call of `empty`."""
        self._arrivals += take_all(self._subscription)
        return self._arrivals

    def empty(self) -> None:
        """Discard all messages."""
        self.messages().clear()


def main() -> None:
    options = parser(__doc__)
    options.add_argument('--nudges', type=int, help='number of nudges in each round')
    arguments = parse(options, rounds=(1, 3), nudges=(20, 200))
    rounds, nudges = arguments.rounds, arguments.nudges
    with own_domain(), ExitStack() as processes:
        settings = {'chain.number_of_rotors': ROTORS, 'publish_rate': RATE}
        for name in ('simulator', 'edge_actuator', 'soliton_analyser'):
            given = {'real_time': 'true', **(settings if name == 'simulator' else {})}
            processes.enter_context(running(node_command(name, given)))
        raise_priority(True)
        node = rclpy.create_node('benchmark')
        reactions = Reactions(node)
        measured = [reactions.measure(nudges, turn, rounds) for turn in range(rounds)]
        node.destroy_node()
    part = Part('react', figures=figures_of(measured), details={'seconds': measured})
    write(part, arguments.output)


class Reactions:
    """Nudges of the chain, and the messages that they cause."""

    def __init__(self, node: Node) -> None:
        self._nudge = node.create_publisher(Float64, interfaces.NUDGE.name, interfaces.NUDGE.qos)
        self._impulses = Inbox(node, interfaces.ROTOR_IMPULSES)
        self._joints = Inbox(node, interfaces.JOINT_STATES)
        self._states = Inbox(node, interfaces.SOLITON_STATE)
        until(self._nudge.get_subscription_count, 'edge_actuator')
        until(self._states.messages, 'soliton_state')
        until(self._is_ready, 'a nudge that the edge actuator accepts')
        time.sleep(SETTLING)

    def _is_ready(self) -> bool:
        self._nudge.publish(Float64(data=IMPERCEPTIBLE))
        time.sleep(LISTENING)
        return bool(self._impulses.messages())

    def measure(self, nudges: int, turn: int, rounds: int) -> dict[str, list[float]]:
        """Return the times from each nudge to its effects [s], for a number of nudges."""
        chance = random.Random(turn)
        seconds: dict[str, list[float]] = {}
        title = f'round {turn + 1} of {rounds}'
        for number in tracked(range(nudges), title, '{} nudges'):
            for inbox in (self._impulses, self._joints, self._states):
                inbox.empty()
            time.sleep(chance.uniform(*PAUSES))
            for what, since in self._nudged(DIRECTIONS[number % len(DIRECTIONS)]).items():
                seconds.setdefault(what, []).append(since * SECOND)
        return seconds

    def _nudged(self, direction: int) -> dict[str, int]:
        """Return the times from a nudge to its effects [ns]."""
        published = time.time_ns()
        self._nudge.publish(Float64(data=direction * SPEED))
        time.sleep(WATCHING)
        frame, shown = until(lambda: self._jump_since(published), 'a frame that shows the nudge')
        stamp = time_from_msg(deserialize_message(frame, JointState).header.stamp)
        _, state = until(lambda: self._state_of(stamp), 'a soliton_state that shows the nudge')
        _, impulses = until(self._impulses.messages, 'the impulses of the nudge')[0]
        return {
            'rotor_impulses': impulses['source_timestamp'] - published,
            'joint_states': shown['received_timestamp'] - published,
            'soliton_state': state['received_timestamp'] - published,
        }

    def _jump_since(self, instant: int) -> Arrival | None:
        """Return the first frame since an instant [ns] with a jump of the rates."""
        frames = self._joints.messages()
        rates = [deserialize_message(message, JointState).velocity for message, _ in frames]
        jumps = np.linalg.norm(np.diff(rates, axis=0), axis=1) > SPEED / 2
        since = (arrival for arrival, jump in zip(frames[1:], jumps, strict=True) if jump)
        return next((each for each in since if each[1]['received_timestamp'] > instant), None)

    def _state_of(self, stamp: int) -> Arrival | None:
        """Return the first soliton_state with this stamp [ns] or a later one."""
        for message, info in self._states.messages():
            state = deserialize_message(message, SolitonState)
            if time_from_msg(state.header.stamp) >= stamp:
                return message, info
        return None


def figures_of(measured: list[dict[str, list[float]]]) -> list[Figure]:
    """Return the percentiles of each round."""
    goal = f'{1e3 * (2 / RATE + 1e-3):g} ms at most'
    return [
        Figure(
            f'nudge to {what}, p{share}',
            's',
            [float(np.percentile(seconds[what], share)) for seconds in measured],
            goal if share == 99 and what != 'rotor_impulses' else '',
        )
        for what in measured[0]
        for share in (50, 99)
    ]


if __name__ == '__main__':
    main()
