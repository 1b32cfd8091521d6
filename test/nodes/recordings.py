# SPDX-License-Identifier: Apache-2.0
"""Synthetic bags with known messages."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.bags.reading import open_bag, type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    chain_to_msg,
    frame_to_msg,
    joint_states_from_msg,
)
from soliton_linkage_nodes.messages.joint_state_analysis import JointStateAnalysis
from soliton_linkage_nodes.messages.state_conversions import state_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg, time_to_msg

START = 1_700_000_000 * 10**9
MILLISECOND = 10**6

Entry = tuple[interfaces.Topic, int, Any]


def frame_message(named: NamedChain, number: int) -> JointState:
    """One frame of a chain whose rotors turn evenly."""
    angles = named.chain.uniform_state(-1) + 0.01 * number
    frame = Frame(angles, np.full(named.rotors, 0.5))
    return frame_to_msg(named, frame, 0 * angles, time_to_msg(START + number * MILLISECOND))


def run_of(named: NamedChain, frames: int, gap: int = MILLISECOND) -> list[Entry]:
    """A nudge, frames at even times, and the chain, which comes last."""
    entries: list[Entry] = [(interfaces.NUDGE, START, Float64(data=3.0))]
    for number in range(frames):
        message = frame_message(named, number)
        entries.append((interfaces.JOINT_STATES, START + number * gap, message))
    last = START + frames * gap
    return [*entries, (interfaces.CHAIN, last, chain_to_msg(named, time_to_msg(START)))]


def write_bag(
    name: Path,
    entries: Sequence[Entry],
    storage: str = 'mcap',
    namespace: str = '',
    gaps: Sequence[tuple[int, int]] = (),
) -> Path:
    """Write a bag with some times without recording [ns] and return its path."""
    writer = BagWriter(name)
    for gap in gaps:
        writer.add_gap(*gap)
    connections = {}
    for topic, stamp, message in entries:
        full_name = f'{namespace}/{topic.name.lstrip("/")}'
        if full_name not in connections:
            connections[full_name] = writer.add_topic(full_name, type_name(topic.type), topic.qos)
        writer.write(connections[full_name], stamp, serialize_message(message))
    writer.close({})
    if storage == 'sqlite3':
        as_sqlite3(writer.path)
    return writer.path


def as_sqlite3(bag: Path) -> None:
    """Turn a bag into a sqlite3 bag, as the writer of rosbags writes it."""
    whole = bag.with_name(f'{bag.name}.mcap')
    bag.rename(whole)
    with (
        open_bag(whole) as reader,
        Writer(bag, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer,
    ):
        for key, value in reader.custom_data.items():
            writer.set_custom_data(key, value)
        written = {
            each: writer.add_connection(
                each.name,
                each.type_name,
                msgdef=each.definition,
                rihs01=each.digest,
                offered_qos_profiles=parse_qos(each.profiles),
            )
            for each in reader.topics
        }
        for each, stamp, data in reader.messages(reader.topics):
            writer.write(written[each], stamp, data)
    shutil.rmtree(whole)


def change_metadata(bag: Path, **changes: object) -> None:
    """Change the content of metadata.yaml."""
    path = bag / 'metadata.yaml'
    told = yaml.safe_load(path.read_text())
    told['rosbag2_bagfile_information'].update(changes)
    path.write_text(yaml.safe_dump(told, sort_keys=False))


def data_file(bag: Path) -> Path:
    (found,) = (path for path in bag.iterdir() if path.suffix in ('.mcap', '.db3'))
    return found


def contents(bag: Path) -> list[tuple[str, int, bytes]]:
    """Name of the topic, stamp and serialized message of each message."""
    with open_bag(bag) as reader:
        found = [(each.name, t, data) for each, t, data in reader.messages(reader.topics)]
        assert reader.message_count == len(found)
    return found


def messages_of(bag: Path) -> dict[str, list[bytes]]:
    with open_bag(bag) as reader:
        held: dict[str, list[bytes]] = {topic.name: [] for topic in reader.topics}
    for name, _, serialized in contents(bag):
        held[name].append(serialized)
    return held


def lost_in(bag: Path) -> dict[str, int]:
    with open_bag(bag) as reader:
        return json.loads(reader.custom_data['lost_messages'])


def analysed_states(
    named: NamedChain, frames: Sequence[JointState], **header: object
) -> list[SolitonState]:
    """Return the states of frames by the analysis without a node, with changes of the header."""
    analysis = JointStateAnalysis()
    analysis.set_chain(named)
    states = []
    for joints in map(joint_states_from_msg, frames):
        found = analysis.analyse(joints)
        assert found is not None
        states.append(state_to_msg(found, joints._replace(**header)))
    return states


def frames_of(messages: Sequence[Any]) -> list[int]:
    """Numbers of frames, or of the frames at the same times as other messages."""
    return [(time_from_msg(each.header.stamp) - START) // MILLISECOND for each in messages]


def publish_frames(publisher: Publisher, named: NamedChain, frames: int) -> list[bytes]:
    sent = [serialize_message(frame_message(named, number)) for number in range(frames)]
    for message in sent:
        publisher.publish(message)
    return sent
