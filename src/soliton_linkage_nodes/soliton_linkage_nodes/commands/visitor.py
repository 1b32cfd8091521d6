# SPDX-License-Identifier: Apache-2.0
"""Temporary node that one command of `soliton-linkage` creates."""

from __future__ import annotations

import argparse
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, TypeVar

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from soliton_linkage.command_line import PlainParser, complete
from soliton_linkage_nodes.runtime.guarded import SERVICE_QOS

_FOUND_WITHIN = 10.0
"""Default limit for the discovery of a name [s]. Discovery usually takes less than 1 s, sometimes
3 s."""
_ALL_ANNOUNCED = 3.2
"""Shortest time for collecting a list of names [s], because each process announces itself every 3
s."""
_SETTLED = 1.0
"""A list of names counts as complete if it has not changed for this time [s]."""
ANSWER_LIMIT = 60.0
"""Longest wait for the response of a service [s]. On a busy machine, a response took over 10 s."""
_REPEATED = 5.0
"""A request that changes nothing is sent again after this time without a response [s]. A response
is lost if the node has not yet discovered the client."""
_SPIN = 0.05
"""Longest time between two checks of a condition [s]."""

Found = TypeVar('Found')
NamesAndTypes = Sequence[tuple[str, list[str]]]


class Visitor:
    """Temporary node in the ROS graph, with its own executor."""

    def __init__(
        self, limit: float = _FOUND_WITHIN, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Create the node. `limit` is the longest wait until a name appears in the graph [s]."""
        self.limit = limit
        self._clock = clock
        self.node = rclpy.create_node(
            f'soliton_linkage_command_{os.getpid()}',
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def leave(self) -> None:
        """Destroy the node and its executor."""
        self._executor.shutdown()
        self.node.destroy_node()

    def spin(self, seconds: float = _SPIN) -> None:
        """Execute one callback, if one is ready within `seconds`."""
        self._executor.spin_once(timeout_sec=seconds)

    def until(self, condition: Callable[[], Any], seconds: float | None = None) -> bool:
        """Execute callbacks until `condition()`; return False after `seconds`, default `limit`."""
        deadline = self._clock() + (self.limit if seconds is None else seconds)
        while not condition():
            if self._clock() > deadline:
                return False
            self.spin()
        return True

    def rest(self, seconds: float) -> None:
        """Execute callbacks for `seconds`."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.spin(min(left, _SPIN))

    def settled(self, there: Callable[[], Found]) -> Found:
        """Call `there`, which queries the ROS graph, until its result is complete, and return it.

        The calls continue for at least 3.2 s, and until the result has not changed for 1 s. They
        end after `limit` [s] in any case.
        """
        begun = self._clock()
        found, end = there(), begun + _ALL_ANNOUNCED
        while self._clock() < min(end, begun + self.limit):
            self.spin()
            before, found = found, there()
            if found != before:
                end = max(end, self._clock() + _SETTLED)
        return found

    def type_name(self, kind: str, name: str, there: Callable[[], NamesAndTypes]) -> str:
        """Return the type of a topic or service; RuntimeError if `there()` never lists it."""
        full = self.node.resolve_topic_name(name)
        found: dict[str, list[str]] = {}

        def is_found() -> bool:
            found.update(there())
            return full in found

        if not self.until(is_found):
            raise RuntimeError(
                f'there is no {kind} {full}; list all with: soliton-linkage {kind} list'
            )
        return found[full][0]

    def call(self, service_type: Any, name: str, request: Any, repeat: bool = False) -> Any:
        """Call a service and return its response; RuntimeError if there is no response in time.

        With `repeat`, the request is sent again every 5 s. It must then change nothing.
        """
        client = self.node.create_client(service_type, name, qos_profile=SERVICE_QOS)
        if not self.until(client.service_is_ready):
            name = service_type.__name__
            raise RuntimeError(f'there is no service {client.srv_name} of the type {name}')
        futures: list[Any] = []

        def responded() -> bool:
            return any(future.done() for future in futures)

        limit = _REPEATED if repeat else ANSWER_LIMIT
        for _ in range(round(ANSWER_LIMIT / limit)):
            futures.append(client.call_async(request))
            if self.until(responded, limit):
                return next(future.result() for future in futures if future.done())
        raise RuntimeError(f'{client.srv_name} gave no response within {ANSWER_LIMIT:g} s')

    def call_node(self, node: str, service_type: Any, **request: Any) -> Any:
        """Call a standard service of a node, such as GetState; RuntimeError without a response."""
        name = re.sub(r'(?<!^)(?=[A-Z])', '_', service_type.__name__).lower()
        reads = name.startswith(('get', 'list', 'describe'))
        try:
            return self.call(
                service_type, f'{full_name(node)}/{name}', service_type.Request(**request), reads
            )
        except RuntimeError as error:
            reason = f'{node}: {error}; list nodes with: soliton-linkage node list'
            raise RuntimeError(reason) from error


def full_name(node: str) -> str:
    """Return the full name of a node; a name without a namespace is in the namespace `/`."""
    return node if node.startswith('/') else f'/{node}'


@contextmanager
def visiting(
    limit: float = _FOUND_WITHIN, clock: Callable[[], float] = time.monotonic
) -> Iterator[Visitor]:
    """Yield a visitor, which is destroyed at the end of the block."""
    with ExitStack() as stack:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.try_shutdown)
        visitor = Visitor(limit, clock)
        stack.callback(visitor.leave)
        yield visitor


Verb = Callable[[Visitor, argparse.Namespace], int | None]
"""Function that executes a verb, given a temporary node and the parsed arguments. It returns the
exit code; None means 0."""


class Verbs:
    """Verbs of a sub-command, each with arguments of its own.

    A verb is the word after the sub-command. It selects an operation, for example `list` in
    `soliton-linkage topic list`.
    """

    def __init__(self, command: str, description: str | None) -> None:
        self._parser = PlainParser(prog=f'soliton-linkage {command}', description=description)
        self._verbs = self._parser.add_subparsers(metavar='VERB', required=True)

    def add(self, name: str, verb: Verb, summary: str) -> argparse.ArgumentParser:
        """Add a verb and return the parser of its arguments, to which arguments can be added.

        The function `verb` executes the verb. `summary` is its help text.
        """
        parser: argparse.ArgumentParser = self._verbs.add_parser(
            name, help=summary, description=f'{summary[0].upper()}{summary[1:]}.'
        )
        parser.set_defaults(verb=verb)
        text, limit = 'longest wait for names, services and subscribers [%(default)g]', 'SECONDS'
        parser.add_argument(
            '--timeout', type=float, default=_FOUND_WITHIN, metavar=limit, help=text
        )
        return parser

    def add_list(self, query: Callable[[Node], NamesAndTypes], summary: str) -> None:
        """Add the verb `list`, which prints the names in `query(node)` that are not hidden."""

        def show(visitor: Visitor, options: argparse.Namespace) -> None:
            for name, types in sorted(visitor.settled(lambda: query(visitor.node))):
                own = name.startswith(f'/{visitor.node.get_name()}/')
                if not (own or topic_or_service_is_hidden(name)):
                    print(f'{name} [{", ".join(types)}]' if options.show_types else name)

        listing = self.add('list', show, summary)
        listing.add_argument(
            '-t', '--show-types', action='store_true', help='also print the types'
        )

    def run(self, arguments: list[str]) -> int:
        """Parse the arguments, run the verb with a temporary node, and return the exit code."""
        complete(self._parser)
        options = self._parser.parse_args(arguments)
        with visiting(options.timeout) as visitor:
            return options.verb(visitor, options) or 0
