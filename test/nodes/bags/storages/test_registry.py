# SPDX-License-Identifier: Apache-2.0
"""A storage that nobody of the suite knows is recorded, split, rescued, checked and read."""

from __future__ import annotations

import pickle
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from graphs import Graph
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.metadata import ReaderMetadata, parse_qos

from soliton_linkage_nodes.bags.read.reading import open_bag, read_messages
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.bags.rescue.bag_rescue import check_bag, recover_bag
from soliton_linkage_nodes.bags.storages.registry import (
    STORAGES,
    compressions,
    offered_elsewhere,
)
from soliton_linkage_nodes.bags.storages.storage import FileWriter, RescuedFile, Storage
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.runtime import interfaces

START = 1000


class PrefixedWriter(FileWriter):
    """Pickled entries, each with its length before it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._file = path.open('xb')

    @property
    def size(self) -> int:
        return self._file.tell()

    def add_topic(self, topic: StoredTopic) -> None:
        self._put(topic)

    def write(self, number: int, stamp: int, serialized: bytes) -> None:
        self._put((number, stamp, serialized))
        self.counts[number] += 1
        self._widen([stamp])

    def flush(self) -> None:
        self._file.flush()

    def discard(self) -> None:
        raise NotImplementedError

    def note(self, texts: Mapping[str, str]) -> None:
        self._put(dict(texts))

    def close(self, metadata: str) -> None:
        self._file.close()

    def abandon(self) -> None:
        self._file.close()

    def _put(self, entry: object) -> None:
        data = pickle.dumps(entry)
        self._file.write(len(data).to_bytes(4, 'little') + data)


class RescuedPrefixed(RescuedFile):
    """The entries before the first that is cut."""

    def _learn(self, path: Path) -> None:
        entries = list(self._entries(path.read_bytes()))
        self.topics = {e.number: e for e in entries if isinstance(e, StoredTopic)}
        for entry in entries:
            self.custom_data.update(entry if isinstance(entry, dict) else {})
        self._found = [entry for entry in entries if isinstance(entry, tuple)]

    def _messages(self) -> Iterator[tuple[int, int, bytes]]:
        yield from self._found

    def _conclude(self) -> None:
        pass

    def _entries(self, data: bytes) -> Iterator[Any]:
        while data:
            size = 4 + int.from_bytes(data[:4], 'little')
            if len(data) < size:
                self.complain('the last entry is cut')
                return
            yield pickle.loads(data[4:size])
            data = data[size:]


class PrefixedReader:
    """What rosbags reads a whole file by."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.connections: list[Connection] = []
        self.metadata = ReaderMetadata(0, 0, 0, 0, None, None, None, None)

    def open(self) -> None:
        self._file = RescuedPrefixed(self._path)
        nothing = MessageDefinition(MessageDefinitionFormat.NONE, '')
        for number, topic in self._file.topics.items():
            ext = ConnectionExtRosbag2(topic.serialization, parse_qos(topic.profiles))
            told = (number, topic.name, topic.type_name, nothing, topic.digest, 0, ext, self)
            self.connections.append(Connection(*told))

    def close(self) -> None:
        pass

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        by_topic = {connection.topic: connection for connection in connections}
        for topic, stamp, data in self._file.messages():
            wanted = (start or 0) <= stamp and (stop is None or stamp < stop)
            if wanted and topic.name in by_topic:
                yield by_topic[topic.name], stamp, data


@pytest.fixture(autouse=True)
def prefixed(monkeypatch: pytest.MonkeyPatch) -> None:
    storage = Storage('.prefixed', {'none': PrefixedWriter}, RescuedPrefixed, PrefixedReader)
    monkeypatch.setitem(STORAGES, 'prefixed', storage)


def write(name: Path) -> BagWriter:
    writer = BagWriter(name, 'prefixed')
    topic = writer.add_topic('/nudge', 'std_msgs/msg/Float64', interfaces.NUDGE.qos)
    for number in range(20):
        if number == 12:
            writer.split()
        writer.write(topic, START + number, bytes([number]))
    writer.note({'lost_messages': '{"/nudge": 0}'})
    return writer


def contents(bag: Path) -> list[tuple[str, int, bytes]]:
    with open_bag(bag) as reader:
        return [(c.topic, t, data) for c, t, data in read_messages(reader, reader.connections)]


def test_it_is_written_in_files_checked_and_read(tmp_path: Path) -> None:
    writer = write(tmp_path / 'run')
    writer.close()
    names = {path.name for path in writer.path.iterdir()}
    assert names == {'metadata.yaml', 'run_0_0.prefixed', 'run_0_1.prefixed'}
    assert contents(writer.path) == [('/nudge', START + n, bytes([n])) for n in range(20)]
    report = check_bag(writer.path)
    assert (report.storage, report.messages, report.damage) == ('prefixed', 20, [])
    assert contents(writer.path / 'run_0_1.prefixed') == contents(writer.path)[12:]


def test_what_is_cut_is_rescued_into_a_bag_of_the_same_storage(tmp_path: Path) -> None:
    writer = write(tmp_path / 'run')
    writer.close()
    (writer.path / 'metadata.yaml').unlink()
    with pytest.raises(ValueError, match=r'has no metadata\.yaml'):
        contents(writer.path)
    data = writer.path / 'run_0_1.prefixed'
    data.write_bytes(data.read_bytes()[:-3])
    report, new = recover_bag(writer.path, tmp_path / 'new')
    assert 'run_0_1.prefixed: the last entry is cut' in report.damage
    assert contents(new) == [('/nudge', START + n, bytes([n])) for n in range(19)]
    assert (new / 'new_0_0.prefixed').exists()


def test_its_compressions_are_its_own(tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match="'zstd' is not for storage 'prefixed'; use mcap, or none"
    ):
        BagWriter(tmp_path / 'run', 'prefixed', 'zstd')
    assert compressions() == ('none', 'zstd')


def test_the_recorder_takes_a_storage_that_was_added_since(graph: Graph, tmp_path: Path) -> None:
    given = {'output': str(tmp_path / 'run'), 'topics': ['nudge']}
    graph.stop(graph.start(BagRecorder, {**given, 'storage': 'prefixed'}))
    assert check_bag(tmp_path / 'run_0').storage == 'prefixed'
    with pytest.raises(ValueError, match="must be one of 'mcap', 'sqlite3', 'prefixed'"):
        graph.start(BagRecorder, {**given, 'storage': 'unknown'})


def test_other_packages_offer_storages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / 'elsewhere-1.0.dist-info'
    folder.mkdir()
    (folder / 'METADATA').write_text('Name: elsewhere\nVersion: 1.0\n')
    (folder / 'entry_points.txt').write_text(
        '[soliton_linkage_nodes.storages]\nfolded = pathlib:Path\n'
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert offered_elsewhere() == {'folded': Path}
