# SPDX-License-Identifier: Apache-2.0
"""Readers of untrusted bytes, each with valid examples; a rejection has one line."""

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import Float64

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.bags.guards import BagLimits, load_json, load_yaml
from soliton_linkage_nodes.bags.metadata import METADATA_FILE
from soliton_linkage_nodes.bags.reading import decoder, open_bag, type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.recovery import check_bag, recover_bag
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.messages.cdr import ImpulseDecoder, JointStateDecoder
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    chain_from_msg,
    chain_to_msg,
    default_joint_names,
    frame_to_msg,
    impulses_to_msg,
)
from soliton_linkage_nodes.messages.state_conversions import solitons_from_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import stamp_of, time_to_msg

sys.path.append(str(Path(__file__).parents[1] / 'nodes'))

from recordings import as_sqlite3, data_file

LIMITS = BagLimits(max_unpacked=2**20, max_unpacked_file=2**22)
START = 1_700_000_000 * 10**9
SPLICES = (
    b'\x00' * 8,
    b'\xff' * 8,
    b'\x7f\xff\xff\xff',
    b'\x28\xb5\x2f\xfd',
    b'&a [*a, *a]',
    b'[' * 50,
    b'-.inf',
)
"""Byte patterns for corruptions, besides random bytes."""
_CRC_PLACE = 24
"""Offset of the checksum in a chunk header [B], after two stamps and a size."""


@dataclass(frozen=True)
class Target:
    """A reader under test and the valid examples to corrupt."""

    feed: Callable[[bytes], object]
    examples: Callable[[], Sequence[bytes]]


def refused(act: Callable[[], object]) -> None:
    """Run a reader; AssertionError if it rejects the input with more than one line."""
    try:
        act()
    except (ValueError, OSError) as error:
        if '\n' in str(error):
            raise AssertionError(f'more than a line: {error}') from error


def wounded(examples: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Return a corrupted example: bytes changed, deleted, inserted or duplicated."""
    wound = st.tuples(
        st.floats(0, 1),
        st.sampled_from(['flip', 'cut', 'put', 'over', 'twice', 'end']),
        st.one_of(st.binary(min_size=1, max_size=12), st.sampled_from(SPLICES)),
    )
    return st.builds(_with_wounds, st.sampled_from(examples), st.lists(wound, max_size=6))


def _with_wounds(example: bytes, wounds: Sequence[tuple[float, str, bytes]]) -> bytes:
    content = bytearray(example)
    for where, kind, data in wounds:
        place = int(where * len(content))
        end = place + len(data)
        if kind == 'flip' and place < len(content):
            content[place] ^= 1 << (data[0] % 8)
        elif kind == 'cut':
            del content[place : place + 8 * len(data)]
        elif kind == 'put':
            content[place:place] = data
        elif kind == 'over':
            content[place:end] = data
        elif kind == 'twice':
            content[end:end] = content[place : place + 64 * len(data)]
        elif kind == 'end':
            del content[place:]
    return bytes(content)


@cache
def _named() -> NamedChain:
    return NamedChain(Chain(number_of_rotors=5), default_joint_names(5))


@cache
def _messages() -> dict[str, bytes]:
    named, stamp = _named(), time_to_msg(START)
    angles = named.chain.uniform_state(-1)
    state = msg.SolitonState(motion_name='flipper', solitons=[msg.Soliton(rotor=3.5)])
    return {
        interfaces.CHAIN.name: serialize_message(chain_to_msg(named, stamp)),
        interfaces.JOINT_STATES.name: serialize_message(
            frame_to_msg(named, Frame(angles, angles), angles, stamp)
        ),
        interfaces.SOLITON_STATE.name: serialize_message(state),
        interfaces.NUDGE.name: serialize_message(Float64(data=3.0)),
    }


@cache
def _bag(storage: str, compression: str = 'none') -> tuple[bytes, bytes]:
    """The file of a small whole bag, and its metadata.yaml."""
    with tempfile.TemporaryDirectory() as folder:
        writer = BagWriter(Path(folder, 'x'), compression)
        for topic in (
            interfaces.CHAIN,
            interfaces.JOINT_STATES,
            interfaces.SOLITON_STATE,
            interfaces.NUDGE,
        ):
            serialized = _messages()[topic.name]
            stored = writer.add_topic(f'/{topic.name}', type_name(topic.type), topic.qos)
            for number in range(3):
                writer.write(stored, START + number, serialized)
        writer.close({'lost_messages': '{"/nudge": 1}'})
        if storage == 'sqlite3':
            as_sqlite3(writer.path)
        file = data_file(writer.path)
        return file.read_bytes(), (writer.path / METADATA_FILE).read_bytes()


def _unchecked(content: bytes) -> bytes:
    """An MCAP file whose chunks have no checksums, so that corruptions reach the reader."""
    changed = bytearray(content)
    size = len(mcap.MAGIC)
    for place, opcode, _ in mcap.records_in(content[size:]):
        if opcode == mcap.Opcode.CHUNK:
            begin = size + place + mcap.RECORD_HEADER.size + _CRC_PLACE
            changed[begin : begin + 4] = bytes(4)
    return bytes(changed)


def _feed_bag(suffix: str, content: bytes, metadata: bytes | None = None) -> None:
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, 'x_0')
        bag.mkdir()
        (bag / f'x_0_0{suffix}').write_bytes(content)
        if metadata is not None:
            (bag / METADATA_FILE).write_bytes(metadata)
        refused(lambda: check_bag(bag, limits=LIMITS))
        refused(lambda: recover_bag(bag, Path(folder, 'new'), limits=LIMITS))
        for path in (bag, bag / f'x_0_0{suffix}'):
            refused(lambda path=path: _read(path))


def _read(path: Path) -> None:
    with open_bag(path, LIMITS) as reader:
        decoders = {}
        for topic in reader.topics:
            with suppress(ValueError):
                decoders[topic] = decoder(topic)
        for topic, _, serialized in reader.messages(reader.topics):
            if topic in decoders:
                refused(lambda t=topic, s=serialized: decoders[t](s))


def _feed_definition(content: bytes) -> None:
    """Read joint states with the definition in the bag."""
    text, _, serialized = content.partition(b'\x00\x00\x00\x00')
    name = type_name(interfaces.JOINT_STATES.type)
    definition = text.decode(errors='replace')
    topic = StoredTopic(1, '/x', name, definition, 'ros2msg', 'RIHS01_x', '')
    refused(lambda: decoder(topic)(serialized))


def _definitions() -> Sequence[bytes]:
    store = get_typestore(Stores.ROS2_JAZZY)
    text, _ = store.generate_msgdef(type_name(interfaces.JOINT_STATES.type), ros_version=2)
    return [text.encode() + bytes(4) + _messages()[interfaces.JOINT_STATES.name]]


def _feed_chain(content: bytes) -> None:
    topic = interfaces.CHAIN
    stored = StoredTopic(1, '/chain', type_name(topic.type), '', '', '', '')
    refused(lambda: chain_from_msg(decoder(stored)(content)))


def _feed_states(content: bytes) -> None:
    topic = interfaces.SOLITON_STATE
    stored = StoredTopic(1, '/soliton_state', type_name(topic.type), '', '', '', '')
    refused(lambda: solitons_from_msg(decoder(stored)(content)))


def _feed_joint_states(content: bytes) -> None:
    decoding = JointStateDecoder()
    decoding.decode(_messages()[interfaces.JOINT_STATES.name])
    refused(lambda: decoding.decode(content))
    refused(lambda: stamp_of(content))
    refused(lambda: JointStateDecoder().decode(content))


def _impulses() -> Sequence[bytes]:
    return [serialize_message(impulses_to_msg(_named(), np.full(5, 0.1), time_to_msg(START)))]


def _feed_impulses(content: bytes) -> None:
    names = {name: number for number, name in enumerate(_named().joint_names)}
    decoding = ImpulseDecoder(names, 10.0)
    decoding.decode(_impulses()[0])
    refused(lambda: decoding.decode(content))


def _feed_text(content: bytes) -> None:
    text = content.decode(errors='replace')
    refused(lambda: load_json(text))
    with suppress(ValueError):
        load_yaml(text)


def _of(*topics: interfaces.Topic) -> Callable[[], Sequence[bytes]]:
    return lambda: [_messages()[topic.name] for topic in topics]


TARGETS = {
    'mcap': Target(
        lambda content: _feed_bag('.mcap', content, _bag('mcap')[1]),
        lambda: [_bag('mcap')[0], _bag('mcap', 'zstd')[0], _unchecked(_bag('mcap')[0])],
    ),
    'sqlite3': Target(
        lambda content: _feed_bag('.db3', content, _bag('sqlite3')[1]),
        lambda: [_bag('sqlite3')[0]],
    ),
    'metadata': Target(
        lambda content: _feed_bag('.mcap', _bag('mcap')[0], content), lambda: [_bag('mcap')[1]]
    ),
    'text': Target(_feed_text, lambda: [_bag('mcap')[1], b'{"/nudge": 1, "/chain": [2, "x"]}']),
    'joint_states': Target(_feed_joint_states, _of(interfaces.JOINT_STATES)),
    'impulses': Target(_feed_impulses, _impulses),
    'chain': Target(_feed_chain, _of(interfaces.CHAIN)),
    'soliton_state': Target(_feed_states, _of(interfaces.SOLITON_STATE)),
    'definition': Target(_feed_definition, _definitions),
}


def corpus(name: str) -> Iterator[Path]:
    """Return the files of inputs that were once not rejected correctly."""
    yield from sorted(Path(__file__).parent.glob(f'corpus/{name}-*'))
