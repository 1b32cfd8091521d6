# SPDX-License-Identifier: Apache-2.0
"""A client of the websocket protocol of Foxglove, written from its specification."""

from __future__ import annotations

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
    """Hears what the server says, asks it for topics and to publish, and calls services."""

    def __init__(self, address: str) -> None:
        self._stack = ExitStack()
        connection = connect(address, subprotocols=[PROTOCOL], max_size=None)
        self._socket = self._stack.enter_context(connection)
        self._numbers = itertools.count(1)
        self._topics: dict[int, str] = {}
        self.information: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.heard: dict[str, list[bytes]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.answers: dict[int, bytes | str] = {}

    def listen(self, duration: float = 0.01) -> None:
        """Take what comes within a time [s]."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0:
            try:
                said = self._socket.recv(timeout=left)
            except TimeoutError:
                return
            if isinstance(said, bytes):
                if said[0] == MESSAGE_DATA:
                    number, _ = struct.unpack_from('<IQ', said, 1)
                    self.heard[self._topics[number]].append(said[13:])
                elif said[0] == SERVICE_RESPONSE:
                    _, call, length = struct.unpack_from('<III', said, 1)
                    self.answers[call] = said[13 + length :]
                continue
            self._take(json.loads(said))

    def _take(self, said: dict[str, Any]) -> None:
        if said['op'] == 'serverInfo':
            self.information = said
        elif said['op'] == 'advertise':
            self.channels |= {each['topic']: each for each in said['channels']}
        elif said['op'] == 'unadvertise':
            gone = said['channelIds']
            self.channels = {n: c for n, c in self.channels.items() if c['id'] not in gone}
        elif said['op'] == 'advertiseServices':
            self.services |= {each['name']: each for each in said['services']}
        elif said['op'] == 'unadvertiseServices':
            gone = said['serviceIds']
            self.services = {n: s for n, s in self.services.items() if s['id'] not in gone}
        elif said['op'] == 'serviceCallFailure':
            self.answers[said['callId']] = said['message']

    def subscribe(self, topic: str) -> list[bytes]:
        """Return a list to which the messages of a topic that is known are added."""
        number = next(self._numbers)
        self._topics[number] = topic
        self.heard[topic] = []
        channel = self.channels[topic]['id']
        self._say('subscribe', subscriptions=[{'id': number, 'channelId': channel}])
        return self.heard[topic]

    def unsubscribe(self, topic: str) -> None:
        number = next(number for number, name in self._topics.items() if name == topic)
        self._say('unsubscribe', subscriptionIds=[number])

    def advertise(self, topic: str, schema: str, encoding: str) -> int:
        number = next(self._numbers)
        channel = {'id': number, 'topic': topic, 'encoding': encoding, 'schemaName': schema}
        self._say('advertise', channels=[channel])
        return number

    def publish(self, number: int, data: bytes) -> None:
        self._socket.send(struct.pack('<BI', PUBLISH, number) + data)

    def call(self, name: str, data: bytes, encoding: str = 'cdr') -> int:
        """Call a service that is known; its answer, or why there is none, comes to `answers`."""
        number = next(self._numbers)
        head = (SERVICE_REQUEST, self.services[name]['id'], number, len(encoding))
        self._socket.send(struct.pack('<BIII', *head) + encoding.encode() + data)
        return number

    def close(self) -> None:
        self._stack.close()

    def _say(self, operation: str, **what: Any) -> None:
        self._socket.send(json.dumps({'op': operation, **what}))
