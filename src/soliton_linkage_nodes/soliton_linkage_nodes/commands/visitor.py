# SPDX-License-Identifier: Apache-2.0
"""A node that visits the graph for one command."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from soliton_linkage.command_line import PlainParser, complete
from soliton_linkage_nodes.runtime.guarded import SERVICE_QOS

FOUND_WITHIN = 10.0
"""What is looked for by its name has to show itself within this [s]; on one machine it is there in
a fraction, now and then in 3, on a busy one later."""
_ALL_ANNOUNCED = 3.2
"""Each process announces itself every 3 s [s]: a list that is asked for sooner may lack some."""
_SETTLED = 1.0
"""Without a change, before a list is taken to be complete [s]."""
ANSWER_LIMIT = 10.0
"""For the answer of a service that is there [s]."""
_SPIN = 0.05
"""How soon a condition is looked at again where nothing comes [s]."""

Found = TypeVar('Found')
NamesAndTypes = Sequence[tuple[str, list[str]]]


class Visitor:
    """A node of its own in the graph of the domain, and what it is told there."""

    def __init__(self) -> None:
        self.node = rclpy.create_node(
            f'soliton_linkage_command_{os.getpid()}',
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def leave(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()

    def spin(self, seconds: float = _SPIN) -> None:
        """Take what comes next."""
        self._executor.spin_once(timeout_sec=seconds)

    def until(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until a condition holds; False where it does not in time."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                return False
            self.spin()
        return True

    def rest(self, seconds: float) -> None:
        """Take what comes for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.spin(min(left, _SPIN))

    def settled(self, there: Callable[[], Found]) -> Found:
        """What is there once all have announced themselves, and it no longer changes."""
        begun = since = time.monotonic()
        found = there()
        while time.monotonic() < min(
            max(begun + _ALL_ANNOUNCED, since + _SETTLED), begun + FOUND_WITHIN
        ):
            self.spin()
            before, found = found, there()
            if found != before:
                since = time.monotonic()
        return found

    def type_name(self, kind: str, name: str, there: Callable[[], NamesAndTypes]) -> str:
        """Type of the topic or service of a name; RuntimeError where there is none."""
        full = self.node.resolve_topic_name(name)
        found: dict[str, list[str]] = {}

        def look() -> bool:
            found.update(there())
            return full in found

        if not self.until(look, FOUND_WITHIN):
            raise RuntimeError(f'there is no {kind} {full}; soliton-linkage {kind} list has all')
        return found[full][0]

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Response of a service; RuntimeError where it is not there or does not answer."""
        client = self.node.create_client(service_type, name, qos_profile=SERVICE_QOS)
        if not self.until(client.service_is_ready, FOUND_WITHIN):
            name = service_type.__name__
            raise RuntimeError(f'there is no service {client.srv_name} of the type {name}')
        future = client.call_async(request)
        if not self.until(future.done, ANSWER_LIMIT):
            raise RuntimeError(f'{client.srv_name} gave no answer in {ANSWER_LIMIT:g} s')
        return future.result()


@contextmanager
def visiting() -> Iterator[Visitor]:
    """Be in the graph, until the end of the block or Ctrl-C."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        visitor = Visitor()
        try:
            yield visitor
        finally:
            visitor.leave()
    finally:
        rclpy.try_shutdown()


Verb = Callable[[Visitor, argparse.Namespace], None]


class Verbs:
    """Verbs of a command, each with arguments of its own."""

    def __init__(self, command: str, description: str | None) -> None:
        self._parser = PlainParser(prog=f'soliton-linkage {command}', description=description)
        self._verbs = self._parser.add_subparsers(metavar='VERB', required=True)

    def add(self, name: str, verb: Verb, summary: str) -> argparse.ArgumentParser:
        """Add a verb; return its parser, which is to be given its arguments."""
        parser: argparse.ArgumentParser = self._verbs.add_parser(
            name, help=summary, description=f'{summary[0].upper()}{summary[1:]}.'
        )
        parser.set_defaults(verb=verb)
        return parser

    def run(self, arguments: list[str]) -> int:
        """Parse the arguments, run the verb in the graph and return the exit code."""
        complete(self._parser)
        options = self._parser.parse_args(arguments)
        with visiting() as visitor:
            options.verb(visitor, options)
        return 0
