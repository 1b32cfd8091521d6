# SPDX-License-Identifier: Apache-2.0
"""Access of Foxglove clients to the services of the ROS graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, InvalidStateError
from concurrent.futures import TimeoutError as LateError
from contextlib import suppress

from foxglove import Schema, websocket
from rclpy.client import Client
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from soliton_linkage_nodes.bags.stored_topic import service_definitions
from soliton_linkage_nodes.messages.fields import interface_type
from soliton_linkage_nodes.runtime.guarded import SERVICE_QOS
from soliton_linkage_nodes.runtime.serialization import serialize

Queue = Callable[[Callable[[], None]], None]
"""Function that queues a callback for execution by the executor of the node."""
Reject = Callable[[str, str], None]
"""Function that logs the name of a rejected topic or service, and the reason."""


class OfferedService:
    """Service of the ROS graph that clients may call."""

    def __init__(self, node: Node, name: str, type_: str, queue: Queue, reject: Reject) -> None:
        """Describe the service for clients. Raises ValueError if the type is not installed."""
        self.name, self.type = name, type_
        self.answer_timeout = 10.0
        """Longest wait for the response of the service [s]."""
        # The name of the type comes from an untrusted source. Therefore import only ROS packages.
        request, response = (
            websocket.MessageSchema(
                encoding='cdr',
                schema=Schema(name=f'{type_}_{half}', encoding='ros2msg', data=text.encode()),
            )
            for half, text in zip(('Request', 'Response'), service_definitions(type_), strict=True)
        )
        self._service_type = interface_type(type_, 'srv')
        schema = websocket.ServiceSchema(type_, request=request, response=response)
        self.description = websocket.Service(name, schema=schema, handler=self._respond)
        self._node, self._queue, self._reject = node, queue, reject
        self._client: Client | None = None
        self._waiting: list[tuple[websocket.ServiceRequest, Future[bytes]]] = []

    def poll(self) -> None:
        """Send the waiting requests to the service if it is available."""
        if not self._waiting:
            return
        if self._client is None:
            create, kind = self._node.create_client, self._service_type
            self._client = create(kind, self.name, qos_profile=SERVICE_QOS)
        if self._client.service_is_ready():
            waiting, self._waiting = self._waiting, []
            for request, answer in waiting:
                self._call(self._client, request, answer)
        else:
            self._waiting = [each for each in self._waiting if not each[1].done()]

    def close(self) -> None:
        """Destroy the ROS client of the service. The waiting requests end with an error."""
        for _, answer in self._waiting:
            _set_result(answer, ValueError(f'{self.name} ended'))
        self._waiting.clear()
        if self._client is not None:
            self._node.destroy_client(self._client)

    def _respond(self, request: websocket.ServiceRequest) -> bytes:
        """Return the response to a request. The server calls this method on its own threads."""
        answer: Future[bytes] = Future()
        self._queue(lambda: self._waiting.append((request, answer)))
        try:
            return answer.result(self.answer_timeout)
        except LateError:
            answer.cancel()
            raise ValueError(f'{self.name} did not respond in {self.answer_timeout:g} s') from None

    def _call(
        self, client: Client, request: websocket.ServiceRequest, answer: Future[bytes]
    ) -> None:
        kind = self._service_type.Request
        try:
            # The payload of a request without fields has one byte or no byte.
            empty = not kind.get_fields_and_field_types()
            message = kind() if empty else deserialize_message(request.payload, kind)
        except Exception:  # the type of this error in rclpy has no public name
            reason = f'{len(request.payload)} bytes are not a request of type {self.type}'
            self._reject(self.name, reason)
            _set_result(answer, ValueError(reason))
            return
        client.call_async(message).add_done_callback(
            lambda done: _set_result(answer, done.exception() or serialize(done.result()))
        )


class OfferedServices:
    """Services of the ROS graph that clients may call.

    Services of this node and services of actions are not offered.
    """

    def __init__(
        self, node: Node, server: websocket.WebSocketServer, queue: Queue, reject: Reject
    ) -> None:
        """Offer services on `server`. Call `reject` for each service of an unknown type."""
        self.services: dict[str, OfferedService] = {}
        self._node, self._server, self._queue, self._reject = node, server, queue, reject
        self._rejected: dict[str, Sequence[str]] = {}

    def search(self) -> None:
        """Offer new services, and withdraw services that no longer exist."""
        listed: list[tuple[str, list[str]]] = self._node.get_service_names_and_types()
        # The graph also lists services that have clients but no server.
        found = {name: types for name, types in listed if self._node.count_services(name)}
        for name, service in list(self.services.items()):
            if service.type not in found.get(name, ()):
                self._server.remove_services([name])
                service.close()
                del self.services[name]
        own = f'{self._node.get_fully_qualified_name()}/'
        for name, types in found.items():
            hidden = '/_action/' in name or name.startswith(own)
            if name in self.services or self._rejected.get(name) == types or hidden:
                continue
            try:
                service = OfferedService(self._node, name, types[0], self._queue, self._reject)
            except ValueError as error:
                self._rejected[name] = types
                self._reject(name, str(error))
            else:
                self._server.add_services([service.description])
                self.services[name] = service

    def poll(self) -> None:
        """Send the waiting requests of all services."""
        for service in self.services.values():
            service.poll()

    def close(self) -> None:
        """Close all services."""
        for service in self.services.values():
            service.close()
        self.services.clear()


def _set_result(answer: Future[bytes], result: bytes | BaseException) -> None:
    with suppress(InvalidStateError):
        if isinstance(result, BaseException):
            answer.set_exception(result)
        else:
            answer.set_result(result)
