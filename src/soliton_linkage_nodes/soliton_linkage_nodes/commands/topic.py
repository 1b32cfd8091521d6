# SPDX-License-Identifier: Apache-2.0
"""List and describe topics, echo their messages, measure their rate (hz), and publish (pub)."""

from __future__ import annotations

import argparse
import time
from itertools import count, pairwise
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile

from soliton_linkage_nodes.commands.visitor import Verbs, Visitor
from soliton_linkage_nodes.messages.fields import interface_type, read, to_yaml
from soliton_linkage_nodes.runtime.interfaces import Topic
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription

_QOS = QoSProfile(depth=1000)
"""Quality of service that `echo` and `hz` request. If a publisher offers only best effort, they
use best effort."""


def main(arguments: list[str]) -> int:
    """Run the verb of the command line and return its exit code."""
    verbs = Verbs('topic', __doc__)
    names = Node.get_topic_names_and_types
    verbs.add_list(names, 'print the names of all topics that are not hidden')
    info = verbs.add('info', _info, 'print the type of a topic and its numbers of endpoints')
    info.add_argument('topic')
    info.add_argument('-v', '--verbose', action='store_true', help='also print each endpoint')
    echo = verbs.add('echo', _echo, 'print the messages of a topic as YAML')
    echo.add_argument('topic')
    echo.add_argument('type', nargs='?', help='message type [type of the publisher]')
    echo.add_argument('--once', action='store_true', help='print one message and exit')
    echo.add_argument('--field', default='', help='print one field only, such as energies.kinetic')
    rate = verbs.add('hz', _rate, 'print the message rate once per second')
    rate.add_argument('topic')
    publish = verbs.add('pub', _publish, 'publish a message, by default once per second')
    publish.add_argument('topic')
    publish.add_argument('type', help='type, such as std_msgs/msg/Float64')
    publish.add_argument(
        'values', nargs='?', default='{}', help="message in YAML, such as '{data: 0.25}'"
    )
    publish.add_argument('-r', '--rate', type=_positive, default=1.0, help='rate in Hz [1]')
    times = publish.add_mutually_exclusive_group()
    times.add_argument(
        '-1', '--once', action='store_true', help='wait for a subscriber and publish once'
    )
    times.add_argument('-t', '--times', type=int, default=0, help='number of messages [unlimited]')
    options = ('-w', '--wait-matching-subscriptions')
    waiting = 'subscribers to wait for [1 with --once or --times, else 0]'
    publish.add_argument(*options, dest='subscribers', type=int, help=waiting)
    return verbs.run(arguments)


def _positive(text: str) -> float:
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f'{text} must be above 0')
    return value


def _info(visitor: Visitor, options: argparse.Namespace) -> None:
    node = visitor.node
    kind = visitor.type_name('topic', options.topic, node.get_topic_names_and_types)
    topic = node.resolve_topic_name(options.topic)
    queries = (node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic)
    endpoints = visitor.settled(lambda: [list(query(topic)) for query in queries])
    print(f'Type: {kind}')
    for title, found in zip(('Publisher', 'Subscription'), endpoints, strict=True):
        print(f'{title} count: {len(found)}')
        for each in found if options.verbose else ():
            print(f'\n{each}\n')


def _type(visitor: Visitor, options: argparse.Namespace) -> Any:
    name = getattr(options, 'type', None) or visitor.type_name(
        'topic', options.topic, visitor.node.get_topic_names_and_types
    )
    return interface_type(name, 'msg')


def _echo(visitor: Visitor, options: argparse.Namespace) -> None:
    received: list[Any] = []
    message_type = _type(visitor, options)
    _field(message_type(), options.field)
    topic = visitor.node.resolve_topic_name(options.topic)
    visitor.until(lambda: visitor.node.count_publishers(topic))
    AdaptiveSubscription(visitor.node, Topic(topic, message_type, _QOS), received.append)
    while True:
        visitor.spin()
        for message in received:
            print(f'{to_yaml(_field(message, options.field))}---', flush=True)
            if options.once:
                return
        received.clear()


def _field(message: Any, path: str) -> Any:
    for name in path.split('.') if path else ():
        if not hasattr(message, 'get_fields_and_field_types'):
            raise ValueError(f'--field {path}: there is no {name} in a number or list')
        if name not in message.get_fields_and_field_types():
            known = ', '.join(message.get_fields_and_field_types())
            raise ValueError(f'--field {path}: there is no {name}; there are {known}')
        message = getattr(message, name)
    return message


def _rate(visitor: Visitor, options: argparse.Namespace) -> None:
    arrivals: list[float] = []
    message_type = _type(visitor, options)
    topic = visitor.node.resolve_topic_name(options.topic)

    def note(_: Any) -> None:
        arrivals.append(time.monotonic())

    AdaptiveSubscription(visitor.node, Topic(topic, message_type, _QOS), note, raw=True)
    while True:
        visitor.rest(1.0)
        gaps = [later - sooner for sooner, later in pairwise(arrivals)]
        text = f'{len(arrivals)} messages in a second'
        if gaps:
            least, most, rate = 1e3 * min(gaps), 1e3 * max(gaps), len(gaps) / sum(gaps)
            apart = f'{least:.2f} to {most:.2f} ms apart'
            text = f'{rate:.3f} Hz, {apart}, of {len(arrivals)} messages'
        print(text, flush=True)
        del arrivals[:-1]


def _publish(visitor: Visitor, options: argparse.Namespace) -> None:
    times = 1 if options.once else options.times
    subscribers = int(times > 0) if options.subscribers is None else options.subscribers
    message = read(interface_type(options.type, 'msg'), options.values)
    publisher = visitor.node.create_publisher(type(message), options.topic, 10)
    if not visitor.until(lambda: publisher.get_subscription_count() >= subscribers):
        raise RuntimeError(
            f'{publisher.topic_name} has {publisher.get_subscription_count()} subscribers '
            f'after {visitor.limit:g} s, not {subscribers}; nothing was published'
        )
    begin = time.monotonic()
    for number in count(1):
        publisher.publish(message)
        print(f'published on {publisher.topic_name}: {message}', flush=True)
        if number == times:
            break
        visitor.rest(begin + number / options.rate - time.monotonic())
    publisher.wait_for_all_acked(Duration(seconds=visitor.limit))
