# SPDX-License-Identifier: Apache-2.0
"""The frames of a bag, analysed as the live node does, and their states as rows of a table."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from typing import Any

from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState

from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.bags import decoder, find_topic, read_chain, read_messages, read_topic
from soliton_linkage_nodes.conversions import NamedChain, chain_from_msg, time_from_msg
from soliton_linkage_nodes.joint_state_analysis import JointStateAnalysis

_ONE_SOLITON = 'soliton_'


def analysed(
    reader: Reader, given: NamedChain | None = None, noise: float | None = None
) -> Iterator[tuple[JointState, SolitonState | None]]:
    """Yield each frame of a bag with its state, None where it is late, as the live node does.

    The chain is the given one or that of the bag. Frames that are refused are passed over, with
    a word on stderr. Raises ValueError where the bag has no frames, or no chain.
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
    decoders = {connection.id: decoder(connection) for connection in connections}
    for connection, _, serialized in read_messages(reader, connections):
        message = decoders[connection.id](serialized)
        if connection is not joints:
            analysis.learn(chain_from_msg(message))
            continue
        try:
            yield message, analysis.analyse(message)
        except ValueError as error:
            print(f'refused joint_states: {error}', file=sys.stderr)


def columns() -> list[str]:
    """Names of the columns of the table: those of the fields of SolitonState.

    Fields of the nested messages have the name of theirs before them, those of the first
    soliton `soliton_`.
    """
    return list(row(SolitonState(solitons=[Soliton()])))


def row(state: SolitonState) -> dict[str, Any]:
    """A state as a row of the table; the soliton's cells are NaN where there is none."""
    cells: dict[str, Any] = {'stamp_ns': time_from_msg(state.header.stamp)}
    for name in state.get_fields_and_field_types():
        value = getattr(state, name)
        if name == 'header':
            continue
        if name == 'solitons':
            cells[name] = len(value)
            cells.update(_nested(_ONE_SOLITON, value[0] if value else Soliton(), bool(value)))
        elif hasattr(value, 'get_fields_and_field_types'):
            cells.update(_nested(f'{name}_', value, True))
        else:
            cells[name] = value
    return cells


def _nested(prefix: str, message: Any, there: bool) -> dict[str, Any]:
    names = message.get_fields_and_field_types()
    return {prefix + name: getattr(message, name) if there else math.nan for name in names}
