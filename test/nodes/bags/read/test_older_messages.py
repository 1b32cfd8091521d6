# SPDX-License-Identifier: Apache-2.0
"""Bags with older message definitions are readable: missing fields have defaults."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings import START, run_of, write_bag
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from soliton_linkage_msgs.msg import Chain, Cycle, Soliton, SolitonState
from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.reading import (
    find_topic,
    is_older,
    open_bag,
    read_topic,
    type_name,
)
from soliton_linkage_nodes.bags.stored_topic import profiles_text, type_definition
from soliton_linkage_nodes.runtime import interfaces


def write_older(path: Path, topic: str, name: str, without: str, fields: dict[str, Any]) -> Path:
    """A bag with one message of a type from whose definition some lines are left out."""
    definition = '\n'.join(
        line for line in type_definition(name)[0].splitlines() if without not in line
    )
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, name))
    message = store.types[name](**{key: made(store, value) for key, value in fields.items()})
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.open()
    profiles = parse_qos(profiles_text([interfaces.CHAIN.qos]))
    connection = writer.add_connection(topic, name, typestore=store, offered_qos_profiles=profiles)
    writer.write(connection, START, store.serialize_cdr(message, name))
    writer.close()
    return path


def made(store: Any, value: Any) -> Any:
    """Make messages of pairs of a type's name and its fields."""
    if isinstance(value, tuple):
        kind, fields = value
        return store.types[kind](**{key: made(store, one) for key, one in fields.items()})
    return [made(store, one) for one in value] if isinstance(value, list) else value


HEADER = (
    'std_msgs/msg/Header',
    {'stamp': ('builtin_interfaces/msg/Time', {'sec': 7, 'nanosec': 8}), 'frame_id': 'linkage'},
)


@pytest.fixture
def older_chain(tmp_path):
    definition = Chain.get_fields_and_field_types()
    fields: dict[str, Any] = {'header': HEADER, 'joint_names': ['a', 'b']}
    for name, kind in definition.items():
        if kind == 'double' and 'damping' not in name:
            fields[name] = 0.25
        elif kind == 'boolean':
            fields[name] = True
        elif kind == 'uint32':
            fields[name] = 2
        elif kind == 'sequence<double>' and 'damping' not in name:
            fields[name] = np.array([0.5])
    return write_older(tmp_path / 'run_0', '/chain', type_name(Chain), 'damping', fields)


def test_an_older_message_is_filled_by_name(older_chain):
    with open_bag(older_chain) as reader:
        assert is_older(find_topic(reader, 'chain'))
        ((stamp, message),) = read_topic(reader, 'chain')
    assert stamp == START
    assert (message.header.stamp.sec, message.header.frame_id) == (7, 'linkage')
    assert message.joint_names == ['a', 'b']
    assert message.stiffness == 0.25
    assert list(message.mass_deviations) == [0.5]
    assert message.damping == Chain().damping


def test_an_older_message_is_played_as_one_of_today(graph, older_chain):
    heard = graph.hear(interfaces.CHAIN)
    graph.start(BagPlayer, {'bag': str(older_chain)})
    graph.until(lambda: heard, 'the chain')
    assert heard[0].joint_names == ['a', 'b']


def parts(message: Any, without: str) -> Any:
    """Type and fields of a message for `made`, without fields that begin with a prefix."""
    if isinstance(message, list):
        return [parts(each, without) for each in message]
    if not hasattr(message, 'get_fields_and_field_types'):
        return message
    names = message.get_fields_and_field_types()
    kept = {name: getattr(message, name) for name in names if not name.startswith(without)}
    fields = {name: parts(value, without) for name, value in kept.items()}
    return type_name(type(message)), fields


def test_messages_within_messages_are_filled_as_well(tmp_path):
    walls = [Soliton(rotor=1.5, velocity=9.0), Soliton(rotor=2.5, velocity=9.0)]
    today = SolitonState(motion_name='spinner', solitons=walls, cycle=Cycle(phase=0.5))
    name, fields = parts(today, 'velocity')
    bag = write_older(tmp_path / 'run_0', '/soliton_state', name, ' velocity', fields)
    with open_bag(bag) as reader:
        ((_, message),) = read_topic(reader, 'soliton_state')
    assert message.motion_name == 'spinner'
    assert message.cycle.phase == 0.5
    assert [one.rotor for one in message.solitons] == [1.5, 2.5]
    assert [one.velocity for one in message.solitons] == [0.0, 0.0]


def test_messages_of_today_are_not_older(named, tmp_path):
    with open_bag(write_bag(tmp_path / 'run', run_of(named, 2))) as reader:
        assert not any(map(is_older, reader.topics))


def test_a_message_that_does_not_fit_its_definition_is_a_value_error(older_chain):
    (data,) = older_chain.glob('*.mcap')
    whole = data.read_bytes()
    place = whole.index(b'linkage\x00') - 4
    data.write_bytes(whole[:place] + b'\xff\xff\xff\x7f' + whole[place + 4 :])
    with open_bag(older_chain) as reader, pytest.raises(ValueError, match='does not fit'):
        list(read_topic(reader, 'chain'))
