# SPDX-License-Identifier: Apache-2.0
"""The intact part of a damaged file is recovered, or the failure is reported."""

import os
import random
import sqlite3
import struct
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from recordings import START, as_sqlite3, contents, data_file, run_of

from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS
from soliton_linkage_nodes.bags.metadata import SUFFIXES, storage_of
from soliton_linkage_nodes.bags.reading import open_bag, type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.recovery import check_bag, recover_bag, recovered_file
from soliton_linkage_nodes.bags.storages import mcap_records
from soliton_linkage_nodes.bags.storages.mcap_writer import McapWriter
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime.interfaces import NUDGE

Held = list[tuple[str, int, bytes]]


@pytest.fixture(params=list(SUFFIXES))
def storage(request):
    return str(request.param)


def write(
    name: Path,
    named: NamedChain,
    storage: str,
    frames: int = 40,
    per_chunk: int = 5,
    compression: str = 'none',
    finish: bool = True,
) -> Path:
    """A bag whose messages are handed on a few at a time."""
    writer = BagWriter(name, compression, flush_interval=1e9)
    topics = {}
    for number, (topic, stamp, message) in enumerate(run_of(named, frames)):
        if topic.name not in topics:
            topics[topic.name] = writer.add_topic(
                f'/{topic.name}', type_name(topic.type), topic.qos
            )
        writer.write(topics[topic.name], stamp, serialize_message(message))
        if number % per_chunk == per_chunk - 1:
            writer.flush()
    writer.set_custom_data({'lost_messages': '{"/joint_states": 3}'})
    if finish:
        writer.close()
    if storage == 'sqlite3':
        as_sqlite3(writer.path)
    return writer.path


def attempt(bag: Path, output: Path) -> Held:
    """Return the recovered messages and check that the bag is unchanged."""
    before = {path: path.read_bytes() for path in bag.iterdir()}
    report, new = recover_bag(bag, output)
    assert {path: path.read_bytes() for path in bag.iterdir()} == before
    held = contents(new)
    assert len(held) == report.messages
    return held


def rescued(file: Path) -> Held:
    """Return the intact messages and check that the file is unchanged."""
    return recovered_and_unverified(file)[0]


def recovered_and_unverified(file: Path) -> tuple[Held, int]:
    """The same, and how many of the messages are marked to be without a checksum."""
    before = file.read_bytes()
    found = recovered_file(file, storage_of(file) or '', False, DEFAULT_LIMITS)
    held = [(topic.name, each.stamp, each.data) for topic, each in found.messages()]
    assert file.read_bytes() == before
    assert all('\n' not in damage for damage in found.damage)
    return held, found.unverified


def test_a_whole_bag_comes_back_whole(named, storage, tmp_path):
    bag = write(tmp_path / 'run', named, storage)
    for given in (bag, data_file(bag)):
        report, new = recover_bag(given, tmp_path / 'new')
        assert contents(new) == contents(bag)
        assert topics_of(new) == topics_of(bag)
        assert (report.damage, report.lost) == ([], 0)
        with open_bag(new) as reader:
            custom = reader.custom_data
        assert custom['recovered_from'] == str(given)
        if given == bag:
            assert custom['lost_messages'] == '{"/joint_states": 3}'


def topics_of(bag: Path) -> list[tuple[object, ...]]:
    with open_bag(bag) as reader:
        return [(replace(each, number=0), reader.counts[each]) for each in reader.topics]


def write_nudges(name: Path, compression: str = 'none') -> Path:
    """A small bag of one topic."""
    writer = BagWriter(name, compression)
    topic = writer.add_topic('/nudge', type_name(NUDGE.type), NUDGE.qos)
    for number in range(8):
        serialized = serialize_message(NUDGE.type(data=number / 7))
        writer.write(topic, START + number, serialized)
        if number % 4 == 3:
            writer.flush()
    writer.close()
    return writer.path


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_at_every_length_all_whole_messages_of_a_cut_mcap_file_come_back(tmp_path, compression):
    data = data_file(write_nudges(tmp_path / 'run', compression))
    sent = rescued(data)
    whole = data.read_bytes()
    found = []
    for length in range(len(whole), -1, -1):
        os.truncate(data, length)
        held = rescued(data)
        assert held == sent[: len(held)]
        found.insert(0, len(held))
    assert found == sorted(found)
    assert found[-1] == 8
    if compression == 'none':
        ends = [whole.index(message) + len(message) for _, _, message in sent]
        assert found == [sum(end <= length for end in ends) for length in range(len(whole) + 1)]


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_a_flipped_byte_loses_at_most_one_chunk_and_changes_no_message(
    named, tmp_path, compression
):
    bag = write(tmp_path / 'run', named, 'mcap', 30, 5, compression)
    sent = contents(bag)
    data = data_file(bag)
    whole = data.read_bytes()
    chance = random.Random(compression)
    for _ in range(250):
        damaged = bytearray(whole)
        damaged[chance.randrange(len(whole))] ^= 1 << chance.randrange(8)
        data.write_bytes(damaged)
        held = rescued(data)
        assert set(held) <= set(sent)
        assert len(held) >= len(sent) - 5


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_no_record_becomes_a_message_by_a_flipped_bit(named, tmp_path, compression):
    bag = write(tmp_path / 'run', named, 'mcap', 30, 5, compression)
    sent = contents(bag)
    data = data_file(bag)
    whole = data.read_bytes()
    begin = len(mcap_records.MAGIC)
    changed = set()
    for offset, opcode, _ in mcap_records.records_in(whole[begin:]):
        if (opcode ^ mcap_records.Opcode.MESSAGE).bit_count() == 1:
            damaged = bytearray(whole)
            damaged[begin + offset] = mcap_records.Opcode.MESSAGE
            data.write_bytes(damaged)
            assert rescued(data) == sent
            changed.add(opcode)
    assert {mcap_records.Opcode.CHANNEL, mcap_records.Opcode.MESSAGE_INDEX} <= changed


def test_damaged_bags_give_unchanged_messages_or_an_error(named, storage, tmp_path):
    bag = write(tmp_path / 'run', named, storage, 30, 3)
    sent = set(contents(bag))
    data = data_file(bag)
    whole = data.read_bytes()
    chance = random.Random(storage)
    for _ in range(150):
        damaged = bytearray(whole)
        for _ in range(chance.randrange(1, 12)):
            begin = chance.randrange(len(whole))
            size = chance.choice([1, 1, 8, 200])
            kind = chance.choice(['noise', 'zeros', 'cut', 'insert'])
            if kind == 'noise':
                damaged[begin : begin + size] = chance.randbytes(size)
            elif kind == 'zeros':
                damaged[begin : begin + size] = bytes(size)
            elif kind == 'cut':
                del damaged[begin : begin + size]
            else:
                damaged[begin:begin] = chance.randbytes(size)
        data.write_bytes(damaged)
        held, unverified = recovered_and_unverified(data)
        assert sum(message not in sent for message in held) <= unverified


def test_messages_with_a_wrong_checksum_come_back_if_they_are_asked_for(named, tmp_path):
    bag = write(tmp_path / 'run', named, 'mcap', 30, 5)
    sent = contents(bag)
    data = data_file(bag)
    damaged = bytearray(data.read_bytes())
    damaged[damaged.index(sent[12][2]) + len(sent[12][2]) - 2] ^= 1
    data.write_bytes(damaged)
    report, new = recover_bag(bag, tmp_path / 'strict')
    assert (report.messages, report.lost) == (len(sent) - 5, 5)
    assert any('wrong checksum: 5 messages left out' in damage for damage in report.damage)
    report, new = recover_bag(bag, tmp_path / 'lenient', doubtful=True)
    assert report.messages == len(sent)
    assert len(set(contents(new)) & set(sent)) == len(sent) - 1


def test_a_bag_that_was_never_closed_comes_back_to_its_last_flush(named, tmp_path):
    bag = write(tmp_path / 'run', named, 'mcap', frames=43, per_chunk=5, finish=False)
    entries = run_of(named, 43)
    held = attempt(bag, tmp_path / 'new')
    expected = [(f'/{topic.name}', stamp) for topic, stamp, _ in entries]
    assert [(topic, stamp) for topic, stamp, _ in held] == expected[: len(entries) // 5 * 5]
    classes = {f'/{topic.name}': topic.type for topic, _, _ in entries}
    messages = [deserialize_message(data, classes[topic]) for topic, _, data in held]
    assert messages == [message for _, _, message in entries][: len(held)]


def test_definitions_are_repeated_so_that_the_first_may_be_lost(tmp_path, monkeypatch):
    often = partial(McapWriter, definitions_interval=0.0)
    monkeypatch.setattr('soliton_linkage_nodes.bags.record.bag_writer.McapWriter', often)
    data = data_file(write_nudges(tmp_path / 'run'))
    sent = rescued(data)
    whole = data.read_bytes()
    end_of_data = whole.index(mcap_records.record(mcap_records.Opcode.DATA_END, bytes(4)))
    damaged = bytearray(whole[:end_of_data])
    damaged[whole.index(sent[0][2])] ^= 1
    data.write_bytes(damaged)
    # The chunk that begins with the first definitions is lost as a whole.
    left = rescued(data)
    assert 0 < len(left) < len(sent)
    assert left == sent[-len(left) :]


@pytest.mark.parametrize('content', [b'', b'no bag', bytes(5000)])
@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
def test_a_file_with_nothing_in_it_begins_no_bag(tmp_path, content, suffix):
    path = tmp_path / f'run_0{suffix}'
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r'nothing can be recovered from bag .*: run_0'):
        recover_bag(path, tmp_path / 'new')
    assert not (tmp_path / 'new_0').exists()


def interrupt_transaction(data: Path) -> Path:
    """Leave a database and its journal as they are within a transaction."""
    journal = Path(f'{data}-journal')
    with closing(sqlite3.connect(data, isolation_level=None)) as database:
        database.execute('PRAGMA journal_mode = DELETE')
        database.execute('PRAGMA cache_size = 1')
        database.execute('BEGIN')
        database.execute('UPDATE messages SET data = zeroblob(5000)')
        copies = {path: path.read_bytes() for path in (data, journal)}
        database.execute('ROLLBACK')
    for path, content in copies.items():
        path.write_bytes(content)
    return journal


def test_an_interrupted_transaction_is_undone_in_a_copy(named, tmp_path):
    bag = write(tmp_path / 'run', named, 'sqlite3')
    sent = contents(bag)
    interrupt_transaction(data_file(bag))
    assert attempt(bag, tmp_path / 'new') == sent


def test_a_journal_deletes_no_other_file(named, tmp_path):
    bag = write(tmp_path / 'run', named, 'sqlite3')
    victim = tmp_path / 'victim'
    victim.write_bytes(b'kept')
    journal = interrupt_transaction(data_file(bag))
    name = str(victim).encode()
    checksum = sum(byte - 256 * (byte > 127) for byte in name) % 2**32
    tail = struct.pack(f'>I{len(name)}sII', 2**18 + 1, name, len(name), checksum)
    with journal.open('ab') as file:
        file.write(tail + bytes.fromhex('d9d505f920a163d7'))
    recover_bag(bag, tmp_path / 'new')
    assert victim.read_bytes() == b'kept'


def test_rows_of_a_cut_sqlite3_file_that_sqlite_can_read_come_back(named, tmp_path):
    bag = write(tmp_path / 'run', named, 'sqlite3', frames=400)
    sent = contents(bag)
    data = data_file(bag)
    whole = data.read_bytes()
    found = []
    for share in (0.3, 0.6, 0.9):
        data.write_bytes(whole[: int(share * len(whole))])
        held = rescued(data)
        assert held == sent[: len(held)]
        found.append(len(held))
    assert 0 < found[0] < found[1] < found[2]
    report = check_bag(bag)
    assert 'not a whole page' in report.damage[0]
    assert 'sqlite3 reports' in report.damage[1]
    assert report.messages + report.lost == len(sent)


def test_a_type_whose_definition_is_lost_is_taken_from_the_metadata(tmp_path):
    bag = write_nudges(tmp_path / 'run')
    channel = mcap_records.channel_record(mcap_records.Channel(1, 1, '/nudge', 'cdr', {}))
    body = serialize_message(NUDGE.type(data=0.5))
    message = mcap_records.message_head(1, START, len(body)) + body
    data_file(bag).write_bytes(mcap_records.MAGIC + channel + message)
    report, new = recover_bag(bag, tmp_path / 'new')
    assert [topic.type_name for topic in report.counts] == [type_name(NUDGE.type)]
    assert contents(new) == [('/nudge', START, body)]
