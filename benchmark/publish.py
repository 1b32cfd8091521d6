# SPDX-License-Identifier: Apache-2.0
"""Time to publish one frame of joint states in three ways.

The simulator overwrites the stamp and the arrays of a serialised message and publishes the bytes.
The usual way fills a JointState from lists. The lower limit is to publish constant bytes. All
three use the same publisher in random order, with and without a subscriber in another process.
Each turn publishes a few messages and waits for their arrival; the time of a round is the median.
"""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import rclpy
from comparison import Comparison, Figure, Part, parse, parser, tracked, write
from processes import own_domain, program_command, running, until
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from wall_bag import named_chain

from soliton_linkage_nodes.messages.cdr import JointStateBuffer, publish_buffer
from soliton_linkage_nodes.messages.conversions import FRAME, default_joint_names
from soliton_linkage_nodes.runtime.interfaces import stream_qos
from soliton_linkage_nodes.runtime.stamps import time_to_msg

Ways = dict[str, Callable[[], None]]

ROTORS = (20, 100, 1000, 10_000)
LISTENER = Path(__file__).with_name('listener.py')
SHORTEST_PAUSE = 0.002
MESSAGES_A_TURN = 10
TURNS = 200
GOAL = 1.5


def main() -> None:
    options = parser(__doc__)
    options.add_argument('--rotors', type=int, nargs='*', default=list(ROTORS))
    arguments = parse(options, rounds=(2, 7), turns=(TURNS // 20, TURNS))
    rounds, turns = arguments.rounds, arguments.turns
    comparisons, figures, seconds = [], [], {}
    with own_domain():
        node = rclpy.create_node('benchmark')
        for subscribed in (False, True):
            for rotors in arguments.rotors:
                work = f'{rotors} rotors, {"one" if subscribed else "no"} subscriber'
                times = measured(node, rotors, subscribed, rounds, turns, work)
                seconds[work] = times
                ours, floor = times['ours'], times['floor']
                comparisons.append(
                    Comparison('JointState of lists', work, 's', times['idiomatic'], ours)
                )
                ratios = [mine / least for mine, least in zip(ours, floor, strict=True)]
                goal = f'{GOAL:g} at most'
                figures += [
                    Figure(f'publishing constant bytes, {work}', 's', floor),
                    Figure(f'ours / constant bytes, {work}', '', ratios, goal),
                ]
        node.destroy_node()
    details = {'seconds': seconds, 'messages_a_turn': MESSAGES_A_TURN, 'turns': turns}
    write(Part('publish', comparisons, figures, details), arguments.output)


def measured(
    node: Node, rotors: int, subscribed: bool, rounds: int, turns: int, work: str
) -> dict[str, list[float]]:
    """Return the time of each way to publish a message [s], one number per round."""
    name = f'joint_states_{rotors}_{subscribed:d}'
    qos = stream_qos(len(JointStateBuffer(named_chain(rotors))))
    publisher = node.create_publisher(JointState, name, qos)
    times: dict[str, list[float]] = {}
    with running(program_command(LISTENER, name)) if subscribed else nullcontext():
        if subscribed:
            until(publisher.get_subscription_count, 'subscriber')
        ways = ways_to_publish(publisher, rotors)
        round_of(ways, publisher, 2)
        for _ in tracked(range(rounds), work, '{} rounds'):
            for way, median in round_of(ways, publisher, turns).items():
                times.setdefault(way, []).append(median)
    node.destroy_publisher(publisher)
    return times


def round_of(ways: Ways, publisher: Publisher, turns: int) -> dict[str, float]:
    """Return the median time [s] of each way to publish a message, over `turns` turns."""
    times: dict[str, list[float]] = {way: [] for way in ways}
    chance = random.Random(turns)
    for _ in range(turns):
        for way, publish in chance.sample(list(ways.items()), len(ways)):
            start = time.perf_counter()
            for _ in range(MESSAGES_A_TURN):
                publish()
            elapsed = time.perf_counter() - start
            times[way].append(elapsed / MESSAGES_A_TURN)
            if publisher.get_subscription_count():
                time.sleep(SHORTEST_PAUSE + elapsed)
    return {way: statistics.median(turns) for way, turns in times.items()}


def ways_to_publish(publisher: Publisher, rotors: int) -> Ways:
    """Return functions that publish the same frame in each way."""
    named = named_chain(rotors)
    angles, rates, torques = np.random.default_rng(rotors).normal(size=(3, rotors))
    stamp = 1_700_000_000_123_456_789
    buffer = JointStateBuffer(named)
    constant = bytes(buffer.fill(stamp, angles, rates, torques))
    joint_names = list(default_joint_names(rotors))

    def idiomatic() -> None:
        message = JointState()
        message.header.stamp = time_to_msg(stamp)
        message.header.frame_id = FRAME
        message.name = joint_names
        message.position = angles.tolist()
        message.velocity = rates.tolist()
        message.effort = torques.tolist()
        publisher.publish(message)

    def ours() -> None:
        publish_buffer(publisher, buffer.fill(stamp, angles, rates, torques))

    def floor() -> None:
        publisher.publish(constant)

    return {'idiomatic': idiomatic, 'ours': ours, 'floor': floor}


if __name__ == '__main__':
    main()
