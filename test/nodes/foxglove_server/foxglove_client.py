# SPDX-License-Identifier: Apache-2.0
"""Client of the websocket protocol of Foxglove, written from its specification."""

import itertools
import json
import struct
import time
from contextlib import ExitStack
from typing import Any

from websockets.sync.client import connect
from websockets.typing import Subprotocol

PROTOCOL = Subprotocol('foxglove.sdk.v1')
MESSAGE_DATA, PUBLISH = 1, 1
SERVICE_REQUEST, SERVICE_RESPONSE = 2, 3


class FoxgloveClient:
    """Client that subscribes to topics, publishes messages and calls services."""

    def __init__(self, address: str) -> None:
        self._stack = ExitStack()
        connection = connect(address, subprotocols=[PROTOCOL], max_size=None)
        self._socket = self._stack.enter_context(connection)
        self._numbers = itertools.count(1)
        self._topics: dict[int, str] = {}
        self.information: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.received: dict[str, list[bytes]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.answers: dict[int, bytes | str] = {}

    def read(self, duration: float = 0.01) -> None:
        """Process the messages of a time [s]."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0:
            try:
                message = self._socket.recv(timeout=left)
            except TimeoutError:
                return
            if isinstance(message, bytes):
                if message[0] == MESSAGE_DATA:
                    number, _ = struct.unpack_from('<IQ', message, 1)
                    self.received[self._topics[number]].append(message[13:])
                elif message[0] == SERVICE_RESPONSE:
                    _, call, length = struct.unpack_from('<III', message, 1)
                    self.answers[call] = message[13 + length :]
                continue
            self._take(json.loads(message))

    def _take(self, message: dict[str, Any]) -> None:
        if message['op'] == 'serverInfo':
            self.information = message
        elif message['op'] == 'advertise':
            self.channels |= {each['topic']: each for each in message['channels']}
        elif message['op'] == 'unadvertise':
            gone = message['channelIds']
            self.channels = {n: c for n, c in self.channels.items() if c['id'] not in gone}
        elif message['op'] == 'advertiseServices':
            self.services |= {each['name']: each for each in message['services']}
        elif message['op'] == 'unadvertiseServices':
            gone = message['serviceIds']
            self.services = {n: s for n, s in self.services.items() if s['id'] not in gone}
        elif message['op'] == 'serviceCallFailure':
            self.answers[message['callId']] = message['message']

    def subscribe(self, topic: str) -> list[bytes]:
        """Return a list to which each message of an advertised topic is added."""
        number = next(self._numbers)
        self._topics[number] = topic
        self.received[topic] = []
        channel = self.channels[topic]['id']
        self._send('subscribe', subscriptions=[{'id': number, 'channelId': channel}])
        return self.received[topic]

    def unsubscribe(self, topic: str) -> None:
        number = next(number for number, name in self._topics.items() if name == topic)
        self._send('unsubscribe', subscriptionIds=[number])

    def advertise(self, topic: str, schema: str, encoding: str) -> int:
        number = next(self._numbers)
        channel = {'id': number, 'topic': topic, 'encoding': encoding, 'schemaName': schema}
        self._send('advertise', channels=[channel])
        return number

    def publish(self, number: int, data: bytes) -> None:
        self._socket.send(struct.pack('<BI', PUBLISH, number) + data)

    def call(self, name: str, data: bytes, encoding: str = 'cdr') -> int:
        """Call an advertised service; its response or error is put into `answers`."""
        number = next(self._numbers)
        head = (SERVICE_REQUEST, self.services[name]['id'], number, len(encoding))
        self._socket.send(struct.pack('<BIII', *head) + encoding.encode() + data)
        return number

    def close(self) -> None:
        self._stack.close()

    def _send(self, operation: str, **fields: Any) -> None:
        self._socket.send(json.dumps({'op': operation, **fields}))
