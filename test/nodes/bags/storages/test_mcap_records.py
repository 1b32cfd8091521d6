# SPDX-License-Identifier: Apache-2.0
"""Records are read as they were written, and a damaged one is never anything but a ValueError."""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Channel, Message, Schema

TEXTS = st.text(alphabet=st.characters(exclude_categories=['Cs']), max_size=20)
NUMBERS = st.integers(0, 2**16 - 1)
SCHEMAS = st.builds(Schema, NUMBERS, TEXTS, TEXTS, st.binary(max_size=50))
CHANNELS = st.builds(
    Channel, NUMBERS, NUMBERS, TEXTS, TEXTS, st.dictionaries(TEXTS, TEXTS, max_size=3)
)
MESSAGES = st.builds(Message, NUMBERS, st.integers(0, 2**64 - 1), st.binary(max_size=50))


def body(record: bytes) -> bytes:
    ((_, _, content),) = mcap.records_in(record)
    return content


@given(SCHEMAS, CHANNELS, MESSAGES)
def test_records_are_read_as_they_were_written(
    schema: Schema, channel: Channel, message: Message
) -> None:
    assert mcap.parse_schema(body(mcap.schema_record(schema))) == schema
    assert mcap.parse_channel(body(mcap.channel_record(channel))) == channel
    head = mcap.message_head(message.channel, message.stamp, len(message.data))
    assert mcap.parse_message(body(head + message.data)) == message
    texts = dict(channel.metadata)
    assert mcap.parse_metadata(body(mcap.metadata_record('x', texts))) == ('x', texts)


@given(st.binary(max_size=3000), st.sampled_from(['', 'zstd']), st.data())
def test_a_chunk_is_whole_or_known_not_to_be(
    records: bytes, codec: str, data: st.DataObject
) -> None:
    begin, records_packed = mcap.chunk_record(records, 1, 2, codec)
    content = body(begin + records_packed)
    head = mcap.parse_chunk_head(content)
    packed = len(records_packed)
    assert (head.size, head.packed, head.codec) == (len(content), packed, codec)
    assert mcap.unpack(head, content[head.begin :], 3000) == (records, True)
    if packed:
        damaged = bytearray(content[head.begin :])
        damaged[data.draw(st.integers(0, packed - 1))] ^= 1 << data.draw(st.integers(0, 7))
        unpacked, whole = mcap.unpack(head, bytes(damaged), 3000)
        assert not whole or unpacked == records
        cut = data.draw(st.integers(0, packed - 1))
        unpacked, whole = mcap.unpack(head, content[head.begin : head.begin + cut], 3000)
        assert records.startswith(bytes(unpacked))


@pytest.mark.parametrize(
    'parse',
    [
        mcap.parse_schema,
        mcap.parse_channel,
        mcap.parse_message,
        mcap.parse_metadata,
        mcap.parse_chunk_head,
    ],
)
@given(content=st.binary(max_size=80))
def test_what_is_no_record_is_nothing_but_a_value_error(
    parse: Callable[[bytes], object], content: bytes
) -> None:
    with suppress(ValueError):
        parse(content)


def test_records_end_where_one_is_cut() -> None:
    whole = mcap.message_head(1, 2, 3) + b'abc'
    for length in range(2 * len(whole)):
        assert len(list(mcap.records_in((2 * whole)[:length]))) == length // len(whole)


def test_a_number_is_written_with_its_lowest_byte_first() -> None:
    assert mcap.sized(b'ab') == struct.pack('<I', 2) + b'ab'
