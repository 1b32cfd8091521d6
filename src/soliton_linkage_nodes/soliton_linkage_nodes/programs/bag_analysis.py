# SPDX-License-Identifier: Apache-2.0
"""The frames of a bag, analysed as the live node does."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from rclpy.serialization import serialize_message
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from soliton_linkage.estimation.analyser import Analysis
from soliton_linkage_nodes.bags.read.older_messages import is_older
from soliton_linkage_nodes.bags.read.reading import (
    decoder,
    find_topic,
    read_messages,
    read_topic,
)
from soliton_linkage_nodes.messages.cdr import JointStateDecoder, stamp_of
from soliton_linkage_nodes.messages.conversions import (
    JointStates,
    NamedChain,
    chain_from_msg,
    joint_states_from_msg,
)
from soliton_linkage_nodes.programs.linkage_bags import read_chain
from soliton_linkage_nodes.soliton_analyser.joint_state_analysis import JointStateAnalysis

_MOST_TOLD = 3
"""Frames that are refused, of which it is said why: a bag may be full of them."""
_LATER = 10**8
"""How much later than a frame impulses may be recorded that are earlier [ns]: tens of
milliseconds, as topics come in no order of each other."""

_Message = tuple[Connection, int, bytes]


def analysed(
    reader: Reader, given: NamedChain | None = None, noise: float | None = None
) -> Iterator[tuple[JointStates, Analysis | None]]:
    """Yield each frame of a bag with what it shows, None where it is late, as the live node does.

    Impulses act by their stamps, without one in the order of the bag. The chain is the given one
    or that of the bag. What is refused is passed over, with a word on stderr of the first few.
    Raises ValueError where the bag has no frames, or no chain.
    """
    analysis = JointStateAnalysis(noise)
    joints = find_topic(reader, 'joint_states')
    connections = [joints]
    if given is None:
        first = next((message for _, message in read_topic(reader, 'chain')), None)
        analysis.learn(read_chain(reader) if first is None else chain_from_msg(first))
        connections.append(find_topic(reader, 'chain'))
    else:
        analysis.learn(given)
    decode_joints = _decoder(joints)
    chain_decoders = {connection.id: decoder(connection) for connection in connections[1:]}
    impulses = _impulses_of(reader)
    messages = read_messages(reader, [*connections, *impulses])
    frames, kicks = _Refusals('joint_states', 'frames'), _Refusals('rotor_impulses', 'messages')
    for connection, _, serialized in _told_early(messages, impulses):
        if connection in impulses:
            with kicks.told():
                analysis.push(_as_now(connection, serialized))
        elif connection is not joints:
            analysis.learn(chain_from_msg(chain_decoders[connection.id](serialized)))
        else:
            with frames.told():
                frame = decode_joints(serialized)
                yield frame, analysis.analyse(frame)
    frames.end()
    kicks.end()


class _Refusals:
    """Messages of a topic that were refused, of which the first few are told on stderr."""

    def __init__(self, topic: str, what: str) -> None:
        self._topic, self._what, self._count = topic, what, 0

    @contextmanager
    def told(self) -> Iterator[None]:
        """Count a ValueError, and go on."""
        try:
            yield
        except ValueError as error:
            self._count += 1
            if self._count <= _MOST_TOLD:
                print(f'refused {self._topic}: {error}', file=sys.stderr)

    def end(self) -> None:
        """Tell how many there were, if not each was told."""
        if self._count > _MOST_TOLD:
            print(f'refused {self._topic}: {self._count} {self._what} in all', file=sys.stderr)


def _impulses_of(reader: Reader) -> list[Connection]:
    """The topic `rotor_impulses` of a bag, if it has one."""
    try:
        return [find_topic(reader, 'rotor_impulses')]
    except ValueError:
        return []


def _told_early(messages: Iterable[_Message], early: list[Connection]) -> Iterator[_Message]:
    """Messages in their order, but impulses with a stamp before frames received just before."""
    held: deque[_Message] = deque()
    if not early:
        yield from messages
        return
    try:
        for message in messages:
            connection, received, serialized = message
            if connection in early and stamp_of(serialized):
                yield message
                continue
            held.append(message)
            while held[0][1] < received - _LATER:
                yield held.popleft()
    except ValueError:
        yield from held
        raise
    yield from held


def _as_now(connection: Connection, serialized: bytes) -> bytes:
    """A message as its type is defined now."""
    if not is_older(connection):
        return serialized
    return bytes(serialize_message(decoder(connection)(serialized)))


def _decoder(connection: Connection) -> Callable[[bytes], JointStates]:
    """What decodes the joint states of a topic, whatever definition they were recorded with."""
    if not is_older(connection):
        return JointStateDecoder().decode
    decode = decoder(connection)
    return lambda serialized: joint_states_from_msg(decode(serialized))
