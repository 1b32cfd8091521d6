# SPDX-License-Identifier: Apache-2.0
"""Services of the graph, offered to clients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, InvalidStateError
from concurrent.futures import TimeoutError as LateError
from contextlib import suppress
from typing import Any

from foxglove import Schema
from foxglove.websocket import (
    MessageSchema,
    Service,
    ServiceRequest,
    ServiceSchema,
    WebSocketServer,
)
from rclpy.client import Client
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from soliton_linkage_nodes.bags.stored_topic import service_definitions
from soliton_linkage_nodes.messages.fields import interface_type
from soliton_linkage_nodes.runtime.guarded import SERVICE_QOS

_LONGEST_ANSWER = 10.0
"""Longest time for the answer of a service [s]."""
_PARTS_OF_ACTIONS = '/_action/'
"""Part of the name of a service that belongs to an action."""

Ask = Callable[[Callable[[], None]], None]
"""Function that queues work for the executor."""
Complain = Callable[[str, str], None]
"""Function that reports a name and the reason of a rejection."""


class CalledService:
    """A service of the graph that clients may call."""

    def __init__(self, node: Node, name: str, type_: str, ask: Ask, complain: Complain) -> None:
        """Describe it to clients; raise ValueError if its type is not installed."""
        self.name, self.type = name, type_
        # Only packages of ROS are imported, because the name is foreign input.
        request, response = (
            MessageSchema(
                encoding='cdr',
                schema=Schema(name=f'{type_}_{half}', encoding='ros2msg', data=text.encode()),
            )
            for half, text in zip(('Request', 'Response'), service_definitions(type_), strict=True)
        )
        self._service_type = interface_type(type_, 'srv')
        self.offered = Service(
            name,
            schema=ServiceSchema(type_, request=request, response=response),
            handler=self._answer,
        )
        """Description for the server."""
        self._node, self._ask, self._complain = node, ask, complain
        self._client: Client | None = None
        self._waiting: list[tuple[ServiceRequest, Future[bytes]]] = []

    def poll(self) -> None:
        """Call the service for waiting clients, once it is available."""
        if not self._waiting:
            return
        if self._client is None:
            self._client = self._node.create_client(
                self._service_type, self.name, qos_profile=SERVICE_QOS
            )
        if self._client.service_is_ready():
            waiting, self._waiting = self._waiting, []
            for request, answer in waiting:
                self._call(self._client, request, answer)
        else:
            self._waiting = [each for each in self._waiting if not each[1].done()]

    def close(self) -> None:
        """Destroy the client and fail waiting calls."""
        for _, answer in self._waiting:
            _conclude(answer, ValueError(f'{self.name} is gone'))
        self._waiting.clear()
        if self._client is not None:
            self._node.destroy_client(self._client)

    def _answer(self, request: ServiceRequest) -> bytes:
        """Return the answer of the service, on a thread of the server."""
        answer: Future[bytes] = Future()
        self._ask(lambda: self._waiting.append((request, answer)))
        try:
            return answer.result(_LONGEST_ANSWER)
        except LateError:
            answer.cancel()
            raise ValueError(f'{self.name} has not answered in {_LONGEST_ANSWER:g} s') from None

    def _call(self, client: Client, asked: ServiceRequest, answer: Future[bytes]) -> None:
        try:
            future = client.call_async(self._request(asked))
        except ValueError as error:
            self._complain(self.name, str(error))
            _conclude(answer, error)
            return
        future.add_done_callback(
            lambda done: _conclude(answer, done.exception() or serialize_message(done.result()))
        )

    def _request(self, asked: ServiceRequest) -> Any:
        kind = self._service_type.Request
        fields = kind.get_fields_and_field_types()
        try:
            # A request without fields is sent as one byte or none.
            return deserialize_message(asked.payload, kind) if fields else kind()
        except Exception as error:  # rclpy's own has no public name
            raise ValueError(
                f'{len(asked.payload)} bytes are no request of {self.type}'
            ) from error


class CalledServices:
    """All services of the graph except those of this node and of actions."""

    def __init__(self, node: Node, server: WebSocketServer, ask: Ask, complain: Complain) -> None:
        """Offer them on a server; report a rejected name and the reason to `complain`."""
        self.services: dict[str, CalledService] = {}
        self._node, self._server, self._ask, self._complain = node, server, ask, complain
        self._refused: dict[str, Sequence[str]] = {}

    def search(self) -> None:
        """Offer new services and withdraw those that are gone."""
        told: list[tuple[str, list[str]]] = self._node.get_service_names_and_types()
        # The graph also names services that have only clients.
        found = {name: types for name, types in told if self._node.count_services(name)}
        for name, service in list(self.services.items()):
            if service.type not in found.get(name, ()):
                self._server.remove_services([name])
                service.close()
                del self.services[name]
        own = f'{self._node.get_fully_qualified_name()}/'
        for name, types in found.items():
            refused = self._refused.get(name) == types or _PARTS_OF_ACTIONS in name
            if name in self.services or refused or name.startswith(own):
                continue
            try:
                service = CalledService(self._node, name, types[0], self._ask, self._complain)
            except ValueError as error:
                self._refused[name] = types
                self._complain(name, str(error))
            else:
                self._server.add_services([service.offered])
                self.services[name] = service

    def poll(self) -> None:
        """Call the services for waiting clients."""
        for service in self.services.values():
            service.poll()

    def close(self) -> None:
        """Close all services."""
        for service in self.services.values():
            service.close()
        self.services.clear()


def _conclude(answer: Future[bytes], result: bytes | BaseException) -> None:
    """Set the result of a call, unless it was cancelled."""
    with suppress(InvalidStateError):
        if isinstance(result, BaseException):
            answer.set_exception(result)
        else:
            answer.set_result(result)
